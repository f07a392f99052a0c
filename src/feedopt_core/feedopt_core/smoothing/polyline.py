"""Sequences of straight moves: corners between long elements, and runs of short moves that approximate a curve.

At a vertex with turning angle th between elements of lengths a and b, a pair of Euler spirals within the tolerance e is
about ``6 e / th`` long. Where that is more than half of the shorter element, ``th min(a, b) < 12 e``, the elements are
too short for a blend that uses the whole tolerance. Two or more such vertices in sequence are a run. A run is replaced
by one smooth curve. The single vertices of a run do not show its corners: a corner is found from the directions of the
path over a distance of several tolerances.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.compiled import compiled
from feedopt_core.programs.moves import PathMode
from feedopt_core.smoothing.path_element import PathElement, rounding_mm, straight_element
from feedopt_core.smoothing.runs.run import Run

_RUN_TURN = 12.0
_CORNER_REACH = 10.0
_CORNER_RAD = 0.8
_MERGED_SHARE = 1e-6
_DROPPED_SHARE = 1e-5
_FIRST_BLOCK = 64
_BLOCK = 512
_MOST_MERGED = 100
_CUT_LENGTH = 24.0
_CUT_RATIO = 3.0


@dataclass(frozen=True)
class PolylineKind:
    """What all moves of a polyline have in common."""

    tolerance_mm: float
    rapid: bool
    mode: PathMode


class Polyline:
    """Straight moves of one kind in, elements out, in bounded memory.

    Args:
        start_mm: where the first move starts, shape (dimensions,).
        kind: of all moves.
    """

    def __init__(self, start_mm: FloatArray, kind: PolylineKind) -> None:
        self.kind = kind
        naive_mm = min(kind.mode.naive_cam_mm, 0.5 * kind.tolerance_mm)
        self._tolerance_mm = kind.tolerance_mm - naive_mm
        self._merged_mm = max(naive_mm, _MERGED_SHARE * kind.tolerance_mm)
        # Vertices held, with line and feed of the move that ends at each.
        self._points_mm = start_mm[None, :]
        self._lines = np.zeros(1, dtype=np.int64)
        self._feeds_mm_s = np.zeros(1)
        self._next = 0
        """Vertex at which the next element starts: a corner, or the last one given to the open run."""
        self._before_in_run = False
        self._run: Run | None = None
        self._enough = _FIRST_BLOCK

    def add(self, points_mm: FloatArray, lines: IntArray, feed_mm_s: FloatArray) -> Iterator[PathElement]:
        """Add moves to the points, shape (n, dimensions); yields the path elements that are final now."""
        self._points_mm = np.concatenate([self._points_mm, points_mm])
        self._lines = np.concatenate([self._lines, lines])
        self._feeds_mm_s = np.concatenate([self._feeds_mm_s, feed_mm_s])
        if len(self._points_mm) > self._enough or self.kind.mode.exact_stop:
            yield from self._process(final=False)
            self._enough = max(_BLOCK, 2 * len(self._points_mm))

    def finish(self) -> Iterator[PathElement]:
        """Yield the remaining elements."""
        yield from self._process(final=True)

    def _process(self, *, final: bool) -> Iterator[PathElement]:
        self._drop_duplicates()
        if self.kind.mode.exact_stop:
            yield from self._exact_stops()
            return
        self._merge_collinear()
        corner, known = self._corners(final=final)
        for vertex in np.flatnonzero(corner[self._next + 1 : known + 1]) + self._next + 1:
            yield from self._element_or_run(int(vertex))
        if not final and known - self._next >= 2:
            if self._run is None:
                yield from self._open_run()
            yield from self._feed_run(known)
        self._forget()

    def _exact_stops(self) -> Iterator[PathElement]:
        for vertex in range(self._next + 1, len(self._points_mm)):
            yield self._straight(self._points_mm[vertex - 1], self._points_mm[vertex], vertex, exact_stop=True)
        self._next = len(self._points_mm) - 1
        self._forget()

    def _keep(self, kept: NDArray[np.bool_]) -> None:
        self._points_mm, self._lines = self._points_mm[kept], self._lines[kept]
        self._feeds_mm_s = self._feeds_mm_s[kept]

    def _drop_duplicates(self) -> None:
        """Drop moves far shorter than the tolerance; the last point is always kept."""
        least_mm = max(_DROPPED_SHARE * self.kind.tolerance_mm, rounding_mm(self._points_mm))
        chords = np.linalg.norm(np.diff(self._points_mm, axis=0), axis=1)
        if np.all(chords > least_mm):
            return
        kept = np.zeros(len(self._points_mm), dtype=bool)
        kept[: self._next + 1] = True
        last = self._next
        for index in range(last + 1, len(kept)):
            if np.linalg.norm(self._points_mm[index] - self._points_mm[last]) > least_mm:
                kept[index], last = True, index
        if last != len(kept) - 1 and last > self._next:
            # The last point replaces the last vertex kept.
            kept[last], kept[-1] = False, True
            self._lines[-1], self._feeds_mm_s[-1] = self._lines[last], self._feeds_mm_s[last]
        elif last != len(kept) - 1 and np.any(self._points_mm[-1] != self._points_mm[last]):
            kept[-1] = float(np.linalg.norm(self._points_mm[-1] - self._points_mm[last])) > rounding_mm(self._points_mm)
        self._keep(kept)

    def _merge_collinear(self) -> None:
        """Drop vertices that lie on the straight line between others."""
        merged_mm = max(self._merged_mm, rounding_mm(self._points_mm))
        points = np.ascontiguousarray(self._points_mm)
        line_from, kept = _straightened(points, self._feeds_mm_s, self._next, merged_mm)
        self._lines = self._lines[line_from]
        self._keep(kept)

    def _corners(self, *, final: bool) -> tuple[NDArray[np.bool_], int]:
        """Corner flag of each vertex held (ends included), and the last vertex for which the flag is final."""
        p = self._points_mm
        steps = np.diff(p, axis=0)
        chords = np.linalg.norm(steps, axis=1)
        if len(p) < 2:
            return np.ones(len(p), dtype=bool), len(p) - 1
        directions = steps / chords[:, None]
        turns = np.zeros(len(p))
        turns[1:-1] = _turns(directions[:-1], directions[1:])
        shorter = np.minimum(chords[:-1], chords[1:])
        corner = np.ones(len(p), dtype=bool)
        corner[1:-1] = turns[1:-1] * shorter >= _RUN_TURN * self._tolerance_mm
        reach_mm = _CORNER_REACH * self._tolerance_mm
        length = np.concatenate([[0.0], np.cumsum(chords)])
        corner[1:-1] |= _sharp(p, length, reach_mm)[1:-1]
        known = len(p) - 1
        if not final:
            known = int(np.searchsorted(length, length[-1] - 2.0 * reach_mm)) - 2
        # A single vertex between two corners is a corner as well.
        in_run = ~corner
        in_run[self._next] = self._before_in_run
        alone = in_run[1:-1] & ~in_run[:-2] & ~in_run[2:]
        corner[1:-1] |= alone
        corner[: self._next + 1] = False
        return corner, known

    def _element_or_run(self, vertex: int) -> Iterator[PathElement]:
        """Yield the elements up to the next corner."""
        if self._run is None and vertex == self._next + 1:
            yield self._straight(self._points_mm[self._next], self._points_mm[vertex], vertex)
        else:
            if self._run is None:
                yield from self._open_run()
            yield from self._feed_run(vertex - 1)
            yield from self._close_run(vertex)
        self._next, self._before_in_run = vertex, False

    def _straight(
        self, start_mm: FloatArray, end_mm: FloatArray, vertex: int, *, exact_stop: bool = False, cut: str = ""
    ) -> PathElement:
        """Straight element; ``cut`` names the end at which a run takes over."""
        line, feed_mm_s = int(self._lines[vertex]), float(self._feeds_mm_s[vertex])
        element = straight_element(start_mm, end_mm, line, feed_mm_s, self._tolerance_mm, self.kind.rapid)
        whole_mm = 2.0 * element.available_start_mm
        return replace(
            element,
            exact_stop=exact_stop,
            follows=cut == "start",
            available_start_mm=whole_mm if cut == "end" else element.available_start_mm,
            available_end_mm=whole_mm if cut == "start" else element.available_end_mm,
        )

    def _open_run(self) -> Iterator[PathElement]:
        """Begin a run at the next element. A long element stays straight until the run has to turn."""
        p, first = self._points_mm, self._next
        lead_mm = self._lead(p[first : first + 3], p[first + 1 :])
        if lead_mm is None:
            self._run = Run(self._tolerance_mm, self.kind.rapid, p[first], None)
        else:
            step = p[first + 1] - p[first]
            direction = step / np.linalg.norm(step)
            cut_mm = p[first + 1] - lead_mm * direction
            yield self._straight(p[first], cut_mm, first + 1, cut="end")
            self._run = Run(self._tolerance_mm, self.kind.rapid, cut_mm, direction)
        self._before_in_run = True

    def _feed_run(self, vertex: int) -> Iterator[PathElement]:
        """Pass all vertices up to ``vertex`` to the run."""
        assert self._run is not None
        new = slice(self._next + 1, vertex + 1)
        if new.stop > new.start:
            yield from self._run.add(self._points_mm[new], self._lines[new], self._feeds_mm_s[new])
            self._next, self._before_in_run = vertex, True

    def _close_run(self, vertex: int) -> Iterator[PathElement]:
        """End the run with the element to a corner; within it, if the element is long."""
        p, run, before = self._points_mm, self._run, vertex - 1
        assert run is not None
        self._run = None
        lead_mm = self._lead(p[[vertex, before, before - 1]], p[before - 1 :: -1]) if before > 0 else None
        line, feed_mm_s = self._lines[[vertex]], self._feeds_mm_s[[vertex]]
        if lead_mm is None:
            yield from run.add(p[[vertex]], line, feed_mm_s)
            yield from run.finish(None)
            return
        step = p[vertex] - p[before]
        direction = step / np.linalg.norm(step)
        cut_mm = p[before] + lead_mm * direction
        yield from run.add(cut_mm[None, :], line, feed_mm_s)
        yield from run.finish(direction)
        yield self._straight(cut_mm, p[vertex], vertex, cut="start")

    def _lead(self, corner: FloatArray, beyond: FloatArray) -> float | None:
        """Length of a long element that the run next to it uses; None for a short element, which joins the run whole.

        Args:
            corner: far end of the element, end shared with the run, next vertex of the run, shape (3, dimensions).
            beyond: vertices of the run, from the shared end on.
        """
        element, chord = corner[1] - corner[0], corner[2] - corner[1]
        length = float(np.linalg.norm(element))
        if length < max(_CUT_LENGTH * self._tolerance_mm, _CUT_RATIO * float(np.linalg.norm(chord))):
            return None
        reach_mm = _CORNER_REACH * self._tolerance_mm
        ways = beyond[:512] - corner[1]
        distances = np.linalg.norm(ways, axis=1)
        far = int(np.argmax(distances >= reach_mm)) if np.any(distances >= reach_mm) else len(ways) - 1
        turn = float(_turns((element / length)[None, :], (ways[far] / max(distances[far], 1e-300))[None, :])[0])
        # The spiral from a straight line into a circle with this turn over this distance, within the tolerance.
        radius_mm = max(float(distances[far]), reach_mm) / max(turn, 1e-9)
        wanted_mm = max(12.0 * self._tolerance_mm, float(np.sqrt(18.0 * radius_mm * self._tolerance_mm)))
        return min(0.5 * length, wanted_mm)

    def _forget(self) -> None:
        """Drop the vertices before the next element, except those that give the direction at its start."""
        p, first = self._points_mm, self._next
        behind = np.linalg.norm(p[: first + 1] - p[first], axis=1) > _CORNER_REACH * self._tolerance_mm
        drop = max(0, min(first - 2, int(np.flatnonzero(behind)[-1]) - 1 if np.any(behind) else 0))
        self._points_mm, self._lines = p[drop:], self._lines[drop:]
        self._feeds_mm_s, self._next = self._feeds_mm_s[drop:], first - drop


@compiled
def _straightened(
    points: FloatArray, feeds: FloatArray, first: int, merged: float
) -> tuple[IntArray, NDArray[np.bool_]]:
    """Merge moves of one feed that stay close to one straight line.

    Returns:
        For each vertex: the vertex whose move gives the program line, and whether it stays; from ``first`` on.
    """
    count = len(points)
    line_from, kept = np.arange(count), np.ones(count, dtype=np.bool_)
    anchor = first
    while anchor < count - 2:
        end = anchor + 1
        while end < count - 1 and end - anchor < _MOST_MERGED and feeds[end + 1] == feeds[end]:
            if not _is_straight(points, anchor, end + 1, merged):
                break
            end += 1
        kept[anchor + 1 : end] = False
        line_from[end] = anchor + 1
        anchor = end
    return line_from, kept


@compiled
def _is_straight(points: FloatArray, first: int, last: int, merged: float) -> bool:
    """The vertices between two others lie within a distance of their chord, and in order."""
    square = 0.0
    for d in range(points.shape[1]):
        square += (points[last, d] - points[first, d]) ** 2
    before = 0.0
    for index in range(first + 1, last):
        along = 0.0
        for d in range(points.shape[1]):
            along += (points[index, d] - points[first, d]) * (points[last, d] - points[first, d])
        if not before < along < square:
            return False
        before = along
        off = 0.0
        for d in range(points.shape[1]):
            step = points[last, d] - points[first, d]
            off += (points[index, d] - points[first, d] - along / square * step) ** 2
        if off > merged * merged:
            return False
    return True


def _turns(before: FloatArray, after: FloatArray) -> FloatArray:
    """Angles between unit vectors, shape (n,)."""
    difference, total = np.linalg.norm(after - before, axis=1), np.linalg.norm(after + before, axis=1)
    return np.asarray(2.0 * np.arctan2(difference, total))


def _sharp(points: FloatArray, length: FloatArray, reach_mm: float) -> NDArray[np.bool_]:
    """Vertices where the path turns sharply within the reach on either side; of several, only the sharpest."""
    count = len(points)
    index = np.arange(count)
    behind = np.minimum(np.searchsorted(length, length - reach_mm, side="right") - 1, index - 1).clip(0)
    ahead = np.maximum(np.searchsorted(length, length + reach_mm), index + 1).clip(max=count - 1)
    into, out = points - points[behind], points[ahead] - points
    sizes = np.linalg.norm(into, axis=1), np.linalg.norm(out, axis=1)
    valid = (sizes[0] > 0.0) & (sizes[1] > 0.0)
    turns = np.zeros(count)
    turns[valid] = _turns(into[valid] / sizes[0][valid][:, None], out[valid] / sizes[1][valid][:, None])
    sharp = np.flatnonzero(turns > _CORNER_RAD)
    found = np.zeros(count, dtype=bool)
    # In falling order of sharpness: each vertex excludes its neighbours within the reach.
    for vertex in sharp[np.argsort(-turns[sharp], kind="stable")]:
        if not np.any(found[behind[vertex] + 1 : ahead[vertex]]):
            found[vertex] = True
    return found
