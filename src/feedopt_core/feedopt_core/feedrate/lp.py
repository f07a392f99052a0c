"""Method ``lp``: velocity, acceleration and jerk limits of every axis, minimum time, quadratic B-spline in q.

The limits are those of the thesis' LP (section 3.4). Its pseudo-jerk, which bounds sqrt(q) by the solution without jerk
limit once and for all, is replaced by the jerk limit's own tangent, set anew in every iteration; its objective
(integral of q) by the motion time. docs/decisions/ holds the reasons.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import SolverError
from feedopt_core.feedrate.mesh import KnotSpacing, QuadraticSpline, graded_knots
from feedopt_core.feedrate.method import Window, WindowPlan
from feedopt_core.feedrate.profile import ElementKind, FeedProfile
from feedopt_core.limits.axis_limits import KinematicLimits, LimitRows, axis_geometry, span_points
from feedopt_core.limits.excess import limit_ratios
from feedopt_core.limits.rest import rest_length_mm, rest_scale_limit
from feedopt_core.path.toolpath import Toolpath
from feedopt_core.solvers.banded_interior_point import FixedStart, RestEnd, TimeProblem, local_products, minimise_time

_POINTS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
_BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0
_MARGIN = 5e-4
_RELAXED_MM = 20.0
_REPAIRS = 8
_ACCEPTED = 1.00001
_SPLIT_ABOVE = 1.01
_REFINEMENTS = (1.0, 3.0)
"""Parts of the knot spacing to try, the next one where a window has no plan on the mesh before."""


@dataclass(frozen=True)
class KinematicMethod:
    """Minimum time under kinematic limits on one window.

    Attributes:
        limits: of the axes and the feed.
        knot_spacing_mm: largest spacing of the knots of q(s).
    """

    limits: KinematicLimits
    knot_spacing_mm: float
    name: str = "lp"

    def plan(self, toolpath: Toolpath, window: Window) -> WindowPlan:
        """See :class:`~feedopt_core.feedrate.method.PlanningMethod`. Raises SolverError."""
        failure: SolverError | None = None
        for refinement in _REFINEMENTS:
            try:
                return self._plan(toolpath, window, self.knot_spacing_mm / refinement)
            except SolverError as error:
                failure = error
        raise SolverError(f"window {window.start_mm:.3f} to {window.end_mm:.3f} mm: {failure}") from failure

    def _plan(self, toolpath: Toolpath, window: Window, knot_spacing_mm: float) -> WindowPlan:
        knots = _knots(self.limits, toolpath, window, knot_spacing_mm)
        solve = _WindowSolve(self.limits, toolpath, window, knots)
        iterations = 0
        worst = np.inf
        for _ in range(_REPAIRS):
            control_points, count, rows = solve.minimum_time()
            iterations += count
            profile = solve.profile(control_points)
            excess = limit_ratios(toolpath, self.limits, profile[solve.spline_elements])
            worst = float(np.max(excess))
            if worst <= _ACCEPTED:
                return WindowPlan(profile, self.name, len(control_points), rows, iterations)
            if worst > _SPLIT_ABOVE:
                solve = _WindowSolve(self.limits, toolpath, window, solve.split_knots(excess))
            else:
                solve.tighten(excess)
        raise SolverError(f"{worst:.5f} times a limit between the knots after {_REPAIRS} repairs")


def _knots(limits: KinematicLimits, toolpath: Toolpath, window: Window, spacing_mm: float) -> FloatArray:
    start_rest = rest_length_mm(toolpath, limits, window.start_mm, +1) if window.start is None else None
    end_rest = rest_length_mm(toolpath, limits, window.end_mm, -1)
    return graded_knots(
        window.start_mm,
        window.end_mm,
        KnotSpacing(toolpath, spacing_mm),
        rest_start_mm=None if start_rest is None else min(start_rest, spacing_mm),
        rest_end_mm=min(end_rest, spacing_mm),
    )


class _WindowSolve:
    """One window while it is being solved: mesh, rows, end conditions."""

    def __init__(self, limits: KinematicLimits, toolpath: Toolpath, window: Window, knots: FloatArray) -> None:
        self.limits, self.toolpath, self.window, self.knots = limits, toolpath, window, knots
        first = 1 if window.start is None else 0
        self.spline_elements = slice(first, len(self.knots) - 2)
        self.spline = QuadraticSpline.on(self.knots[first:-1])
        self.points_mm = span_points(self.spline.knots_mm, _POINTS)
        self.geometry = axis_geometry(toolpath, limits.axis_matrix, self.points_mm)
        self.scale = np.broadcast_to(self._margin(self.points_mm), self.points_mm.shape).copy()

    def _margin(self, s_mm: FloatArray) -> FloatArray:
        """Factor on the limits: what a window leaves at its end, the next one finds as room at its start."""
        distance = s_mm - self.window.start_mm
        ramp = 1.0 if self.window.start is None else np.minimum(distance / _RELAXED_MM, 1.0)
        return np.asarray(1.0 - _MARGIN * ramp)

    def tighten(self, excess: FloatArray) -> None:
        """Lower the limits where they were exceeded between the points, by a little more than that; shape (m,)."""
        spread = excess.copy()
        spread[1:] = np.maximum(spread[1:], excess[:-1])
        spread[:-1] = np.maximum(spread[:-1], excess[1:])
        self.scale /= np.maximum(1.0, 1.0 + 1.2 * (spread - 1.0))

    def split_knots(self, excess: FloatArray) -> FloatArray:
        """Knots with two more in each span where a limit was exceeded noticeably; excess has shape (m,)."""
        spans = np.flatnonzero(excess > 0.5 * (1.0 + _SPLIT_ABOVE))
        knots = self.spline.knots_mm
        widths = np.diff(knots)[spans]
        return np.unique(np.concatenate([self.knots, knots[spans] + widths / 3.0, knots[spans] + widths * 2.0 / 3.0]))

    def minimum_time(self) -> tuple[FloatArray, int, int]:
        basis = self.spline.basis(_POINTS)
        rows = LimitRows(self.geometry, self.limits, basis, self.scale)
        if self.window.start is not None:
            rows.release_start_state()
        start, end = self._start(), self._end()
        problem = TimeProblem(
            basis=rows.basis,
            weights_mm=_BOOLE[:, None] * self.spline.widths_mm,
            rows=lambda c: rows.tangent_at(local_products(rows.basis, c)),
            start=start,
            end=end,
        )
        failure: SolverError | None = None
        for guess in self._guesses(rows, start, end):
            try:
                solution = minimise_time(problem, guess)
            except SolverError as error:
                failure = error
                continue
            return solution.control_points, solution.iterations, solution.row_count
        raise SolverError(str(failure)) from failure

    def _start(self) -> FixedStart | RestEnd:
        state, h = self.window.start, float(self.spline.widths_mm[0])
        if state is not None:
            return FixedStart(state.q_mm2_s2, state.q_mm2_s2 + 0.5 * h * state.dq_ds_mm_s2)
        return self._rest_end(self.window.start_mm, float(self.knots[1] - self.knots[0]), h, +1)

    def _end(self) -> RestEnd:
        width = float(self.knots[-1] - self.knots[-2])
        return self._rest_end(self.window.end_mm, width, float(self.spline.widths_mm[-1]), -1)

    def _rest_end(self, s_rest_mm: float, width_mm: float, span_mm: float, sign: int) -> RestEnd:
        scale = float(self.scale[0, 0] if sign > 0 else self.scale[-1, -1])
        p = rest_scale_limit(self.toolpath, self.limits, s_rest_mm, width_mm, sign, scale)
        return RestEnd(ratio=1.0 + 2.0 / 3.0 * span_mm / width_mm, outer_limit=p * float(np.cbrt(width_mm)) ** 4)

    def _guesses(self, rows: LimitRows, start: FixedStart | RestEnd, end: RestEnd) -> Iterator[FloatArray]:
        """Starting points below every limit known beforehand; first from the stop committed before, if there is one."""
        knots = self.spline.knots_mm
        s = np.concatenate([knots[:1], (knots[:-1] + knots[1:]) / 2.0, knots[-1:]])
        ceiling = np.concatenate([rows.q_limit[0, :1], np.min(rows.q_limit, axis=0), rows.q_limit[-1, -1:]])
        for rest, at_mm in ((start, self.window.start_mm), (end, self.window.end_mm)):
            if isinstance(rest, RestEnd):
                edge = knots[0] if rest is start else knots[-1]
                p = rest.outer_limit / abs(edge - at_mm) ** (4.0 / 3.0)
                ceiling = np.minimum(ceiling, p * np.abs(s - at_mm) ** (4.0 / 3.0))
        low = 0.3 * ceiling
        if self.window.guess is not None:
            before = self.window.guess
            inside = (s >= before.s_mm[0]) & (s <= before.s_mm[-1])
            warm = low.copy()
            warm[inside] = np.maximum(warm[inside], 0.95 * before.q_at(s[inside])[0])
            yield warm
        yield low
        yield 0.02 * ceiling

    def profile(self, control_points: FloatArray) -> FeedProfile:
        q, slope, bend = self.spline.start_of_spans(control_points)
        count = len(q)
        end_slope = 2.0 * float(control_points[-1] - control_points[-2]) / float(self.spline.widths_mm[-1])
        end_jerk = _rest_jerk(float(control_points[-1]), float(self.knots[-1] - self.knots[-2]))
        kind = [*[ElementKind.QUADRATIC] * count, ElementKind.REST_END]
        elements = np.array([[*q, control_points[-1]], [*slope, end_slope], [*bend, 0.0], [*np.zeros(count), end_jerk]])
        if self.window.start is None:
            start_jerk = _rest_jerk(float(control_points[0]), float(self.knots[1] - self.knots[0]))
            kind.insert(0, ElementKind.REST_START)
            elements = np.column_stack([[0.0, 0.0, 0.0, start_jerk], elements])
        return FeedProfile(np.array(kind, dtype=np.int64), self.knots, *elements)


def _rest_jerk(q_mm2_s2: float, width_mm: float) -> float:
    """Jerk of the element at rest that reaches q over its width, mm/s^3."""
    return float(2.0 / 9.0 * q_mm2_s2**1.5 / width_mm**2)
