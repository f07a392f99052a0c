"""Joints between curves: both are cut back and joined by a quintic curve.

The quintic takes over r, dr/ds and d2r/ds2 at both cuts (G2 Hermite). How far the curves are cut back is chosen so that
the blend uses the tolerance: its distance from what it replaces is measured both ways and is the checked bound. On a
mere step of curvature k (line to arc) its curvature overshoots by 8 % and the distance is 0.0027 k (length)^2, so that
it is several times longer than a spiral that has to shift the arc.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.arc_length import map_arc_length
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.geometry.path_points import PathPoints
from feedopt_core.geometry.segments import NurbsSegment, Segment
from feedopt_core.smoothing.corners.euler_pair import turning_angle
from feedopt_core.smoothing.corners.replaced import replaced_end, replaced_start, two_way_distance
from feedopt_core.smoothing.path_element import UNPLACED, PathElement, rounding_mm, sampled

SMOOTH_TURN_RAD = 1e-8
"""A smaller turn at a joint is treated as tangent."""
_SMOOTH_STEP = 1e-6
_KNOTS = np.array([0.0] * 6 + [1.0] * 6)
_STRAIGHT_PER_MM = 1e-9
"""Largest curvature, by rounding, at the end of a curve that joins a straight element."""


def _bernstein(count: int) -> FloatArray:
    """Weights of the six Bezier points at ``count`` parameters from 0 to 1, shape (count, 6)."""
    u, k = np.linspace(0.0, 1.0, count)[:, None], np.arange(6)
    return np.asarray(np.array([1.0, 5.0, 10.0, 10.0, 5.0, 1.0]) * u**k * (1.0 - u) ** (5 - k))


_COARSE, _FINE = _bernstein(33), _bernstein(129)
_TRIALS = 9
_GOOD_SHARE = 0.88
_MOST_SHARE = 0.985
_AIM_SHARE = 0.95
_LARGEST_RATIO = 4.0
"""Largest ratio of the two cuts: with very unequal cuts the quintic swings out."""
_SHARPEST_TURN_RAD = 2.97


@dataclass(frozen=True)
class Blend:
    """The curve that replaces a joint.

    Attributes:
        cut_before_mm, cut_after_mm: length it replaces of the element before and of the one after.
        curve: the blend.
        deviation_mm: its largest distance, both ways, from what it replaces.
    """

    cut_before_mm: float
    cut_after_mm: float
    curve: NurbsSegment
    deviation_mm: float


def blend(before: PathElement, bridge: Sequence[PathElement], after: PathElement) -> Blend | None:
    """Longest blend within the tolerance; None if no blend fits and the machine must stop.

    Args:
        before, after: elements to join.
        bridge: elements between them that the blend replaces as a whole.
    """
    tolerance_mm = min(element.tolerance_mm for element in (before, *bridge, after))
    end = before.curve.evaluate(np.array([before.length_mm]))
    start = after.curve.evaluate(np.zeros(1))
    turn = turning_angle(end.dr_ds[0], start.dr_ds[0])
    available_before, available_after = before.available_end_mm, after.available_start_mm
    least_mm = 1e3 * rounding_mm(end.r_mm)
    if turn > _SHARPEST_TURN_RAD or min(available_before, available_after) <= least_mm:
        return None
    step = float(np.linalg.norm(start.d2r_ds2 - end.d2r_ds2))
    cut_mm = min(_first_cut(turn, step, tolerance_mm), max(available_before, available_after))
    best: _Trial | None = None
    between = [sampled(element.curve, 0.0, element.length_mm, tolerance_mm) for element in bridge]
    for _ in range(_TRIALS):
        cut_before, cut_after = _cuts(cut_mm, available_before, available_after)
        if min(cut_before, cut_after) <= least_mm:
            break
        swing = _swing(turn, step, max(cut_before, cut_after))
        trial = _try((before, cut_before), between, (after, cut_after), swing, tolerance_mm)
        if trial.deviation_mm <= _MOST_SHARE * tolerance_mm:
            if best is None or trial.cut_mm > best.cut_mm:
                best = trial
            at_most = cut_before >= available_before and cut_after >= available_after
            if at_most or trial.deviation_mm >= _GOOD_SHARE * tolerance_mm:
                break
        elif best is not None and cut_mm <= best.cut_before_mm:
            break
        factor = _AIM_SHARE * tolerance_mm / max(trial.deviation_mm, 1e-3 * tolerance_mm)
        cut_mm *= float(np.clip(factor if turn * cut_mm > step * cut_mm**2 else np.sqrt(factor), 0.1, 4.0))
        cut_mm = min(cut_mm, max(available_before, available_after))
    return None if best is None else _finish(best)


@dataclass(frozen=True)
class _Trial:
    """A blend for two cuts: its Bezier points and its distance from what it replaces."""

    cut_before_mm: float
    cut_after_mm: float
    net_mm: FloatArray
    deviation_mm: float

    @property
    def cut_mm(self) -> float:
        return self.cut_before_mm + self.cut_after_mm


def _try(
    before: tuple[PathElement, float],
    between: list[FloatArray],
    after: tuple[PathElement, float],
    swing: float,
    tolerance_mm: float,
) -> _Trial:
    """Blend between two elements, each given with the length to cut."""
    net = _quintic_net(
        before[0].curve.evaluate(np.array([before[0].length_mm - before[1]])),
        after[0].curve.evaluate(np.array([after[1]])),
        swing,
    )
    into, beyond = replaced_end(*before, tolerance_mm), replaced_start(*after, tolerance_mm)
    replaced = np.concatenate([into.programmed_mm, *between, beyond.programmed_mm])
    deviation = 0.0
    # A blend that passes at a few points is checked again at many.
    for weights in (_COARSE, _FINE):
        if deviation <= _MOST_SHARE * tolerance_mm:
            points = weights @ net
            continued = np.concatenate([into.continuation_mm, points, beyond.continuation_mm])
            deviation = max(deviation, two_way_distance(points, replaced, continued))
    return _Trial(before[1], after[1], net, deviation)


def _first_cut(turn_rad: float, curvature_step_per_mm: float, tolerance_mm: float) -> float:
    corner_mm = 4.0 * tolerance_mm / max(turn_rad, 1e-12)
    step_mm = 0.5 * float(np.sqrt(tolerance_mm / (0.0028 * max(curvature_step_per_mm, 1e-300))))
    return min(corner_mm, step_mm)


def _cuts(cut_mm: float, available_before_mm: float, available_after_mm: float) -> tuple[float, float]:
    before, after = min(cut_mm, available_before_mm), min(cut_mm, available_after_mm)
    return min(before, _LARGEST_RATIO * after), min(after, _LARGEST_RATIO * before)


def _swing(turn_rad: float, curvature_step_per_mm: float, cut_mm: float) -> float:
    """Factor on the end speed of the quintic, from the motion times of corners of 0.05 to 2.65 rad.

    At a corner, larger speeds make the blend swing out before it turns, so that it uses the tolerance on both sides.
    """
    corner = float(np.clip(1.35 + 0.5 * (turn_rad - 0.6), 1.35, 1.9))
    share = turn_rad / max(turn_rad + curvature_step_per_mm * cut_mm, 1e-300)
    return 1.0 + (corner - 1.0) * share


def _quintic_net(start: PathPoints, end: PathPoints, swing: float) -> FloatArray:
    """Bezier points of the quintic with position, direction and curvature of one point on each curve, shape (6, d)."""
    turn = turning_angle(start.dr_ds[0], end.dr_ds[0])
    chord = float(np.linalg.norm(end.r_mm[0] - start.r_mm[0]))
    # Speed at the ends: the length of a circular arc with these directions, or more at a corner.
    speed = swing * chord * (0.5 * turn / float(np.sin(0.5 * turn)) if turn > 1e-6 else 1.0)
    net = []
    for at, sign in ((start, 1.0), (end, -1.0)):
        first = at.r_mm[0] + sign * speed / 5.0 * at.dr_ds[0]
        net.append((at.r_mm[0], first, 2.0 * first - at.r_mm[0] + speed**2 / 20.0 * at.d2r_ds2[0]))
    return np.array([*net[0], *net[1][::-1]])


def _finish(trial: _Trial) -> Blend | None:
    net = trial.net_mm
    # Parametrised over its length, so that the parameter has the scale of the program.
    scale = float(np.linalg.norm(net[-1] - net[0]))
    curve = NurbsCurve.from_control_net(5, _KNOTS * scale, net, np.ones(6))
    try:
        arc_length_map = map_arc_length(curve.evaluate, curve.joints)
    except ToolpathError:
        return None
    segment = NurbsSegment(UNPLACED, curve, arc_length_map)
    return Blend(trial.cut_before_mm, trial.cut_after_mm, segment, trial.deviation_mm)


def continues(before: Segment, after: Segment) -> bool:
    """The two curves join with the same direction and curvature, up to rounding."""
    end, start = before.evaluate(np.array([before.length_mm])), after.evaluate(np.zeros(1))
    turn = float(np.linalg.norm(start.dr_ds - end.dr_ds))
    step = float(np.linalg.norm(start.d2r_ds2 - end.d2r_ds2))
    bend = max(float(np.linalg.norm(at.d2r_ds2)) for at in (end, start))
    return turn <= 1e-8 and step <= max(1e-6 * bend, _STRAIGHT_PER_MM)
