"""The curve from one layer to the next: Euler spirals seen from above, a quintic descent, G2 throughout.

Seen from above the curve is four Euler spirals in a row. Between straight contours they are symmetric: the curvature
rises over a tenth of the length, falls to about 60 % towards the middle, and back again. So the curve leaves the
contour tangentially, turns round beside it and joins it again tangentially. The descent is the quintic with no slope
and no bend at both ends. Position, tangent and curvature vector agree with both contours.
(Repositioning by Euler spirals instead of circular arcs: thesis, abstract and section 1.3; its chapter on it is not at
hand. docs/decisions/ says why this shape.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly, make_interp_spline
from scipy.optimize import root

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.quadrature import gauss_legendre

_RAMP = 0.1
"""Part of the length over which the curvature rises: the loop of least motion time, to 2 % for 3 to 10 mm of room."""
_JOINTS = np.array([0.0, _RAMP, 0.5, 1.0 - _RAMP, 1.0])
_SPAN_ENDS = np.append(np.linspace(_JOINTS[:-1], _JOINTS[1:], 4, endpoint=False).T.ravel(), 1.0)
_DEGREE = 5
_CLOSED_REACH = 0.28453
"""Reach of the closed curve between straight ends, over its length."""
_CLOSED_CURVATURES = np.array([8.543, 5.029, 8.543])
_SHARPEST = 12.0
"""Largest curvature times reach; that of the closed curve between straight ends is 2.43."""
_REACH_ERROR = 0.01
_MOST_SIZES = 12
_STEPS = 8
_SOLVED = 1e-9
_NODES, _WEIGHTS = gauss_legendre(12)


@dataclass(frozen=True)
class Pose:
    """State of a level path at a point.

    Attributes:
        point_mm: shape (3,).
        heading_rad: direction from x towards y.
        curvature_per_mm: above zero where it turns left.
    """

    point_mm: FloatArray
    heading_rad: float
    curvature_per_mm: float


@dataclass(frozen=True)
class TransitionCurve:
    """A clamped quintic B-spline, C2, from one pose to another.

    Attributes:
        knots: shape (n + 6,).
        control_points_mm: shape (n, 3).
        level_length_mm: its length seen from above.
    """

    knots: FloatArray
    control_points_mm: FloatArray
    level_length_mm: float


def transition_curve(start: Pose, end: Pose, turn_rad: float, reach_mm: float) -> TransitionCurve | None:
    """Curve between two poses that reaches sideways about so far.

    Args:
        start, end: where it leaves one contour and joins the next.
        turn_rad: angle turned seen from above, above zero to the left; equal to the difference of the headings but for
            whole turns.
        reach_mm: largest distance from the tangent at the start, to the side it turns to.

    Returns:
        None where no such curve was found.
    """
    sine, cosine = np.sin(start.heading_rad), np.cos(start.heading_rad)
    ahead = np.array([[cosine, sine], [-sine, cosine]])
    goal_mm = ahead @ (end.point_mm - start.point_mm)[:2]
    bends = np.array([start.curvature_per_mm, end.curvature_per_mm])
    length_mm = reach_mm / _CLOSED_REACH * max(0.5, abs(turn_rad) / (2.0 * np.pi))
    for _ in range(_MOST_SIZES):
        curvatures = _curvatures(turn_rad, goal_mm / length_mm, bends * length_mm)
        if curvatures is None:
            return None
        places, _ = _shape(curvatures)
        if float(np.max(np.abs(curvatures))) * reach_mm > _SHARPEST * length_mm:
            return None
        reached_mm = length_mm * float(np.max(np.sign(turn_rad) * places[:, 1]))
        if abs(reached_mm - reach_mm) <= _REACH_ERROR * reach_mm:
            return _spline(start, end, curvatures, length_mm)
        # Not by more than a factor of two at once: with other ends the curve does not simply scale.
        length_mm *= float(np.clip(reach_mm / max(reached_mm, 1e-9), 0.5, 2.0))
    return None


def _curvatures(turn_rad: float, goal: FloatArray, bends: FloatArray) -> FloatArray | None:
    """Curvatures at the ends of the four spirals of a curve of length 1, shape (5,), that leads to a goal.

    Followed from the closed curve between straight ends, whose curvatures are known, to the wanted ends.
    """
    whole_turn = np.copysign(2.0 * np.pi, turn_rad)
    for steps in (1, _STEPS):
        inner: FloatArray | None = np.copysign(_CLOSED_CURVATURES, turn_rad)
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            turn = whole_turn + share * (turn_rad - whole_turn)
            inner = None if inner is None else _solved(inner, turn, share * goal, share * bends)
        if inner is not None:
            return np.array([bends[0], *inner, bends[1]])
    return None


def _solved(guess: FloatArray, turn_rad: float, goal: FloatArray, bends: FloatArray) -> FloatArray | None:
    """The three inner curvatures that lead to a goal with a turn, from a guess."""

    def misses(found: FloatArray) -> FloatArray:
        places, headings = _shape(np.array([bends[0], *found, bends[1]]))
        return np.append(places[-1] - goal, headings[-1] - turn_rad)

    found = np.asarray(root(misses, guess, tol=1e-13).x, dtype=np.float64)
    return found if float(np.max(np.abs(misses(found)))) <= _SOLVED else None


def _shape(curvatures: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places, shape (17, 2), and headings at the span ends of a curve of length 1 that starts at 0 along x."""
    width = np.diff(_SPAN_ENDS)
    inside = _SPAN_ENDS[:-1, None] + width[:, None] * _NODES
    heading = _headings(curvatures, inside.ravel()).reshape(inside.shape)
    steps = width[:, None] * np.stack([np.cos(heading) @ _WEIGHTS, np.sin(heading) @ _WEIGHTS], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), _headings(curvatures, _SPAN_ENDS)


