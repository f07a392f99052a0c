"""One window while it is solved: mesh, rows, end conditions, first guesses, and repairs between the points."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from feedopt_core.arrays import BoolArray, FloatArray
from feedopt_core.constraints.axis_geometry import AxisGeometry, axis_geometry, span_points, steady_q_limit
from feedopt_core.constraints.limit_rows import drop_repeated, limit_rows, release_start_state
from feedopt_core.constraints.standstill import standstill_length_mm, standstill_scale_limit
from feedopt_core.constraints.utilisation import FineGrid
from feedopt_core.errors import SolverError
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.derived_limits import attainable_limits
from feedopt_core.machine.limits import KinematicLimits, MotionLimits
from feedopt_core.motion.profile import ElementKind, FeedProfile
from feedopt_core.planner.mesh import KnotSpacing, QuadraticSpline, graded_knots
from feedopt_core.planner.method import Window
from feedopt_core.solver.banded_interior_point import (
    FixedStart,
    Restart,
    StandstillEnd,
    TimeProblem,
    TimeSolution,
    minimise_time,
)

POINTS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
"""Points of a span, as parts of its width, at which the limits hold and the motion time is integrated."""
_BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0
_SIMPSON = np.array([1.0, 0.0, 4.0, 0.0, 1.0]) / 6.0
"""Quadrature weights of the points. The full quadrature (Boole) uses all five; where the motion hardly changes over a
span, the reduced one (Simpson) leaves out the second and the fourth."""
_STRAIGHT, _FULL = 0.1, 0.6
"""A span may use the reduced quadrature if it is shorter than the first part of the length over which the path bends,
and longer than the second part of the widest span."""
_AROUND = 8
"""Number of neighbouring spans, on each side of a span with the full quadrature, that also use the full quadrature."""
_MARGIN = 5e-4
_RELAXED_MM = 20.0
_LOW, _VERY_LOW = 0.7, 0.02
"""Parts of the estimated largest q at which the optimisation starts: first attempt, second attempt."""
_RAMP = 0.5
"""Part of the acceleration and jerk limits with which the first guess speeds up from a slow place."""


def window_knots(limits: KinematicLimits, toolpath: Toolpath, window: Window, spacing_mm: float) -> FloatArray:
    """Knots of a window with its standstill elements, shape (n,), mm; all limits must be finite."""
    start_length_mm = standstill_length_mm(toolpath, limits, window.start_mm, +1) if window.start is None else None
    end_length_mm = standstill_length_mm(toolpath, limits, window.end_mm, -1)
    return graded_knots(
        window.start_mm,
        window.end_mm,
        KnotSpacing(toolpath, spacing_mm),
        start_element_mm=None if start_length_mm is None else min(start_length_mm, spacing_mm),
        end_element_mm=min(end_length_mm, spacing_mm),
        spare_end=window.spare_end,
    )


def continued_knots(knots: FloatArray, guess: FeedProfile, joints_mm: FloatArray) -> FloatArray:
    """Knots of a window, replaced by those of the guess over the first half of the guess.

    The guess may have had spans split, and then its start state may have a continuation on its own knots only. Beyond
    the last knot of the guess, knots that are too close to it are left out, except joints.
    """
    known = guess.s_mm[guess.s_mm <= 0.5 * (guess.s_mm[0] + guess.s_mm[-1])]
    if len(known) < 2 or known[-1] >= knots[-2]:
        return knots
    behind = knots[np.append(knots[:-1] > known[-1] + 0.3 * (known[-1] - known[-2]), True)]
    return np.concatenate([known, joints_mm[(joints_mm > known[-1]) & (joints_mm < behind[0])], behind])


class WindowSolve:
    """Mesh, rows and end conditions of one window on given knots."""

    def __init__(self, limits: MotionLimits, toolpath: Toolpath, window: Window, knots: FloatArray) -> None:
        self.limits, self.toolpath, self.window, self.knots = limits, toolpath, window, knots
        first = 1 if window.start is None else 0
        self.spline_elements = slice(first, len(self.knots) - 2)
        self.spline = QuadraticSpline.on(self.knots[first:-1])
        self.points_mm = span_points(self.spline.knots_mm, POINTS)
        self.geometry = axis_geometry(toolpath, limits.kinematic.axis_matrix, self.points_mm)
        self._fine: FineGrid | None = None
        self.scale = np.broadcast_to(self._margin(self.points_mm), self.points_mm.shape).copy()
        self.weights_mm = _point_weights(self.geometry, limits.kinematic.axis_matrix, self.spline.widths_mm)

    def _margin(self, s_mm: FloatArray) -> FloatArray:
        """Factor on the limits. It is 1 at a start in motion, so the state left by the last window has slack there."""
        distance = s_mm - self.window.start_mm
        ramp = 1.0 if self.window.start is None else np.minimum(distance / _RELAXED_MM, 1.0)
        return np.asarray(1.0 - _MARGIN * ramp)

    def tighten(self, utilisation: FloatArray) -> None:
        """Lower the limits around spans whose utilisation, shape (m,), is above 1, by a little more than needed."""
        spread = utilisation.copy()
        spread[1:] = np.maximum(spread[1:], utilisation[:-1])
        spread[:-1] = np.maximum(spread[:-1], utilisation[1:])
        self.scale /= np.maximum(1.0, 1.0 + 1.2 * (spread - 1.0))

    def split(self, spans: BoolArray) -> WindowSolve:
        """The same window with two more knots in each of the marked spans, shape (m,)."""
        knots, widths = self.spline.knots_mm[:-1][spans], self.spline.widths_mm[spans]
        split = np.unique(np.concatenate([self.knots, knots + widths / 3.0, knots + widths * 2.0 / 3.0]))
        return WindowSolve(self.limits, self.toolpath, self.window, split)

    def minimum_time(
        self, before: Restart | None = None, guess: FeedProfile | None = None, *, cautious: bool = False
    ) -> TimeSolution:
        """Least motion time on this mesh.

        Args:
            before: iterate to restart from, after the limits were lowered a little.
            guess: profile to start from; it may cover only a part of the window.
            cautious: see :func:`minimise_time`.

        Raises:
            SolverError: no solution was found from the restart, or from any first guess.
        """
        rows = limit_rows(self.geometry, self.limits, self.spline.basis(POINTS), self.weights_mm, self.scale)
        drop_repeated(rows)
        if self.window.start is not None:
            release_start_state(rows)
        problem = TimeProblem(rows, self._start(), self._end())
        if before is not None:
            return minimise_time(problem, before, cautious=cautious)
        failure: SolverError | None = None
        for initial in self._guesses(problem, guess):
            try:
                return minimise_time(problem, initial, cautious=cautious)
            except SolverError as error:
                failure = error
        raise SolverError(str(failure)) from failure

    def _start(self) -> FixedStart | StandstillEnd:
        state, h = self.window.start, float(self.spline.widths_mm[0])
        if state is not None:
            return FixedStart(state.q_mm2_s2, state.q_mm2_s2 + 0.5 * h * state.dq_ds_mm_s2)
        return self._standstill_end(self.window.start_mm, float(self.knots[1] - self.knots[0]), h, +1)

    def _end(self) -> StandstillEnd:
        width = float(self.knots[-1] - self.knots[-2])
        return self._standstill_end(self.window.end_mm, width, float(self.spline.widths_mm[-1]), -1)

    def _standstill_end(self, s_standstill_mm: float, width_mm: float, span_mm: float, sign: int) -> StandstillEnd:
        scale = float(self.scale[0, 0] if sign > 0 else self.scale[-1, -1])
        p = standstill_scale_limit(self.toolpath, self.limits, s_standstill_mm, width_mm, sign, scale)
        return StandstillEnd(ratio=1.0 + 2.0 / 3.0 * span_mm / width_mm, outer_limit=p * float(np.cbrt(width_mm)) ** 4)

    def _guesses(self, problem: TimeProblem, guess: FeedProfile | None) -> Iterator[FloatArray]:
        """First guesses of the control points, the best first; those not made from ``guess`` are below the estimate."""
        s, ceiling = self._ceiling(problem)
        low = _LOW * ceiling
        if guess is not None:
            inside = (s >= guess.s_mm[0]) & (s <= guess.s_mm[-1])
            warm = low.copy()
            warm[inside] = np.maximum(warm[inside], 0.95 * guess.q_at(s[inside])[0])
            yield warm
        yield low
        yield _VERY_LOW * ceiling

    def _ceiling(self, problem: TimeProblem) -> tuple[FloatArray, FloatArray]:
        """Arc lengths of the control points, shape (m + 2,), and an estimate of the largest q there.

        Each place allows at most its q at constant feedrate. Near a slow place, such as a sharp corner or a standstill,
        q is at most what a part of the acceleration and jerk limits reaches from there: it grows by 2 a ds, and as
        s^(4/3) from a standstill. Without this second bound the optimisation does not converge in windows whose q spans
        five decades.
        """
        knots, reach = self.spline.knots_mm, attainable_limits(self.limits)
        s = np.concatenate([knots[:1], (knots[:-1] + knots[1:]) / 2.0, knots[-1:]])
        bound = steady_q_limit(self.geometry, reach) * self.scale**2
        ceiling = np.concatenate([bound[0, :1], np.min(bound, axis=0), bound[-1, -1:]])
        for condition, at_mm, edge in (
            (problem.start, self.window.start_mm, knots[0]),
            (problem.end, self.window.end_mm, knots[-1]),
        ):
            if isinstance(condition, StandstillEnd):
                p = condition.outer_limit / abs(edge - at_mm) ** (4.0 / 3.0)
                ceiling = np.minimum(ceiling, p * np.abs(s - at_mm) ** (4.0 / 3.0))
        acceleration = _RAMP * float(np.min(reach.acceleration_mm_s2))
        jerk = _RAMP * float(np.min(reach.jerk_mm_s3))
        ceiling = _with_slope(ceiling, s, 2.0 * acceleration)
        return s, _with_slope(ceiling**0.75, s, float(np.sqrt(4.5 * jerk))) ** (4.0 / 3.0)

    def limit_ratios(self, profile: FeedProfile) -> FloatArray:
        """Largest utilisation of a limit on each span, also between the points, shape (m,)."""
        if self._fine is None:
            self._fine = FineGrid(self.toolpath, self.limits.kinematic.axis_matrix, self.spline.knots_mm)
        return self._fine.limit_ratios(self.limits, profile[self.spline_elements])

    def dips(self, control_points: FloatArray) -> BoolArray:
        """Spans in which q falls to zero between the points, shape (m,). This can happen next to a very slow place."""
        q, slope, bend = self.spline.start_of_spans(control_points)
        lowest_mm = np.clip(-slope / np.where(bend > 0.0, bend, np.inf), 0.0, self.spline.widths_mm)
        lowest = q + (slope + 0.5 * bend * lowest_mm) * lowest_mm
        return np.asarray(lowest <= 0.0)

    def profile(self, control_points: FloatArray) -> FeedProfile:
        """Feed profile of control points, shape (m + 2,), with the standstill elements."""
        q, slope, bend = self.spline.start_of_spans(control_points)
        count = len(q)
        end_slope = 2.0 * float(control_points[-1] - control_points[-2]) / float(self.spline.widths_mm[-1])
        end_jerk = _standstill_jerk(float(control_points[-1]), float(self.knots[-1] - self.knots[-2]))
        kind = [*[ElementKind.QUADRATIC] * count, ElementKind.REST_END]
        elements = np.array([[*q, control_points[-1]], [*slope, end_slope], [*bend, 0.0], [*np.zeros(count), end_jerk]])
        if self.window.start is None:
            start_jerk = _standstill_jerk(float(control_points[0]), float(self.knots[1] - self.knots[0]))
            kind.insert(0, ElementKind.REST_START)
            elements = np.column_stack([[0.0, 0.0, 0.0, start_jerk], elements])
        return FeedProfile(np.array(kind, dtype=np.int64), self.knots, *elements)


def _point_weights(geometry: AxisGeometry, axis_matrix: FloatArray, widths_mm: FloatArray) -> FloatArray:
    """Quadrature weights of the points, shape (p, m), mm; 0 at the points that the reduced quadrature leaves out."""
    # Computed like Toolpath.bend_length_mm, but from the derivatives of the axis positions.
    size = float(np.linalg.norm(axis_matrix, 2))
    curvature, change = (np.sqrt(np.sum(g**2, axis=0)) / size for g in (geometry.g2, geometry.g3))
    with np.errstate(divide="ignore"):
        bend_mm = 1.0 / np.maximum(curvature, np.sqrt(change))
    bent = (widths_mm > _STRAIGHT * np.min(bend_mm, axis=0)) | (widths_mm < _FULL * np.max(widths_mm))
    # Next to a sharp corner q changes by decades over a few spans.
    near = np.convolve(bent, np.ones(2 * _AROUND + 1))[_AROUND : _AROUND + len(bent)] > 0.5
    return np.asarray(np.where(near, _BOOLE[:, None], _SIMPSON[:, None]) * widths_mm)


def _with_slope(values: FloatArray, s_mm: FloatArray, slope: float) -> FloatArray:
    """Largest function that is nowhere above ``values`` and changes by at most ``slope`` per mm, shape (n,)."""
    ramp = slope * s_mm
    forward = ramp + np.minimum.accumulate(values - ramp)
    return np.asarray(np.minimum.accumulate((forward + ramp)[::-1])[::-1] - ramp)


def _standstill_jerk(q_mm2_s2: float, width_mm: float) -> float:
    """Jerk of a standstill element that reaches q over its width, mm/s^3."""
    return float(2.0 / 9.0 * q_mm2_s2**1.5 / width_mm**2)
