"""Method ``thesis``: the formulation of the dual-windowing thesis (sections 3.4 to 3.6), for comparison.

1. A linear program in q = v^2: largest integral of q, with pseudo-jerk and with limits derived from the drives.
2. A spline v(s) is fitted to the square root of its solution.
3. A nonlinear program in v(s): largest integral of v under control signal and tracking error. It is solved by SQP, and
   by the interior point of Ipopt where SQP fails. Where both fail, the solution of the linear program is taken.

Three things are added to the thesis: the choice between the solvers is automatic; standstill elements of constant jerk;
and a check between the evaluation points that lowers the limits where they are violated and solves again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import lsqr

from feedopt_core.arrays import FloatArray
from feedopt_core.constraints.standstill import standstill_scale_limit
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
"""Parts of a span; in each of them two quadratics replace v^2."""
_REPAIRS = 8
_ACCEPTED = 1.0005
_START_FACTOR = 1.01
"""Factor on the limits at a start in motion, where the state is given and cannot be changed."""
_SQP_ITERATIONS = 15
_SQP_REPAIR_ITERATIONS = 5


@dataclass(frozen=True)
class ThesisMethod:
    """Optimisation of one window as in the thesis.

    Attributes:
        limits: limits of the axes, their drives and the feed, for the nonlinear program.
        derived: kinematic limits under which the drive limits hold in the worst case, for the linear program.
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
            self._mesh.scale[0, 0] = _START_FACTOR

    def nonlinear(self) -> WindowPlan:
        """Plan by the nonlinear program. Raises SolverError."""
        mesh = self._mesh
        program = NonlinearProgram(self._matrices, mesh.geometry, self._method.limits, self._ends(0.5))
        guess, iterations, worst = self._guess(), 0, np.inf
        for repair in range(_REPAIRS):
            sqp_iterations = _SQP_REPAIR_ITERATIONS if repair else _SQP_ITERATIONS
            solution = program.solve(guess, mesh.scale, self._ends(0.5), sqp_iterations)
            iterations += solution.iterations
            profile = self._profile(solution.control_points)
            utilisation = self._utilisation(profile)
            worst = float(np.max(utilisation))
            if worst <= _ACCEPTED:
                return _window_plan(profile, solution, iterations)
            mesh.tighten(utilisation)
            guess = solution.control_points
        raise SolverError(f"{worst:.5f} times a limit between the evaluation points after {_REPAIRS} repairs")

    def linear(self) -> WindowPlan:
        """Plan by the linear program. Raises SolverError."""
        mesh, iterations, worst = self._mesh, 0, np.inf
        for _ in range(_REPAIRS):
            solution = self._linear_solution()
            iterations += solution.iterations
            profile = mesh.profile(solution.control_points)
            utilisation = mesh.limit_ratios(profile)
            worst = float(np.max(utilisation))
            if worst <= _ACCEPTED:
                return _window_plan(profile, solution, iterations)
            mesh.tighten(utilisation)
        raise SolverError(f"{worst:.5f} times a limit between the evaluation points after {_REPAIRS} repairs")

    def _linear_solution(self) -> ProgramSolution:
        mesh = self._mesh
        return linear_program(self._matrices, mesh.geometry, self._method.derived, mesh.scale, self._ends(1.0))

    def _guess(self) -> FloatArray:
        """First guess for the control points of v: the linear program's solution, or else the window's own guess."""
        try:
            v = np.sqrt(np.maximum(self._matrices.value @ self._linear_solution().control_points, 0.0))
        except SolverError:
            if self._window.guess is None:
                raise
            v = _feed_of(self._window.guess, self._mesh.points_mm.ravel())
        return np.asarray(lsqr(self._matrices.value, v, atol=1e-10, btol=1e-10)[0], dtype=np.float64)

    def _ends(self, power: float) -> tuple[EndCondition, EndCondition]:
        """End conditions of q (power 1) or of v = q^(1/2) (power 1/2)."""
        mesh, state = self._mesh, self._window.start
        widths, knots = mesh.spline.widths_mm, mesh.knots
        end = self._standstill(self._window.end_mm, -1, float(knots[-1] - knots[-2]), float(widths[-1]), power)
        if state is None:
            return self._standstill(self._window.start_mm, +1, float(knots[1] - knots[0]), float(widths[0]), power), end
        value = state.q_mm2_s2**power
        slope = power * state.dq_ds_mm_s2 * value / state.q_mm2_s2
        return EndCondition(1.0, value, (value, value + 0.5 * float(widths[0]) * slope)), end

    def _standstill(self, s_mm: float, sign: int, width_mm: float, span_mm: float, power: float) -> EndCondition:
        scale = float(self._mesh.scale[0, 0] if sign > 0 else self._mesh.scale[-1, -1])
        p = standstill_scale_limit(self._toolpath, self._method.limits, s_mm, width_mm, sign, scale)
        outer = (p * width_mm ** (4.0 / 3.0)) ** power
        return EndCondition(1.0 + power * 2.0 / 3.0 * span_mm / width_mm, outer)

    def _profile(self, control_points: FloatArray) -> FeedProfile:
        """Feed profile of v(s): quadratics for v^2, with the standstill elements at the ends."""
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

    def _utilisation(self, profile: FeedProfile) -> FloatArray:
        """Largest ratio to any limit on each span of the mesh, shape (m,)."""
        first = 1 if self._window.start is None else 0
        ratios = limit_ratios(self._toolpath, self._method.limits, profile[first : len(profile.kind) - 1])
        return np.asarray(np.max(ratios.reshape(len(self._mesh.spline.widths_mm), -1), axis=1))


def _window_plan(profile: FeedProfile, solution: ProgramSolution, iterations: int) -> WindowPlan:
    return WindowPlan(profile, solution.solver, len(solution.control_points), solution.rows, iterations)


def squared(
    spline: QuadraticSpline, control_points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Approximation of q = v^2 by quadratics with continuous dq/ds, for a quadratic spline v(s).

    On each part of a span two quadratics have the exact q and dq/ds at its ends. Between the ends the error of q falls
    with the third power of the part's length.

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
    """Feedrate of a profile, at least 1 mm/s, and 1 mm/s beyond its end, shape (n,)."""
    inside = s_mm < profile.s_mm[-1]
    v = np.full(len(s_mm), 1.0)
    v[inside] = np.maximum(np.sqrt(profile.q_at(s_mm[inside])[0]), 1.0)
    return v
