"""G2 and G3: from the words of a line to an arc through both its ends.

Tolerances are LinuxCNC's (``interp_internal.hh``): the radii at both ends may differ a little, because programs are
printed with few digits. A circle has one radius, so the centre is moved along the chord until both are the same; where
that would shift the path (almost a full circle), the arc becomes the spiral of LinuxCNC, as a NURBS.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.programs.gcode.modal_state import MM_PER_INCH, ModalState
from feedopt_core.programs.gcode.words import Words
from feedopt_core.programs.moves import ArcMove, NurbsMove

MAX_TURNS = 1000
_SPIRAL_MM = 0.02 * math.sqrt(2.0)
_SPIRAL_INCH_MM = 0.002 * math.sqrt(2.0) * MM_PER_INCH
_SPIRAL_RATIO = 1e-3
_RADIUS_MM = 5e-5 * MM_PER_INCH
_FULL_CIRCLE_RAD = 1e-6
"""An arc that turns less than this is meant as a full circle."""
_ROUNDING_RATIO = 1e-12
_AXES = "xyz"
_CENTRES = "ijk"


@dataclass(frozen=True)
class _Circle:
    """Arc in its plane: centre relative to the start, chord from start to end, shape (2,) each, both in mm."""

    centre: FloatArray
    chord: FloatArray
    clockwise: bool

    def sweep_rad(self) -> float:
        """Angle from start to end in the direction of the arc, in [0, 2 pi)."""
        a, b = -self.centre, self.chord - self.centre
        angle = math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])
        return (-angle if self.clockwise else angle) % (2.0 * math.pi)


def read_arc(words: Words, state: ModalState, end_mm: FloatArray, clockwise: bool) -> tuple[ArcMove | NurbsMove, float]:
    """Arc from the current position to its end, at the modal feed, and its length in mm.

    Raises:
        ToolpathError: no or contradicting centre and radius, or an end that is not on the circle.
    """
    first, second, normal = state.plane.value
    chord = end_mm[[first, second]] - state.position_mm[[first, second]]
    turns = _turns(words)
    by_radius = words.has("r")
    centre = _centre_by_radius(words, state, chord, clockwise) if by_radius else _centre_by_offset(words, state)
    circle = _Circle(centre, chord, clockwise)
    mismatch_mm = _check_radii(words, circle, state)
    sweep = circle.sweep_rad()
    if sweep <= _FULL_CIRCLE_RAD:
        sweep += 2.0 * math.pi
    rise = float(end_mm[normal] - state.position_mm[normal])
    radius_mm = math.hypot(*centre)
    if abs(mismatch_mm) > _ROUNDING_RATIO * (1.0 + radius_mm):
        shift_mm = abs(mismatch_mm) * (2.0 * radius_mm + mismatch_mm) / (2.0 * max(math.hypot(*chord), 1e-12))
        if (turns == 1 and sweep <= math.pi and shift_mm <= 0.5 * radius_mm) or shift_mm <= 2.0 * abs(mismatch_mm):
            circle = _Circle(_on_bisector(circle), chord, clockwise)
            sweep = circle.sweep_rad()
        else:
            sweep += 2.0 * math.pi * (turns - 1)
            length_mm = math.hypot(sweep * (radius_mm + 0.5 * mismatch_mm), rise)
            return _spiral(words, state, end_mm, circle, sweep), length_mm
    sweep += 2.0 * math.pi * (turns - 1)
    centre_mm, axis = state.position_mm.copy(), np.zeros(3)
    centre_mm[[first, second]] += circle.centre
    axis[normal] = -1.0 if clockwise else 1.0
    arc = ArcMove(
        state.position_mm.copy(),
        end_mm,
        centre_mm,
        axis,
        sweep,
        -rise if clockwise else rise,
        words.line.number,
        state.feed_mm_s,
        state.mode,
    )
    return arc, math.hypot(sweep * math.hypot(*circle.centre), rise)


def _turns(words: Words) -> int:
    turns = words.take("p")
    if turns is None:
        return 1
    if abs(turns - round(turns)) > 1e-3 or not 1 <= turns <= MAX_TURNS:
        raise words.error(f"P with an arc counts its turns: a whole number from 1 to {MAX_TURNS}, not {turns:g}", "p")
    return round(turns)


def _centre_by_offset(words: Words, state: ModalState) -> FloatArray:
    """Centre relative to the start from two of I, J and K."""
    if not words.has("ijk"):
        raise words.error("an arc needs its centre (I J K) or its radius (R)")
    centre = np.empty(2)
    for slot, axis in enumerate(state.plane.value[:2]):
        value = words.take(_CENTRES[axis])
        if state.absolute_centres:
            if value is None:
                raise words.error(f"{_CENTRES[axis].upper()} is missing; centres are absolute (G90.1)", "ijk")
            centre[slot] = value * state.unit_mm + state.offset_mm[axis] - state.position_mm[axis]
        else:
            centre[slot] = 0.0 if value is None else value * state.unit_mm
    return centre


def _centre_by_radius(words: Words, state: ModalState, chord: FloatArray, clockwise: bool) -> FloatArray:
    """Centre relative to the start: R above zero for arcs up to a half circle, below for longer ones."""
    programmed = words.need("r", "an arc")
    radius_mm = abs(programmed) * state.unit_mm
    half_mm = 0.5 * math.hypot(*chord)
    if half_mm == 0.0:
        raise words.error("an arc with R that ends where it starts has no centre; use I J K for a full circle", "r")
    if half_mm - radius_mm > _RADIUS_MM:
        raise words.error(
            f"the radius {radius_mm:.6g} mm is too small: start and end are {2.0 * half_mm:.6g} mm apart", "r"
        )
    height_mm = math.sqrt(max(radius_mm - half_mm, 0.0) * (radius_mm + half_mm))
    left = np.array([-chord[1], chord[0]]) / (2.0 * half_mm)
    side = -1.0 if clockwise == (programmed > 0.0) else 1.0
    centre: FloatArray = 0.5 * chord + side * height_mm * left
    return centre


def _check_radii(words: Words, circle: _Circle, state: ModalState) -> float:
    """Radius at the end less radius at the start, mm."""
    start_mm, end_mm = math.hypot(*circle.centre), math.hypot(*(circle.chord - circle.centre))
    if min(start_mm, end_mm) < _RADIUS_MM:
        raise words.error(f"the radius of this arc is zero: {min(start_mm, end_mm):.3g} mm", "ijkr")
    spiral_mm = _SPIRAL_MM if state.unit_mm == 1.0 else _SPIRAL_INCH_MM
    mismatch_mm = abs(end_mm - start_mm)
    ratio = mismatch_mm / max(start_mm, end_mm)
    if mismatch_mm > 100.0 * spiral_mm or (ratio > _SPIRAL_RATIO and mismatch_mm > spiral_mm):
        raise words.error(
            f"the end is not on the circle: radius {start_mm:.6g} mm at the start, {end_mm:.6g} mm at the end; they "
            f"may differ by {spiral_mm:.3g} mm",
            "ijk",
        )
    return end_mm - start_mm


def _on_bisector(circle: _Circle) -> FloatArray:
    """Centre, moved along the chord until start and end have the same distance from it."""
    along = circle.chord / math.hypot(*circle.chord)
    height = circle.centre - along * float(circle.centre @ along)
    centre: FloatArray = 0.5 * circle.chord + height
    return centre


def _spiral(words: Words, state: ModalState, end_mm: FloatArray, circle: _Circle, sweep: float) -> NurbsMove:
    """Rational cubic whose radius goes from that of the start to that of the end.

    Each span of at most a quarter turn is the quadratic circle arc times a linear scale.
    """
    spans = math.ceil(sweep / (0.5 * math.pi) - 1e-9)
    half = 0.5 * sweep / spans
    direction = -1.0 if circle.clockwise else 1.0
    start_radius, end_radius = math.hypot(*circle.centre), math.hypot(*(circle.chord - circle.centre))
    start_angle = math.atan2(-circle.centre[1], -circle.centre[0])
    # Control points of the unit circle times their weights: at half steps, those between lie outside of it.
    angles = start_angle + direction * half * np.arange(2 * spans + 1)
    unit = np.column_stack([np.cos(angles), np.sin(angles)])
    scale = np.linspace(start_radius, end_radius, spans + 1)
    rise = np.linspace(0.0, 1.0, spans + 1)
    weight = math.cos(half)
    middle_weight = (1.0 + 2.0 * weight) / 3.0
    plane_points, heights, weights = [unit[0] * scale[0]], [0.0], [1.0]
    for span in range(spans):
        before, corner, behind = unit[2 * span : 2 * span + 3]
        low, high = scale[span], scale[span + 1]
        plane_points += [
            (2.0 * low * corner + high * before) / 3.0 / middle_weight,
            (low * behind + 2.0 * high * corner) / 3.0 / middle_weight,
            high * behind,
        ]
        low, high = rise[span], rise[span + 1]
        heights += [
            (2.0 * weight * low + high) / 3.0 / middle_weight,
            (low + 2.0 * weight * high) / 3.0 / middle_weight,
            high,
        ]
        weights += [middle_weight, middle_weight, 1.0]
    first, second, normal = state.plane.value
    points_mm = np.tile(state.position_mm, (len(weights), 1))
    points_mm[:, [first, second]] += circle.centre + np.array(plane_points)
    points_mm[:, normal] += np.array(heights) * (end_mm[normal] - state.position_mm[normal])
    points_mm[0], points_mm[-1] = state.position_mm, end_mm
    knots = np.concatenate([[0.0], np.repeat(np.arange(spans + 1.0), 3), [float(spans)]])
    return NurbsMove(3, knots, points_mm, np.array(weights), words.line.number, state.feed_mm_s, state.mode)
