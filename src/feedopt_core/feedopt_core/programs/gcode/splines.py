"""G5, G5.1 and the G5.2 ... G5.3 block: splines in the XY plane, as LinuxCNC reads them."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.programs.gcode.codes import GCode
from feedopt_core.programs.gcode.modal_state import ModalState, Plane
from feedopt_core.programs.gcode.words import Words
from feedopt_core.programs.moves import NurbsMove

LEAST_ORDER, MOST_ORDER = 3, 10
MAX_CONTROL_POINTS = 100_000
"""Most control points of a block: a curve is held in memory as a whole."""


def read_cubic(words: Words, state: ModalState, end_mm: FloatArray) -> NurbsMove:
    """G5: cubic Bezier curve; I J from the start, P Q from the end to the inner control points.

    Raises:
        ToolpathError: another plane, motion in Z, or one of the letters is missing.
    """
    _check_plane(words, state, "G5")
    if words.has("i") != words.has("j"):
        raise words.error("G5 needs both I and J, or neither behind another G5", "ij")
    if words.has("ij"):
        lead_mm = np.array([words.need("i", "G5"), words.need("j", "G5")]) * state.unit_mm
    elif state.motion is GCode.G5:
        lead_mm = state.spline_lead_mm
    else:
        raise words.error("the first G5 of a row needs I and J")
    arrival_mm = np.array([words.need("p", "G5"), words.need("q", "G5")]) * state.unit_mm
    state.spline_lead_mm = -arrival_mm
    points_mm = np.stack([state.position_mm, state.position_mm, end_mm, end_mm])
    points_mm[1, :2] += lead_mm
    points_mm[2, :2] += arrival_mm
    return _curve(words, state, 4, points_mm, np.ones(4))


def read_quadratic(words: Words, state: ModalState, end_mm: FloatArray) -> NurbsMove:
    """G5.1: quadratic Bezier curve; I J from the start to the inner control point.

    Raises:
        ToolpathError: another plane, motion in Z, or I or J is missing.
    """
    _check_plane(words, state, "G5.1")
    points_mm = np.stack([state.position_mm, state.position_mm, end_mm])
    points_mm[1, :2] += np.array([words.need("i", "G5.1"), words.need("j", "G5.1")]) * state.unit_mm
    return _curve(words, state, 3, points_mm, np.ones(3))


class NurbsBlock:
    """Control points between G5.2 and G5.3; the first one is the current position.

    Raises:
        ToolpathError: another plane, or incremental distances.
    """

    def __init__(self, words: Words, state: ModalState) -> None:
        _check_plane(words, state, "G5.2")
        if not state.absolute:
            raise words.error("G5.2 with incremental distances (G91) is not supported; use G90")
        self._order = LEAST_ORDER
        self._points_mm = [state.position_mm.copy()]
        self._weights = [1.0]

    def add(self, words: Words, state: ModalState) -> None:
        """Take the control point of a line.

        Raises:
            ToolpathError: half a point, a weight that is missing or not above zero, an order out of range.
        """
        order = words.take("l")
        if order is not None:
            if order != round(order) or not LEAST_ORDER <= order <= MOST_ORDER:
                raise words.error(
                    f"L is the order of the NURBS: a whole number from {LEAST_ORDER} to {MOST_ORDER}, not {order:g}",
                    "l",
                )
            self._order = round(order)
        if not words.has("xyp"):
            return
        weight = words.need("p", "a control point")
        if weight <= 0.0:
            raise words.error(f"the weight P is {weight:g}, must be above zero", "p")
        if not words.has("xy"):
            if len(self._points_mm) > 1:
                raise words.error("P without X and Y belongs to the first control point only", "p")
            self._weights[0] = weight
            return
        if len(self._points_mm) == MAX_CONTROL_POINTS:
            raise words.error(f"more than {MAX_CONTROL_POINTS} control points; divide the curve", "xy")
        point_mm = state.position_mm.copy()
        for axis, letter in enumerate("xy"):
            point_mm[axis] = words.need(letter, "a control point") * state.unit_mm + state.offset_mm[axis]
        self._points_mm.append(point_mm)
        self._weights.append(weight)

    def finish(self, words: Words, state: ModalState) -> NurbsMove:
        """The curve, at G5.3.

        Raises:
            ToolpathError: fewer control points than the order.
        """
        if len(self._points_mm) < self._order:
            raise words.error(
                f"the NURBS has {len(self._points_mm)} control points with its start; order {self._order} needs as many"
            )
        return _curve(words, state, self._order, np.array(self._points_mm), np.array(self._weights))


def _curve(words: Words, state: ModalState, order: int, points_mm: FloatArray, weights: FloatArray) -> NurbsMove:
    """Curve with open uniform knots: ``order`` times the first, whole numbers, ``order`` times the last."""
    spans = len(points_mm) - order + 1
    knots = np.concatenate([np.zeros(order - 1), np.arange(spans + 1.0), np.full(order - 1, float(spans))])
    return NurbsMove(order - 1, knots, points_mm, weights, words.line.number, state.feed_mm_s, state.mode)


def _check_plane(words: Words, state: ModalState, code: str) -> None:
    if state.plane is not Plane.XY:
        raise words.error(f"{code} works in the XY plane only (G17)")
    if words.has("z"):
        raise words.error(f"{code} has no motion in Z", "z")