def _headings(curvatures: FloatArray, at: FloatArray) -> FloatArray:
    """Integral of the curvature, which is linear between the joints."""
    width = np.diff(_JOINTS)
    piece = np.clip(np.searchsorted(_JOINTS, at, side="right") - 1, 0, 3)
    along = at - _JOINTS[piece]
    full = np.concatenate([[0.0], np.cumsum(width * (curvatures[1:] + curvatures[:-1]) / 2.0)])
    slope = np.diff(curvatures) / width
    return np.asarray(full[piece] + along * (curvatures[piece] + 0.5 * slope[piece] * along))


def _spline(start: Pose, end: Pose, curvatures: FloatArray, length_mm: float) -> TransitionCurve:
    """Quintic spans that meet place, direction and curvature of the spirals at 17 places; the descent is exact."""
    at = _SPAN_ENDS
    places, headings = _shape(curvatures)
    headings = headings + start.heading_rad
    sine, cosine = np.sin(start.heading_rad), np.cos(start.heading_rad)
    level_mm = length_mm * places @ np.array([[cosine, sine], [-sine, cosine]])
    bend = np.interp(at, _JOINTS, curvatures)
    drop_mm = float(end.point_mm[2] - start.point_mm[2])
    rest = 1.0 - at
    height_mm = drop_mm * at**3 * (10.0 - 15.0 * at + 6.0 * at**2)
    slope, bow = 30.0 * drop_mm * (at * rest) ** 2, 60.0 * drop_mm * at * rest * (rest - at)
    position = np.column_stack([level_mm, height_mm])
    first = np.column_stack([length_mm * np.cos(headings), length_mm * np.sin(headings), slope])
    turned = length_mm * bend
    second = np.column_stack([-turned * np.sin(headings), turned * np.cos(headings), bow])
    pieces = BPoly.from_derivatives(at, np.stack([position, first, second], axis=1))
    knots = np.concatenate([np.zeros(_DEGREE + 1), np.repeat(at[1:-1], 3), np.ones(_DEGREE + 1)])
    # The pieces join C2, so they are in the span of the B-splines with threefold knots: interpolation is exact.
    greville = np.array([np.mean(knots[index + 1 : index + 1 + _DEGREE]) for index in range(len(knots) - _DEGREE - 1)])
    net = np.asarray(make_interp_spline(greville, pieces(greville), _DEGREE, t=knots).c)
    control_mm = net + start.point_mm
    control_mm[0], control_mm[-1] = start.point_mm, end.point_mm
    return TransitionCurve(knots, control_mm, length_mm)
