"""Method ``thesis``: the formulation of the dual-windowing thesis (sections 3.4 to 3.6), to be compared with.

A linear programme in q = v^2 (integral of q, pseudo-jerk, limits derived from the drives), its square root fitted by a
spline in v(s), then a nonlinear programme in v(s) (integral of v, control signal and tracking error) by SQP, by the
interior point where SQP fails, and the linear programme's own answer where both do. What is added to the thesis: the
switch is automatic, elements of constant jerk next to rest, and a check between the evaluation points that lowers the
limits where they are exceeded and solves again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import lsqr

from feedopt_core.arrays import FloatArray
from feedopt_core.constraints.standstill import rest_scale_limit
from feedopt_core.constraints.stopping_distance import longest_stop_mm
from feedopt_core.constraints.utilisation import limit_ratios
from feedopt_core.errors import SolverError
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.derived_limits import attainable_limits, braking_limits
from feedopt_core.machine.limits import KinematicLimits, MotionLimits
from feedopt_core.motion.profile import ElementKind, FeedProfile
from feedopt_core.planner.mesh import QuadraticSpline
from feedopt_core.planner.method import Window, WindowPlan
from feedopt_core.planner.thesis.program import (
    EndCondition,
    NonlinearProgram,
    ProgramSolution,
    SplineMatrices,
    linear_program,
)
from feedopt_core.planner.time_optimal.window_solve import POINTS, WindowSolve, window_knots

_PARTS = 2
"""Parts of a span in which v^2 is replaced by two quadratics each."""
_REPAIRS = 8
_ACCEPTED = 1.0005
_START_ROOM = 1.01
"""Factor on the limits at a start in motion: its state cannot be chosen any more."""
_SQP_ITERATIONS = 15
_SQP_REPAIR_ITERATIONS = 5


@dataclass(frozen=True)
class ThesisMethod:
    """The thesis' own optimisation of one window.

    Attributes:
        limits: of the axes, their drives and the feed; of the nonlinear programme.
        derived: kinematic limits that keep those of the drives in the worst case; of the linear programme.
        knot_spacing_mm: largest spacing of the knots.
    """

    limits: MotionLimits
    derived: KinematicLimits
    knot_spacing_mm: float
    name: str = "thesis"
    whole_path: bool = False

    @property
    def stopping_mm(self) -> float:
        """See :class:`~feedopt_core.planner.method.PlanningMethod`."""
        return longest_stop_mm(braking_limits(self.limits))

    def plan(self, toolpath: Toolpath, window: Window) -> WindowPlan:
        """See :class:`~feedopt_core.planner.method.PlanningMethod`. Raises SolverError."""
        knots = window_knots(attainable_limits(self.limits), toolpath, window, self.knot_spacing_mm)
        solve = _ThesisWindow(self, toolpath, window, knots)
        try:
            return solve.nonlinear()
        except SolverError:
            return solve.linear()


class _ThesisWindow:
    """One window while it is being solved."""

    def __init__(self, method: ThesisMethod, toolpath: Toolpath, window: Window, knots: FloatArray) -> None:
        self._method, self._toolpath, self._window = method, toolpath, window
        # Mesh, evaluation points and factors on the limits are those of the other methods.
        self._mesh = WindowSolve(method.limits, toolpath, window, knots)
        self._matrices = SplineMatrices(self._mesh.spline, POINTS)
        if window.start is not None:
            self._mesh.scale[0, 0] = _START_ROOM

    def nonlinear(self) -> WindowPlan:
        """The nonlinear programme. Raises SolverError."""
        mesh = self._mesh
        program = NonlinearProgram(self._matrices, mesh.geometry, self._method.limits, self._ends(0.5))
        guess, iterations, worst = self._guess(), 0, np.inf
        for repair in range(_REPAIRS):
            sqp_iterations = _SQP_REPAIR_ITERATIONS if repair else _SQP_ITERATIONS
            solution = program.solve(guess, mesh.scale, self._ends(0.5), sqp_iterations)
            iterations += solution.iterations
            profile = self._profile(solution.control_points)
            excess = self._excess(profile)
            worst = float(np.max(excess))
            if worst <= _ACCEPTED:
                return _window_plan(profile, solution, iterations)
            mesh.tighten(excess)
            guess = solution.control_points
        raise SolverError(f"{worst:.5f} times a limit between the evaluation points after {_REPAIRS} repairs")

    def linear(self) -> WindowPlan:
        """The answer of the linear programme. Raises SolverError."""
        mesh, iterations, worst = self._mesh, 0, np.inf
        for _ in range(_REPAIRS):
            solution = self._linear_solution()
            iterations += solution.iterations
            profile = mesh.profile(solution.control_points)
            excess = mesh.limit_ratios(profile)
            worst = float(np.max(excess))
            if worst <= _ACCEPTED:
                return _window_plan(profile, solution, iterations)
            mesh.tighten(excess)
        raise SolverError(f"{worst:.5f} times a limit between the evaluation points after {_REPAIRS} repairs")

    def _linear_solution(self) -> ProgramSolution:
        mesh = self._mesh
        return linear_program(self._matrices, mesh.geometry, self._method.derived, mesh.scale, self._ends(1.0))

    def _guess(self) -> FloatArray:
        """Control points of v: the linear programme's answer, or the stop committed before where that has none."""
        try:
            v = np.sqrt(np.maximum(self._matrices.value @ self._linear_solution().control_points, 0.0))
        except SolverError:
            if self._window.guess is None:
                raise
            v = _feed_of(self._window.guess, self._mesh.points_mm.ravel())
        return np.asarray(lsqr(self._matrices.value, v, atol=1e-10, btol=1e-10)[0], dtype=np.float64)

    def _ends(self, power: float) -> tuple[EndCondition, EndCondition]:
        """Ends of q (power 1) or of v = q^(1/2)."""
        mesh, state = self._mesh, self._window.start
        widths, knots = mesh.spline.widths_mm, mesh.knots
        end = self._rest(self._window.end_mm, -1, float(knots[-1] - knots[-2]), float(widths[-1]), power)
        if state is None:
            return self._rest(self._window.start_mm, +1, float(knots[1] - knots[0]), float(widths[0]), power), end
        value = state.q_mm2_s2**power
        slope = power * state.dq_ds_mm_s2 * value / state.q_mm2_s2
        return EndCondition(1.0, value, (value, value + 0.5 * float(widths[0]) * slope)), end

    def _rest(self, s_mm: float, sign: int, width_mm: float, span_mm: float, power: float) -> EndCondition:
        scale = float(self._mesh.scale[0, 0] if sign > 0 else self._mesh.scale[-1, -1])
        p = rest_scale_limit(self._toolpath, self._method.limits, s_mm, width_mm, sign, scale)
        outer = (p * width_mm ** (4.0 / 3.0)) ** power
        return EndCondition(1.0 + power * 2.0 / 3.0 * span_mm / width_mm, outer)

    def _profile(self, control_points: FloatArray) -> FeedProfile:
        """Profile of v(s): its square by quadratics, the elements at rest next to it."""
        mesh = self._mesh
        s_mm, q, slope, bend = squared(mesh.spline, control_points)
        head = self._window.start is None
        q_ends = control_points[[0, -1]] ** 2
        widths = np.diff(mesh.knots)[[0, -1]]
        jerk = 2.0 / 9.0 * q_ends**1.5 / widths**2
        end_slope = 4.0 / 3.0 * q_ends[1] / widths[1]
        kinds = [ElementKind.REST_START] * head + [ElementKind.QUADRATIC] * len(q) + [ElementKind.REST_END]
        rows = np.array([q, slope, bend, np.zeros(len(q))])
        rows = np.column_stack([rows, [q_ends[1], -end_slope, 0.0, jerk[1]]])
        if head:
            rows = np.column_stack([[0.0, 0.0, 0.0, jerk[0]], rows])
        ends = np.concatenate([mesh.knots[:1] if head else [], s_mm, mesh.knots[-1:]])
        return FeedProfile(np.array(kinds, dtype=np.int64), ends, *rows)

    def _excess(self, profile: FeedProfile) -> FloatArray:
        """Largest ratio to any limit on each span of the mesh, shape (m,)."""
        first = 1 if self._window.start is None else 0
        ratios = limit_ratios(self._toolpath, self._method.limits, profile[first : len(profile.kind) - 1])
        return np.asarray(np.max(ratios.reshape(len(self._mesh.spline.widths_mm), -1), axis=1))


