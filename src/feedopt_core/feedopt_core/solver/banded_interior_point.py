"""Primal-dual interior point for minimum-time feed profiles on a quadratic B-spline.

The unknowns are the control points c of q(s) = feedrate^2; q on span k depends on ``c[k], c[k+1], c[k+2]`` only. Every
inequality belongs to one span. So the normal matrix is pentadiagonal, and the time of one iteration is linear in the
number of spans.

    minimise    sum over quadrature points of weight / sqrt(q)          (the motion time; convex)
    subject to  two-sided rows at every point, see ``interior_point_kernel``

Rows are linearised anew in every iteration, with exact residuals. The normal matrix contains their exact curvature;
where that makes it indefinite, only the convex part. The method is Mehrotra's predictor-corrector (Wright, Primal-Dual
Interior-Point Methods, ch. 10) with infeasible start. The problem is not convex: the result is a stationary point.

Few rows come near their limits. So all rows are used until the duality gap is small, then only those near their limits.
If the result violates one of the other rows, all rows of the spans around it are added, and the iterations continue
from the iterate at which the gap became small. An optimum on a part of the rows that violates no other row is also an
optimum on all rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from feedopt_core.arrays import BoolArray, FloatArray, IntArray, RecordArray
from feedopt_core.errors import SolverError
from feedopt_core.solver.banded_system import expand
from feedopt_core.solver.interior_point_data import (
    LINEARISED,
    SIDE,
    Ends,
    Iterate,
    PackedRows,
    Rows,
    Settings,
    System,
)
from feedopt_core.solver.interior_point_kernel import (
    CONVERGED,
    DIVERGED,
    INDEFINITE,
    OUT_OF_ITERATIONS,
    iterate,
)
from feedopt_core.solver.packed_rows import packed, part, slacks

_FIRST_GAP = 0.6
"""Duality gap of the first iterate, as a part of its motion time."""
_LEAST_SLACK = 0.5
"""Least slack of the first iterate."""
_RESTART_GAP = 0.02
"""Duality gap below which only rows near their limits are used. The iterate there still has slack, so that it can
serve for a restart after limits were lowered a little."""
_NEAR = 0.7
"""Slack of a row at that gap, as a part of its limit, up to which the row is used."""
_AT_A_LIMIT = 0.03
"""Slack of a row at that gap, as a part of its limit, up to which the row counts as being at its limit."""
_AROUND = 8
"""Number of spans on each side of a violated row whose rows are all used afterwards."""
_SELECTIONS = 5
"""Number of selections of rows that are tried before all rows are used."""
_RESTART_SPREAD = 10.0
"""Largest ratio of a product of slack and multiplier to their mean at a restart."""
_GOOD_ENOUGH, _USABLE = 1e-3, 0.1
"""Duality gap and dual residual up to which a feasible iterate is accepted when the iterations run out; the second
value is for a cautious solve. A feasible plan that is a little slow is better than a stop."""
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
class StandstillEnd:
    """The profile joins a standstill element of constant jerk: the outer control point is ``inner / ratio``.

    Attributes:
        ratio: inner over outer control point, above 1.
        outer_limit: upper bound of the outer control point, mm^2/s^2; it follows from the limits on the element.
    """

    ratio: float
    outer_limit: float


@dataclass(frozen=True)
class TimeProblem:
    """Minimum motion time over m spans: rows with the quadrature of the objective, and the states at both ends."""

    rows: Rows
    start: FixedStart | StandstillEnd
    end: StandstillEnd


class Pairs(NamedTuple):
    """Slacks of some sides of rows, and their multipliers, of equal shape."""

    slack: FloatArray
    dual: FloatArray


@dataclass(frozen=True)
class Restart:
    """An iterate on the way to a solution, to start a problem that differs only by lower limits.

    Attributes:
        c: control points, shape (m + 2,).
        index: indices of its rows among the rows of all points, increasing, shape (n,).
        sides: slacks and multipliers of these rows, shape (n, 2).
        ends: slacks and multipliers of the limits of the outer control points, shape (2,).
    """

    c: FloatArray
    index: IntArray
    sides: Pairs
    ends: Pairs


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
    tolerance: float = 1e-5,
    feasibility: float = 1e-8,
    max_iterations: int = 60,
) -> TimeSolution:
    """Minimise the motion time.

    Args:
        problem: objective, inequalities and end states.
        initial: control points with q > 0 at every quadrature point, shape (m + 2,), which need not be feasible; or an
            iterate to restart from.
        cautious: use the convex part of the curvature and shorter steps in every iteration.
        tolerance: relative duality gap and dual residual to reach.
        feasibility: largest violation of a row that is accepted.
        max_iterations: number of iterations after which a feasible iterate close to the optimum is accepted too (less
            close when cautious).

    Raises:
        SolverError: no convergence; the limits may be infeasible. The message gives the residuals.
    """
    return _InteriorPoint(problem, initial).solve(Settings(cautious, tolerance, feasibility, max_iterations))


class _Found(NamedTuple):
    """How a run of iterations ended; see ``interior_point_kernel.iterate``."""

    end: int
    iterations: int = 0
    gap: float = 0.0
    dual: float = 0.0
    violation: float = 0.0


class _InteriorPoint:
    """One problem with its packed rows and its first iterate."""

    def __init__(self, problem: TimeProblem, initial: FloatArray | Restart) -> None:
        start, end = problem.start, problem.end
        c = (initial.c if isinstance(initial, Restart) else initial).copy()
        if isinstance(start, FixedStart):
            c[:2] = start.first, start.second
            self.ends = Ends(0.0, end.ratio, 0.0, 1.0 / end.outer_limit)
        else:
            self.ends = Ends(start.ratio, end.ratio, 1.0 / start.outer_limit, 1.0 / end.outer_limit)
        expand(self.ends, c)
        self.rows, self.index = packed(problem.rows)
        self.system = System(*(np.empty(len(c)) for _ in range(3)), *(np.empty((len(c), 3)) for _ in range(2)))
        self.size = self._size(self.rows)
        self.slack = np.empty(self.rows.inverse_limits.shape)
        time = slacks(self.rows, c, self.slack)
        end_slack = np.array([1.0 - self.ends.start_inverse_limit * c[0], 1.0 - self.ends.end_inverse_limit * c[-1]])
        self.restarted = isinstance(initial, Restart)
        if isinstance(initial, Restart):
            barrier = _RESTART_GAP * time / self.size
            sides = _centred(self._known(initial), self.slack, barrier)
            ends = _centred(initial.ends, end_slack, barrier)
        else:
            barrier = _FIRST_GAP * time / self.size
            sides, ends = _first(self.slack, barrier), _first(end_slack, barrier)
        self.start = Restart(c, self.index, sides, ends)

    def _size(self, rows: PackedRows) -> int:
        end_limits = (self.ends.start_inverse_limit > 0.0) + (self.ends.end_inverse_limit > 0.0)
        return int(np.count_nonzero(rows.inverse_limits)) + end_limits

    def _known(self, restart: Restart) -> Pairs:
        """Slacks and multipliers of a restart for the rows of this problem.

        Rows that the restart lacks get the least slack and the multiplier 0.
        """
        place = np.minimum(np.searchsorted(restart.index, self.index), len(restart.index) - 1)
        same, known = (restart.index[place] == self.index)[:, None], restart.sides
        return Pairs(np.where(same, known.slack[place], _LEAST_SLACK), np.where(same, known.dual[place], 0.0))

    def solve(self, settings: Settings) -> TimeSolution:
        """See :func:`minimise_time`."""
        found, restart = _Found(CONVERGED), self.start
        if not self.restarted:
            coarse = settings._replace(tolerance=_RESTART_GAP, feasibility=_RESTART_GAP)
            found, restart = self._iterate(restart, None, coarse)
        iterations, last = found.iterations, restart
        if found.end == CONVERGED:
            found, last, refining = self._refine(restart, settings)
            iterations += refining
        close = _USABLE if settings.cautious else _GOOD_ENOUGH
        good_enough = found.end == OUT_OF_ITERATIONS and found.violation < settings.feasibility
        if found.end == CONVERGED or (good_enough and max(found.gap, found.dual) < close):
            return TimeSolution(last.c, iterations, self.size, restart)
        raise SolverError(
            f"{_FAILURES[found.end]} after {iterations} iterations over {len(last.c)} control points: "
            f"gap {found.gap:.1e}, dual residual {found.dual:.1e}, largest violation {found.violation:.1e}"
        )

    def _refine(self, start: Restart, settings: Settings) -> tuple[_Found, Restart, int]:
        """Iterate on the rows near their limits until no other row is violated, else on all rows.

        Returns:
            How the last run ended, its iterate, and the number of iterations of all runs.
        """
        iterations, first_of_spans = 0, self.rows.first[:, 0]
        slack = np.min(start.sides.slack, axis=1, where=self.rows.inverse_limits != 0.0, initial=np.inf)
        # The fastest motion is at some limit everywhere. In a span where no row is at its limit yet, any may get there.
        near = (slack < _NEAR) | self._of_spans(np.minimum.reduceat(slack, first_of_spans) > _AT_A_LIMIT)
        for _ in range(_SELECTIONS):
            found, last = self._iterate(start, near, settings)
            iterations += found.iterations
            if found.end != CONVERGED:
                break
            slacks(self.rows, last.c, self.slack)
            violated = ~near & (np.min(self.slack, axis=1) < -settings.feasibility)
            if not np.any(violated):
                return found, last, iterations
            spans = np.logical_or.reduceat(violated, first_of_spans)
            near |= self._of_spans(np.convolve(spans, np.ones(2 * _AROUND + 1))[_AROUND:-_AROUND] > 0.0)
        found, last = self._iterate(start, None, settings)
        return found, last, iterations + found.iterations

    def _of_spans(self, spans: BoolArray) -> BoolArray:
        """Marks on spans, shape (m,), as marks on their rows, shape (n,)."""
        return np.repeat(spans, np.sum(self.rows.counts, axis=1))

    def _iterate(self, start: Restart, kept: BoolArray | None, settings: Settings) -> tuple[_Found, Restart]:
        """Iterate on the rows marked in ``kept``, shape (n,), or on all; the last iterate contains only these rows."""
        rows, index, known = self.rows, self.index, start.sides
        if kept is not None:
            rows, index, known = part(rows, kept), index[kept], Pairs(known.slack[kept], known.dual[kept])
        count = len(index)
        at = Iterate(start.c.copy(), np.zeros((count, 2), SIDE), np.empty(count, LINEARISED), np.zeros(2, SIDE))
        for sides, pairs in ((at.sides, known), (at.ends, start.ends)):
            sides["slack"], sides["dual"] = pairs
        size = self._size(rows)
        found = _Found(*iterate(rows, self.ends, at, self.system, size, size / self.size, settings))
        last = Restart(at.c, index, _pairs(at.sides), _pairs(at.ends))
        return found, last


def _pairs(sides: RecordArray) -> Pairs:
    """Copy of the slacks and multipliers of sides."""
    return Pairs(sides["slack"].copy(), sides["dual"].copy())


def _first(slack: FloatArray, barrier: float) -> Pairs:
    """Slacks and multipliers of a first iterate, from its slack to the limits."""
    slack = np.maximum(slack, _LEAST_SLACK)
    return Pairs(slack, barrier / slack)


def _centred(known: Pairs, slack: FloatArray, barrier: float) -> Pairs:
    """Slacks, raised where the limits leave more slack, and multipliers, kept close to the central path."""
    slack = np.maximum(known.slack, slack)
    mean = barrier / slack
    return Pairs(slack, np.clip(known.dual, mean / _RESTART_SPREAD, mean * _RESTART_SPREAD))
