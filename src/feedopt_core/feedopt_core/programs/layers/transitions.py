"""Programs of stacked closed contours: their layers found in the moves, and the way from one to the next replaced.

A layer is a closed contour at one height, with or without a lead-in before and a lead-out behind it at the same height.
What leads from one layer to the next (lead-out, retract, rapids, plunge, lead-in) is replaced by one curve of
smoothing/layer_transition.py, where that curve stays clear of both contours. All else is passed on as it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.programs.contours import CurveMove, move_ends
from feedopt_core.programs.layers.level_runs import LevelRun, LinkMoves, level_runs, some_of
from feedopt_core.programs.layers.transition_curve import Pose, TransitionCurve, transition_curve
from feedopt_core.programs.moves import ArcMove, LineMoves, Move, NurbsMove

_CLOSED_MM = 1e-4
_LEAST_AREA_MM2 = 1e-6
_FARTHEST_REACHES = 4.0
_REACH_SHARES = (1.0, 0.5, 0.25)
_WRONG_SIDE_MM = 0.01
"""How far a transition may lie on the wrong side of a contour: about what a polyline stands off its curve."""
_SAGITTA_MM = 1e-3
_CHECKED_POINTS = 201
_SMALLEST_LOOP_RAD = math.pi / 4.0
_SMOOTH_TURN_RAD = 0.35
_MOST_LINK_POINTS = 1000
_SPAN_POINTS = 33


class TransitionSide(Enum):
    """Side of the contours that transitions may use: away from the part."""

    OUTSIDE = "outside"
    INSIDE = "inside"


@dataclass(frozen=True)
class LayerTransitions:
    """What the way from layer to layer may use.

    Attributes:
        reach_mm: how far a transition goes sideways of the contour it leaves, above zero.
        side: on which side of the contours there is room for it.

    Raises:
        ToolpathError: the reach is not above zero.
    """

    reach_mm: float
    side: TransitionSide = TransitionSide.OUTSIDE

    def __post_init__(self) -> None:
        if not 0.0 < self.reach_mm < math.inf:
            raise ToolpathError(f"the reach of layer transitions is {self.reach_mm:g} mm, must be above zero")

    @classmethod
    def requested(cls, reach_mm: float, side: str) -> LayerTransitions | None:
        """Transitions by numbers and words of an option or a goal; None where the reach is 0.

        Args:
            reach_mm: as above, or 0 for none.
            side: ``outside``, ``inside`` or nothing, which is outside.

        Raises:
            ToolpathError: the reach is below zero, or there is no such side.
        """
        if reach_mm == 0.0:
            return None
        sides = {each.value: each for each in TransitionSide} | {"": TransitionSide.OUTSIDE}
        if side not in sides:
            raise ToolpathError(f"layer transitions have no side {side!r}; there are: outside, inside")
        return cls(reach_mm, sides[side])


@dataclass(frozen=True)
class Layer:
    """A closed contour at one height, with what stands before and behind it at that height.

    Attributes:
        lead_in, contour, lead_out: moves, in order; only the contour always has some.
        outline_mm: the contour as a polygon seen from above, shape (n, 2), closed.
        orientation: 1 for anticlockwise, -1 for clockwise.
    """

    lead_in: tuple[CurveMove, ...]
    contour: tuple[CurveMove, ...]
    lead_out: tuple[CurveMove, ...]
    outline_mm: FloatArray
    orientation: int


def with_layer_transitions(moves: Iterator[Move], reach_mm: float, side: TransitionSide) -> Iterator[Move]:
    """Moves with the way from each layer to the next replaced by a smooth curve, as a stream.

    One layer is held until the next one has come. Programmed events, exact-stop moves, runs at one height of more than
    200,000 points and links of more than 1000 are passed on and end a stack of layers.

    Args:
        moves: of the program.
        reach_mm: how far a transition goes sideways of the contour it leaves; a half and a quarter of it are tried
            where it would meet a contour.
        side: on which side of the contours there is room for it.
    """
    held: Layer | None = None
    links: list[Move] = []
    for part in level_runs(moves):
        if isinstance(part, LevelRun):
            layer = find_layer(part.moves)
            transition = layer_transition(held, layer, reach_mm, side) if held and layer and links else None
            if held and layer and transition:
                yield from (*held.lead_in, *held.contour, transition)
                layer = replace(layer, lead_in=())
            else:
                yield from _all_moves(held, links)
            held, links = layer, []
            if layer is None:
                yield from part.moves
        elif isinstance(part, LinkMoves) and held and len(links) + part.points <= _MOST_LINK_POINTS:
            links += part.moves
        else:
            yield from _all_moves(held, links)
            held, links = None, []
            yield from part.moves
    yield from _all_moves(held, links)


def find_layer(moves: Sequence[CurveMove]) -> Layer | None:
    """The longest closed contour within moves at one height; None where there is none that encloses an area."""
    ends_mm = np.concatenate([move_ends(moves[0])[0][None, :], *(_move_points_mm(move) for move in moves)])[:, :2]
    length_mm = np.concatenate([[0.0], np.cumsum(np.concatenate([_lengths_mm(move) for move in moves]))])
    _, place = np.unique(np.round(ends_mm / _CLOSED_MM), axis=0, return_inverse=True)
    place = place.ravel()
    first, last = np.full(len(ends_mm), len(ends_mm)), np.zeros(len(ends_mm), dtype=int)
    index = np.arange(len(ends_mm))
    np.minimum.at(first, place, index)
    np.maximum.at(last, place, index)
    around_mm = length_mm[last[place]] - length_mm[first[place]]
    best = int(np.argmax(around_mm))
    start, stop = int(first[place[best]]), int(last[place[best]])
    if stop <= start:
        return None
    contour = _cut(moves, start, stop)
    outline_mm = np.concatenate([_sampled(move)[:-1, :2] for move in contour] + [ends_mm[stop : stop + 1]])
    area_mm2 = _area_mm2(outline_mm)
    if abs(area_mm2) < _LEAST_AREA_MM2:
        return None
    orientation = 1 if area_mm2 > 0.0 else -1
    return Layer(_cut(moves, 0, start), contour, _cut(moves, stop, len(ends_mm)), outline_mm, orientation)


def layer_transition(before: Layer, after: Layer, reach_mm: float, side: TransitionSide) -> NurbsMove | None:
    """The curve from one layer to the next; None where there is none that stays clear of both contours.

    Raises:
        ToolpathError: a NURBS curve of a contour cannot be used.
    """
    start_mm, end_mm = move_ends(before.contour[-1])[1], move_ends(after.contour[0])[0]
    distance_mm = float(np.linalg.norm((end_mm - start_mm)[:2]))
    same_height = abs(end_mm[2] - start_mm[2]) <= _CLOSED_MM
    if same_height or distance_mm > _FARTHEST_REACHES * reach_mm or before.orientation != after.orientation:
        return None
    start, end = _pose_at_joint(before, at_end=True), _pose_at_joint(after, at_end=False)
    if start is None or end is None:
        return None
    away = -before.orientation if side is TransitionSide.OUTSIDE else before.orientation
    turn_rad = (away * (end.heading_rad - start.heading_rad)) % (2.0 * math.pi)
    if turn_rad < _SMALLEST_LOOP_RAD and distance_mm < reach_mm:
        turn_rad += 2.0 * math.pi
    first, last = after.contour[0], before.contour[-1]
    for share in _REACH_SHARES:
        curve = transition_curve(start, end, away * turn_rad, share * reach_mm)
        if curve is not None and _is_clear(curve, (before, after), side):
            weights = np.ones(len(curve.control_points_mm))
            line, feed_mm_s = _line_of(first), min(_feed_mm_s(last, -1), _feed_mm_s(first, 0))
            return NurbsMove(5, curve.knots, curve.control_points_mm, weights, line, feed_mm_s, first.mode)
    return None


def _all_moves(held: Layer | None, links: list[Move]) -> Iterator[Move]:
    if held is not None:
        yield from (*held.lead_in, *held.contour, *held.lead_out)
    yield from links


def _move_points_mm(move: CurveMove) -> FloatArray:
    """Programmed places of a move behind its start, shape (n, 3)."""
    return move.points_mm if isinstance(move, LineMoves) else move_ends(move)[1][None, :]


def _cut(moves: Sequence[CurveMove], start: int, stop: int) -> tuple[CurveMove, ...]:
    """What lies between two programmed places, counted over all moves."""
    kept, offset = list[CurveMove](), 0
    for move in moves:
        count = len(_move_points_mm(move))
        low, high = max(0, start - offset), min(count, stop - offset)
        if low < high:
            kept.append(some_of(move, np.arange(low, high)) if isinstance(move, LineMoves) else move)
        offset += count
    return tuple(kept)


def _sampled(move: CurveMove) -> FloatArray:
    """Points along a move, ends included, shape (n, 3)."""
    if isinstance(move, LineMoves):
        return np.concatenate([move.start_mm[None, :], move.points_mm])
    if isinstance(move, ArcMove):
        radial_mm = move.start_mm - move.center_mm
        radius_mm = float(np.linalg.norm(radial_mm))
        step_rad = 2.0 * math.acos(max(0.0, 1.0 - _SAGITTA_MM / max(radius_mm, _SAGITTA_MM)))
        angle = np.linspace(0.0, move.sweep_rad, 2 + int(move.sweep_rad / step_rad))[:, None]
        across_mm = np.cross(move.normal, radial_mm)
        points_mm = move.center_mm + radial_mm * np.cos(angle) + across_mm * np.sin(angle)
        return np.concatenate([move.start_mm[None, :], points_mm[1:-1], move.end_mm[None, :]])
    joints = np.unique(move.knots)
    share = np.linspace(0.0, 1.0, _SPAN_POINTS)[1:]
    u = np.append(joints[0], (joints[:-1, None] + np.diff(joints)[:, None] * share).ravel())
    return _curve_of(move).evaluate(u)[0]


def _curve_of(move: NurbsMove) -> NurbsCurve:
    return NurbsCurve.from_control_net(move.degree, move.knots, move.control_points_mm, move.weights)


def _lengths_mm(move: CurveMove) -> FloatArray:
    """Lengths between the programmed places of a move, shape (n,); of a NURBS curve that of its control polygon."""
    if isinstance(move, ArcMove):
        return np.array([float(np.linalg.norm(move.start_mm - move.center_mm)) * move.sweep_rad])
    points_mm = move.control_points_mm if isinstance(move, NurbsMove) else _sampled(move)
    chords_mm = np.linalg.norm(np.diff(points_mm, axis=0), axis=1)
    return np.array([np.sum(chords_mm)]) if isinstance(move, NurbsMove) else np.asarray(chords_mm)


def _area_mm2(outline_mm: FloatArray) -> float:
    """Signed area of a closed polygon, above zero for anticlockwise."""
    x, y = (outline_mm - outline_mm[0]).T
    return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def _line_of(move: CurveMove) -> int:
    return int(move.lines[0]) if isinstance(move, LineMoves) else move.line


def _feed_mm_s(move: CurveMove, index: int) -> float:
    return float(move.feed_mm_s[index]) if isinstance(move, LineMoves) else move.feed_mm_s


def _pose_at_joint(layer: Layer, *, at_end: bool) -> Pose | None:
    """State where a contour ends or starts, which is one place.

    Where straight moves meet there at a small angle, they stand for a curve: then the state is that of the circle
    through the place and its neighbours.
    """
    before, after = layer.contour[-1], layer.contour[0]
    if isinstance(before, LineMoves) and isinstance(after, LineMoves):
        arriving = before.points_mm[-1] - (before.points_mm[-2] if len(before.points_mm) > 1 else before.start_mm)
        leaving = after.points_mm[0] - after.start_mm
        lengths = np.array([np.linalg.norm(arriving), np.linalg.norm(leaving)])
        heading, next_heading = (math.atan2(way[1], way[0]) for way in (arriving, leaving))
        turn_rad = (next_heading - heading + math.pi) % (2.0 * math.pi) - math.pi
        if abs(turn_rad) < _SMOOTH_TURN_RAD:
            heading_rad = heading + turn_rad * float(lengths[0] / np.sum(lengths))
            return Pose(after.start_mm, heading_rad, 2.0 * turn_rad / float(np.sum(lengths)))
    return _end_pose(before) if at_end else _start_pose(after)


def _start_pose(move: CurveMove) -> Pose | None:
    if isinstance(move, LineMoves):
        way = move.points_mm[0] - move.start_mm
        return Pose(move.start_mm, math.atan2(way[1], way[0]), 0.0)
    if isinstance(move, ArcMove):
        return _arc_pose(move, move.start_mm)
    return _curve_pose(move, float(move.knots[0]))


def _end_pose(move: CurveMove) -> Pose | None:
    if isinstance(move, LineMoves):
        way = move.points_mm[-1] - (move.points_mm[-2] if len(move.points_mm) > 1 else move.start_mm)
        return Pose(move.points_mm[-1], math.atan2(way[1], way[0]), 0.0)
    if isinstance(move, ArcMove):
        return _arc_pose(move, move.end_mm)
    return _curve_pose(move, float(move.knots[-1]))


def _arc_pose(move: ArcMove, at_mm: FloatArray) -> Pose:
    radial_mm = at_mm - move.center_mm
    way = np.cross(move.normal, radial_mm)
    curvature = math.copysign(1.0, float(move.normal[2])) / float(np.linalg.norm(radial_mm))
    return Pose(at_mm, math.atan2(way[1], way[0]), curvature)


def _curve_pose(move: NurbsMove, u: float) -> Pose | None:
    r, r_u, r_uu, _ = (each[0] for each in _curve_of(move).evaluate(np.array([u])))
    speed = float(np.hypot(r_u[0], r_u[1]))
    if not speed > 0.0:
        return None
    curvature = float(r_u[0] * r_uu[1] - r_u[1] * r_uu[0]) / speed**3
    return Pose(r, math.atan2(r_u[1], r_u[0]), curvature)


def _is_clear(curve: TransitionCurve, layers: tuple[Layer, Layer], side: TransitionSide) -> bool:
    """No point of the curve lies on the wrong side of a contour, but for a hair."""
    weights = np.ones(len(curve.control_points_mm))
    spline = NurbsCurve.from_control_net(5, curve.knots, curve.control_points_mm, weights)
    points_mm = spline.evaluate(np.linspace(0.0, 1.0, _CHECKED_POINTS))[0][:, :2]
    for layer in layers:
        inside = _inside(points_mm, layer.outline_mm)
        wrong = points_mm[inside if side is TransitionSide.OUTSIDE else ~inside]
        if any(_distance_mm(point_mm, layer.outline_mm) > _WRONG_SIDE_MM for point_mm in wrong):
            return False
    return True


def _inside(points_mm: FloatArray, outline_mm: FloatArray) -> NDArray[np.bool_]:
    """Whether points lie in a closed polygon (even-odd rule)."""
    start, way = outline_mm[:-1], np.diff(outline_mm, axis=0)
    inside = np.zeros(len(points_mm), dtype=bool)
    for index, point_mm in enumerate(points_mm):
        offset = point_mm - start
        crossing = (offset[:, 1] < 0.0) != (offset[:, 1] - way[:, 1] < 0.0)
        left = offset[crossing, 0] * way[crossing, 1] < offset[crossing, 1] * way[crossing, 0]
        inside[index] = np.count_nonzero(left == (way[crossing, 1] > 0.0)) % 2 == 1
    return inside


def _distance_mm(point_mm: FloatArray, outline_mm: FloatArray) -> float:
    """Distance of a point from a closed polygon."""
    way, offset = np.diff(outline_mm, axis=0), point_mm - outline_mm[:-1]
    length2 = np.maximum(np.einsum("ed,ed->e", way, way), 1e-300)
    share = np.clip(np.einsum("ed,ed->e", offset, way) / length2, 0.0, 1.0)
    return float(np.min(np.linalg.norm(offset - share[:, None] * way, axis=1)))
