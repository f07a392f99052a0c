"""Builds contours from loose pieces: joins pieces whose ends meet, and orders the contours by nearest end."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.programs.moves import ArcMove, LineMoves, NurbsMove

CurveMove = LineMoves | ArcMove | NurbsMove
_LEAST_TOLERANCE_MM = 1e-6


@dataclass(frozen=True)
class Contour:
    """Moves without a gap, each starting exactly where the one before ended."""

    moves: tuple[CurveMove, ...]

    @property
    def start_mm(self) -> FloatArray:
        """Where it starts, shape (3,)."""
        return move_ends(self.moves[0])[0]

    @property
    def end_mm(self) -> FloatArray:
        """Where it ends, shape (3,)."""
        return move_ends(self.moves[-1])[1]


def move_ends(move: CurveMove) -> tuple[FloatArray, FloatArray]:
    """Start and end of a move, mm."""
    if isinstance(move, LineMoves):
        return move.start_mm, np.asarray(move.points_mm[-1])
    if isinstance(move, ArcMove):
        return move.start_mm, move.end_mm
    return np.asarray(move.control_points_mm[0]), np.asarray(move.control_points_mm[-1])


def reversed_contour(contour: Contour) -> Contour:
    """The same contour from its end to its start."""
    return Contour(tuple(_reversed_move(move) for move in reversed(contour.moves)))


def join_contours(pieces: Sequence[Contour], tolerance_mm: float) -> list[Contour]:
    """Join pieces whose ends lie within a tolerance; the ends are moved onto each other.

    Of several ends that meet, the first one is taken. Closed pieces stay as they are. The tolerance is
    lowered to a quarter of the shortest piece, but not below 1e-6 mm; straight pieces below that are left out.

    Args:
        pieces: in the order of the program.
        tolerance_mm: largest gap that is closed, above zero.
    """
    spans_mm = np.array([np.linalg.norm(piece.end_mm - piece.start_mm) for piece in pieces])
    shortest_mm = float(np.min(spans_mm[spans_mm > _LEAST_TOLERANCE_MM], initial=np.inf))
    tolerance_mm = max(_LEAST_TOLERANCE_MM, min(tolerance_mm, 0.25 * shortest_mm))
    pieces = [piece for piece in pieces if not _is_dot(piece)]
    if not pieces:
        return []
    nodes = _end_nodes(pieces, tolerance_mm)
    at_node = defaultdict[int, list[int]](list)
    for index, (start, end) in enumerate(nodes):
        if start != end:
            at_node[int(start)].append(index)
            at_node[int(end)].append(index)
    used = [False] * len(pieces)
    joined = []
    # Open chains first, from their loose ends: starting inside a chain would cut it in two.
    loose = [index for index, ends in enumerate(nodes) if any(len(at_node[int(node)]) % 2 for node in ends)]
    for index in [*loose, *range(len(pieces))]:
        if used[index]:
            continue
        start, end = (int(node) for node in nodes[index])
        backwards = start != end and len(at_node[start]) % 2 == 0 and len(at_node[end]) % 2 == 1
        chain, node = [reversed_contour(pieces[index]) if backwards else pieces[index]], start if backwards else end
        used[index] = True
        while (following := next((other for other in at_node[node] if not used[other]), None)) is not None:
            used[following] = True
            ahead = int(nodes[following][0]) == node
            chain.append(pieces[following] if ahead else reversed_contour(pieces[following]))
            node = int(nodes[following][1 if ahead else 0])
        joined.append((index, concatenated(chain, tolerance_mm)))
    return [contour for _, contour in sorted(joined, key=lambda found: found[0])]


def concatenated(chain: Sequence[Contour], tolerance_mm: float) -> Contour:
    """Joins contours in a row into one; each is moved to start exactly where the one before ends.

    The last one is moved to close the loop if its end lies within the tolerance of the start.
    """
    moves = list(chain[0].moves)
    for piece in chain[1:]:
        moves += [_moved(piece.moves[0], move_ends(moves[-1])[1], None), *piece.moves[1:]]
    first_mm, last_mm = move_ends(moves[0])[0], move_ends(moves[-1])[1]
    if len(moves) > 1 and 0.0 < np.linalg.norm(last_mm - first_mm) <= tolerance_mm:
        moves[-1] = _moved(moves[-1], None, first_mm)
    return Contour(tuple(moves))


def order_by_nearest_end(contours: Iterable[Contour], from_mm: FloatArray) -> Iterator[Contour]:
    """Orders contours: next comes always the one with the end nearest to the end of the last one.

    Open ones are run backwards where their end is nearer; of equally near ones the first is taken.
    """
    left = list(contours)
    ends_mm = np.array([[contour.start_mm, contour.end_mm] for contour in left]).reshape(-1, 2, 3)
    open_to = np.ones(ends_mm.shape[:2], dtype=bool)
    here_mm = from_mm
    for _ in range(len(left)):
        distances = np.where(open_to, np.linalg.norm(ends_mm - here_mm, axis=2), np.inf)
        index, end = divmod(int(np.argmin(distances)), 2)
        open_to[index] = False
        contour = reversed_contour(left[index]) if end else left[index]
        here_mm = contour.end_mm
        yield contour


def _is_dot(piece: Contour) -> bool:
    """True if the contour has no length: all its moves are straight and end at its start."""
    return all(
        isinstance(move, LineMoves) and bool(np.all(np.abs(move.points_mm - move.start_mm) <= _LEAST_TOLERANCE_MM))
        for move in piece.moves
    )


def _end_nodes(pieces: Sequence[Contour], tolerance_mm: float) -> IntArray:
    """Number of the place each piece starts and ends at, shape (n, 2); ends within the tolerance are one place."""
    ends_mm = np.array([[piece.start_mm, piece.end_mm] for piece in pieces]).reshape(-1, 3)
    pairs = cKDTree(ends_mm).query_pairs(tolerance_mm, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(ends_mm), len(ends_mm)))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64).reshape(-1, 2)


def _reversed_move(move: CurveMove) -> CurveMove:
    if isinstance(move, LineMoves):
        points_mm = np.concatenate([move.points_mm[-2::-1], move.start_mm[None, :]])
        return replace(
            move,
            start_mm=move.points_mm[-1],
            points_mm=points_mm,
            lines=move.lines[::-1],
            feed_mm_s=move.feed_mm_s[::-1],
        )
    if isinstance(move, ArcMove):
        center_mm = move.center_mm + move.rise_mm * move.normal
        return replace(move, start_mm=move.end_mm, end_mm=move.start_mm, center_mm=center_mm, normal=-move.normal)
    return replace(
        move,
        knots=move.knots[0] + move.knots[-1] - move.knots[::-1],
        control_points_mm=move.control_points_mm[::-1],
        weights=move.weights[::-1],
    )


def _moved(move: CurveMove, start_mm: FloatArray | None, end_mm: FloatArray | None) -> CurveMove:
    """The move with an end shifted by a small distance."""
    old_start_mm, old_end_mm = move_ends(move)
    start_mm = old_start_mm if start_mm is None else start_mm
    end_mm = old_end_mm if end_mm is None else end_mm
    if np.array_equal(start_mm, old_start_mm) and np.array_equal(end_mm, old_end_mm):
        return move
    if isinstance(move, LineMoves):
        return replace(move, start_mm=start_mm, points_mm=np.concatenate([move.points_mm[:-1], end_mm[None, :]]))
    if isinstance(move, NurbsMove):
        inner = move.control_points_mm[1:-1]
        return replace(move, control_points_mm=np.concatenate([start_mm[None, :], inner, end_mm[None, :]]))
    return _moved_arc(move, start_mm, end_mm)


def _moved_arc(move: ArcMove, start_mm: FloatArray, end_mm: FloatArray) -> ArcMove:
    """The similar arc between other ends: its plane turned and scaled so that both ends fit, its angle kept."""
    normal = move.normal
    across = np.cross(normal, move.start_mm - move.center_mm)
    along = np.cross(across, normal)
    axes = np.stack([along / np.linalg.norm(along), across / np.linalg.norm(across)])

    def flat(vector_mm: FloatArray) -> complex:
        return complex(*(axes @ vector_mm))

    scale = flat(end_mm - start_mm) / flat(move.end_mm - move.start_mm)
    radius = scale * flat(move.center_mm - move.start_mm)
    center_mm = start_mm + radius.real * axes[0] + radius.imag * axes[1]
    rise_mm = float((end_mm - start_mm) @ normal)
    return replace(move, start_mm=start_mm, end_mm=end_mm, center_mm=center_mm, rise_mm=rise_mm)
