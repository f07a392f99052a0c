"""Methods ``lp`` and ``lp_nlp``: minimum time on one window, quadratic B-spline in q.

``lp`` obeys velocity, acceleration and jerk limits within which the drives hold in the worst case, as the thesis' LP
does (section 3.4); ``lp_nlp`` obeys control signal and tracking error themselves (section 3.6). The pseudo-jerk of the
thesis is replaced by linearisations that are set anew in every iteration, its objective (integral of q) by the motion
time. docs/decisions/ holds the reasons.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.constraints.stopping_distance import longest_stop_mm
from feedopt_core.errors import SolverError
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.derived_limits import braking_limits, ramp_limits
from feedopt_core.machine.limits import MotionLimits
from feedopt_core.motion.profile import FeedProfile
from feedopt_core.planner.method import Window, WindowPlan
from feedopt_core.planner.time_optimal.window_solve import WindowSolve, continued_knots, window_knots
from feedopt_core.solver.banded_interior_point import Restart

_REPAIRS = 8
_ACCEPTED, _TOLERABLE = 1.0001, 1.0008
"""Ratio to a limit between the points that needs no repair, and one that the audit lets pass where no repair works."""
_SPLIT_ABOVE = 1.02
"""The same from which on knots are split; below it the limits are lowered there."""
_KNOTS_OF_A_STOP = 4.0
_REFINEMENT = 3.0
"""Part of the knot spacing that the robust solver works on."""


@dataclass(frozen=True)
class TimeOptimalMethod:
    """Minimum time under given limits on one window.

    Where the solver fails, a robust one follows: cautious steps on a finer mesh, started from the plan under
    ``safe_limits`` where there are such. That plan is taken where the robust solver fails too.

    Attributes:
        name: on the command line and in every chunk.
        solver: name of the fast solver in the figures; the robust one is ``{solver}_robust``.
        limits: of the axes, their drives and the feed.
        knot_spacing_mm: largest spacing of the knots of q(s).
        safe_limits: limits whose plans hold ``limits`` too and are easier to find.
        whole_path: whether windows reach the end of the program or the next exact stop.
    """

    name: str
    solver: str
    limits: MotionLimits
    knot_spacing_mm: float
    safe_limits: MotionLimits | None = None
    whole_path: bool = False

    @property
    def stopping_mm(self) -> float:
        """See :class:`~feedopt_core.planner.method.PlanningMethod`."""
        return longest_stop_mm(braking_limits(self.limits))

    def plan(self, toolpath: Toolpath, window: Window) -> WindowPlan:
        """See :class:`~feedopt_core.planner.method.PlanningMethod`. Raises SolverError."""
        try:
            return self._plan(toolpath, window, window.guess, robust=False)
        except SolverError:
            safe = self._safe_plan(toolpath, window)
        try:
            return self._plan(toolpath, window, window.guess if safe is None else safe.profile, robust=True)
        except SolverError as error:
            if safe is not None:
                return safe
            raise SolverError(f"window {window.start_mm:.3f} to {window.end_mm:.3f} mm: {error}") from error

    def _safe_plan(self, toolpath: Toolpath, window: Window) -> WindowPlan | None:
        if self.safe_limits is None:
            return None
        try:
            return TimeOptimalMethod("lp", "lp", self.safe_limits, self.knot_spacing_mm).plan(toolpath, window)
        except SolverError:
            # A state outside the safe limits has no plan within them.
            return None

    def _plan(self, toolpath: Toolpath, window: Window, guess: FeedProfile | None, *, robust: bool) -> WindowPlan:
        # Where the machine stops within a few knots, its ramps need more of them.
        spacing_mm = min(self.knot_spacing_mm, max(self.stopping_mm, self.knot_spacing_mm) / _KNOTS_OF_A_STOP)
        spacing_mm /= _REFINEMENT if robust else 1.0
        knots = window_knots(ramp_limits(self.limits), toolpath, window, spacing_mm)
        if window.guess is not None and not robust:
            knots = continued_knots(knots, window.guess, toolpath.joints_mm(window.start_mm, window.end_mm))
        solve = WindowSolve(self.limits, toolpath, window, knots)
        name = f"{self.solver}_robust" if robust else self.solver
        iterations, worst, excess = 0, np.inf, np.empty(0)
        before: Restart | None = None
        tolerable: WindowPlan | None = None
        for _ in range(_REPAIRS):
            try:
                solution = solve.minimum_time(before, guess, cautious=robust)
            except SolverError:
                if before is not None:
                    # Beside a given state there may be no room to lower a limit: more knots there instead.
                    solve, before = solve.split(excess > _ACCEPTED), None
                    continue
                if tolerable is None:
                    raise
                return tolerable
            iterations += solution.iterations
            dips = solve.dips(solution.control_points)
            if np.any(dips):
                solve, before = solve.split(dips), None
                continue
            profile = solve.profile(solution.control_points)
            excess = solve.limit_ratios(profile)
            worst = float(np.max(excess))
            plan = WindowPlan(profile, name, len(solution.control_points), solution.row_count, iterations)
            if worst <= _ACCEPTED:
                return plan
            if worst <= _TOLERABLE:
                tolerable = plan
            if worst > _SPLIT_ABOVE:
                solve, before = solve.split(excess > 0.5 * (1.0 + _SPLIT_ABOVE)), None
            else:
                solve.tighten(excess)
                before = solution.restart
        if tolerable is not None:
            return tolerable
        raise SolverError(f"{worst:.5f} times a limit between the knots after {_REPAIRS} repairs")
