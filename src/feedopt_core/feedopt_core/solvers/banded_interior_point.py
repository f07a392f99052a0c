"""Primal-dual interior point for minimum-time feed profiles on a quadratic B-spline.

The unknowns are the control points c of q(s) = feedrate^2; on span k only ``c[k], c[k+1], c[k+2]`` count. Every
inequality stands in one span, so the normal matrix is pentadiagonal and one iteration costs time linear in the number
of spans.

    minimise    sum over quadrature points of weight / sqrt(q)          (the motion time; convex)
    subject to  two-sided rows at every point, see ``interior_point_kernel``

Rows are linearised anew in every iteration, with exact residuals. The normal matrix holds their exact curvature; where
that makes it indefinite, their convex part. Mehrotra's predictor and corrector (Wright, Primal-Dual Interior-Point
Methods, ch. 10) with infeasible start. The problem is not convex: the result is a stationary point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import SolverError
from feedopt_core.solvers.interior_point_data import DUAL, SIDE_SIZE, SLACK, Ends, Iterate, Rows, Settings, System
from feedopt_core.solvers.interior_point_kernel import (
    CONVERGED,
    DIVERGED,
    INDEFINITE,
    OUT_OF_ITERATIONS,
    expand,
    iterate,
    look,
)

_FIRST_GAP = 0.3
"""Duality gap of the first iterate, as a part of its motion time."""
_LEAST_SLACK = 0.5
"""Least slack of the first iterate."""
_RESTART_GAP = 0.02
"""Duality gap at which an iterate still has the room to restart from when limits are lowered a little."""
_RESTART_SPREAD = 10.0
"""Largest ratio of a product of slack and multiplier to their mean at a restart."""
_GOOD_ENOUGH, _USABLE = 1e-3, 0.1
"""Duality gap and dual residual of a feasible iterate that is taken when the iterations run out, the latter by a
cautious solve: a feasible plan that is a little slow is better than a stop."""
_FAILURES = {
    OUT_OF_ITERATIONS: "no convergence",
    DIVERGED: "the iterations diverged or stalled",
    INDEFINITE: "the normal matrix lost its definiteness",
}


@dataclass(frozen=True)
class FixedStart:
    """The profile continues from a given state: the first two control points are known."""

    first: float
    second: float


@dataclass(frozen=True)
class RestEnd:
    """The profile meets an element of constant jerk from or to rest: the outer control point is ``inner / ratio``.

    Attributes:
        ratio: inner over outer control point, above 1.
        outer_limit: upper bound of the outer control point, mm^2/s^2 (the limits of the element).
    """

    ratio: float
    outer_limit: float


@dataclass(frozen=True)
class TimeProblem:
    """Minimum motion time over m spans: rows with the quadrature of the objective, and the states at both ends."""

    rows: Rows
    start: FixedStart | RestEnd
    end: RestEnd


@dataclass(frozen=True)
class Restart:
    """An iterate on the way to a solution, for problems that differ from that one in lower limits only.

    Attributes:
        c: control points, shape (m + 2,).
        sides: slacks and multipliers, shape (m, p, n, 2, 2).
        ends: of the limits of the outer control points, shape (2, 2).
    """

    c: FloatArray
    sides: FloatArray
    ends: FloatArray


@dataclass(frozen=True)
class TimeSolution:
    """Control points, shape (m + 2,), with the figures of the solve."""

    control_points: FloatArray
    iterations: int
    row_count: int
    restart: Restart


def minimise_time(
    problem: TimeProblem,
    initial: FloatArray | Restart,
    *,
    cautious: bool = False,
    tolerance: float = 1e-4,
    feasibility: float = 1e-8,
    max_iterations: int = 60,
) -> TimeSolution:
    """Minimise the motion time.

    Args:
        problem: objective, inequalities and end states.
        initial: control points with q > 0 at every quadrature point, shape (m + 2,), need not be feasible; or where
            to restart from.
        cautious: take the convex part of the curvature and shorter steps in every iteration.
        tolerance: relative duality gap and dual residual to reach.
        feasibility: largest violation of a row to leave.
        max_iterations: then a feasible iterate close to the optimum is taken too (less close when cautious).

    Raises:
        SolverError: no convergence; the limits may be infeasible. The message holds the residuals.
    """
    return _InteriorPoint(problem, initial).solve(Settings(cautious, tolerance, feasibility, max_iterations))


class _InteriorPoint:
    def __init__(self, problem: TimeProblem, initial: FloatArray | Restart) -> None:
        rows, start, end = problem.rows, problem.start, problem.end
        c = (initial.c if isinstance(initial, Restart) else initial).copy()
        if isinstance(start, FixedStart):
            c[:2] = start.first, start.second
            self.ends = Ends(0.0, end.ratio, 0.0, 1.0 / end.outer_limit)
        else:
            self.ends = Ends(start.ratio, end.ratio, 1.0 / start.outer_limit, 1.0 / end.outer_limit)
        expand(self.ends, c)
        sides = np.zeros((*rows.inverse_limits.shape, SIDE_SIZE))
        sides[..., SLACK] = _LEAST_SLACK
        ends = np.zeros((2, SIDE_SIZE))
        ends[:, SLACK] = _LEAST_SLACK
        self.rows = rows
        self.at = Iterate(c, sides, np.empty((*rows.coefficients.shape[:3], 2)), ends)
        self.system = System(*(np.empty(len(c)) for _ in range(3)), *(np.empty((len(c), 3)) for _ in range(2)))
        self.size = int(np.count_nonzero(rows.inverse_limits)) + (1 if isinstance(start, FixedStart) else 2)
        if isinstance(initial, Restart):
            sides[..., : DUAL + 1], ends[:, : DUAL + 1] = initial.sides, initial.ends
        # The first look raises the slacks to the room there is; multipliers follow from them.
        time = look(rows, self.ends, self.at, self.system, 0.0, 0.0)[0]
        if isinstance(initial, Restart):
            self._centre(_RESTART_GAP * time / self.size)
        else:
            barrier = _FIRST_GAP * time / self.size
            sides[..., DUAL] = barrier / sides[..., SLACK]
            ends[:, DUAL] = barrier / ends[:, SLACK]

    def _centre(self, barrier: float) -> None:
        for values in (self.at.sides, self.at.ends):
            mean = barrier / values[..., SLACK]
            np.clip(values[..., DUAL], mean / _RESTART_SPREAD, mean * _RESTART_SPREAD, out=values[..., DUAL])

    def solve(self, settings: Settings) -> TimeSolution:
        coarse = settings._replace(tolerance=_RESTART_GAP, feasibility=_RESTART_GAP)
        end, iterations, gap, dual, excess = self._iterate(coarse)
        restart = Restart(self.at.c.copy(), self.at.sides[..., : DUAL + 1].copy(), self.at.ends[:, : DUAL + 1].copy())
        if end == CONVERGED:
            before, left = iterations, settings.max_iterations - iterations
            end, iterations, gap, dual, excess = self._iterate(settings._replace(max_iterations=left))
            iterations += before
        close = _USABLE if settings.cautious else _GOOD_ENOUGH
        good_enough = end == OUT_OF_ITERATIONS and excess < settings.feasibility and max(gap, dual) < close
        if end == CONVERGED or good_enough:
            return TimeSolution(self.at.c, iterations, self.size, restart)
        raise SolverError(
            f"{_FAILURES[end]} after {iterations} iterations over {len(self.at.c)} control points: "
            f"gap {gap:.1e}, dual residual {dual:.1e}, limits exceeded by {excess:.1e}"
        )

    def _iterate(self, settings: Settings) -> tuple[int, int, float, float, float]:
        return iterate(self.rows, self.ends, self.at, self.system, self.size, settings)
