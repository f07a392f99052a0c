"""Methods ``lp``, ``lp_nlp`` and ``oneshot``: minimum time on one window, with a quadratic B-spline for q.

``lp`` uses velocity, acceleration and jerk limits under which the drive limits hold in the worst case, like the linear
program of the thesis (section 3.4). ``lp_nlp`` and ``oneshot`` limit control signal and tracking error themselves
(section 3.6). Two things differ from the thesis: linearisations that are renewed in every iteration replace the
pseudo-jerk, and the motion time replaces the integral of q as the objective. docs/decisions/ gives the reasons.
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
"""Utilisation between the points up to which no repair is needed, and up to which a plan is taken if repairs fail."""
_SPLIT_ABOVE = 1.02
"""Utilisation between the points above which spans are split; below it the limits are lowered instead."""
_KNOTS_OF_A_STOP = 4.0
_REFINEMENT = 3.0
"""Knot spacing of the fast solver over that of the robust one."""


@dataclass(frozen=True)
class TimeOptimalMethod:
    """Minimum time on one window under given limits.

    Where the fast solver fails, the robust one is tried: cautious steps on a finer mesh, started from the plan under
    ``safe_limits`` where these are given. Where the robust solver fails too, that plan is taken.

    Attributes:
        name: name on the command line and in every chunk.
        solver: name of the fast solver in the figures; the robust one is ``{solver}_robust``.
        limits: limits of the axes, their drives and the feed.
        knot_spacing_mm: largest spacing of the knots of q(s).
        safe_limits: stricter limits: a plan that keeps them keeps ``limits`` too, and is easier to find.
        whole_path: whether every window must reach the end of the program or the next exact stop.
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
            # A start state outside the safe limits has no plan within them.
            return None

    def _plan(self, toolpath: Toolpath, window: Window, guess: FeedProfile | None, *, robust: bool) -> WindowPlan:
        # Where the machine stops within a few knots, the ramps need a finer mesh.
        spacing_mm = min(self.knot_spacing_mm, max(self.stopping_mm, self.knot_spacing_mm) / _KNOTS_OF_A_STOP)
        spacing_mm /= _REFINEMENT if robust else 1.0
        knots = window_knots(ramp_limits(self.limits), toolpath, window, spacing_mm)
        if window.guess is not None and not robust:
            knots = continued_knots(knots, window.guess, toolpath.joints_mm(window.start_mm, window.end_mm))
        solve = WindowSolve(self.limits, toolpath, window, knots)
        name = f"{self.solver}_robust" if robust else self.solver
        iterations, worst, utilisation = 0, np.inf, np.empty(0)
        before: Restart | None = None
        tolerable: WindowPlan | None = None
        for _ in range(_REPAIRS):
            try:
                solution = solve.minimum_time(before, guess, cautious=robust)
            except SolverError:
                if before is not None:
                    # Next to a given start state there may be no slack to lower a limit: split the spans instead.
                    solve, before = solve.split(utilisation > _ACCEPTED), None
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
            utilisation = solve.limit_ratios(profile)
            worst = float(np.max(utilisation))
            plan = WindowPlan(profile, name, len(solution.control_points), solution.row_count, iterations)
            if worst <= _ACCEPTED:
                return plan
            if worst <= _TOLERABLE:
                tolerable = plan
            if worst > _SPLIT_ABOVE:
                solve, before = solve.split(utilisation > 0.5 * (1.0 + _SPLIT_ABOVE)), None
            else:
                solve.tighten(utilisation)
                before = solution.restart
        if tolerable is not None:
            return tolerable
        raise SolverError(f"{worst:.5f} times a limit between the knots after {_REPAIRS} repairs")