def _window_plan(profile: FeedProfile, solution: ProgramSolution, iterations: int) -> WindowPlan:
    return WindowPlan(profile, solution.solver, len(solution.control_points), solution.rows, iterations)


def squared(
    spline: QuadraticSpline, control_points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """q = v^2 of a quadratic spline v(s) by quadratics with continuous dq/ds.

    On each part of a span two quadratics take the exact q and dq/ds at its ends; between them q is off by the third
    power of the part's length.

    Returns:
        Ends of the quadratics, shape (n + 1,); q, dq/ds and d2q/ds2 at the start of each, shape (n,).
    """
    v0, v1, v2 = (values[:, None] for values in spline.start_of_spans(control_points))
    part_mm = spline.widths_mm[:, None] / _PARTS
    x = part_mm * np.arange(_PARTS + 1)
    v, slope = v0 + (v1 + 0.5 * v2 * x) * x, v1 + v2 * x
    q, dq = v**2, 2.0 * v * slope
    # Continuous in value and slope at the middle: the two second derivatives follow from those at the ends.
    rise = (q[:, 1:] - q[:, :-1]) / part_mm - 0.5 * (dq[:, 1:] + dq[:, :-1])
    change = dq[:, 1:] - dq[:, :-1]
    first, second = (change + 4.0 * rise) / part_mm, (change - 4.0 * rise) / part_mm
    half = 0.5 * part_mm
    middle_q = q[:, :-1] + (dq[:, :-1] + 0.5 * first * half) * half
    middle_dq = dq[:, :-1] + first * half
    starts = spline.knots_mm[:-1, None] + x[:, :-1]
    return (
        np.append(np.stack([starts, starts + half], axis=2).ravel(), spline.knots_mm[-1]),
        np.stack([q[:, :-1], middle_q], axis=2).ravel(),
        np.stack([dq[:, :-1], middle_dq], axis=2).ravel(),
        np.stack([first, second], axis=2).ravel(),
    )


def _feed_of(profile: FeedProfile, s_mm: FloatArray) -> FloatArray:
    """Feedrate of a profile, and behind its end a little of it."""
    inside = s_mm < profile.s_mm[-1]
    v = np.full(len(s_mm), 1.0)
    v[inside] = np.maximum(np.sqrt(profile.q_at(s_mm[inside])[0]), 1.0)
    return v
