"""Primal-dual interior point for minimum-time feed profiles on a quadratic B-spline.

The unknowns are the control points c of q(s) = feedrate^2; on span k only ``c[k], c[k+1], c[k+2]`` count. Every
inequality stands in one span, so the normal matrix is pentadiagonal and one iteration costs time linear in the number
of spans.

    minimise    sum over quadrature points of weight / sqrt(q)          (the motion time; convex)
    subject to  sum_l rows[l] c[k + l] <= 1  on every span k

Limits that are not linear in (q, q', q'') enter by their tangent at the current q (the ``rows`` callback is asked
again in every iteration). Tangents that lie inside the true limit (see ``limits.jerk``) keep each iterate feasible,
and at the solution the tangent and the limit touch, so the result is a stationary point of the true problem.
Mehrotra's predictor and corrector (Wright, Primal-Dual Interior-Point Methods, ch. 10) with infeasible start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import SolverError

_STEP_TO_BOUNDARY = 0.995
_Q_STEP_TO_ZERO = 0.9
_FIRST_BARRIER = 0.1
"""Duality gap of the first iterate, as a part of its motion time."""
_CENTRALITY = 0.1
"""Least duality gap to aim at, as a part of the dual residual: a gap far below it makes the steps short."""


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
        outer_limit: upper bound of the outer control point, mm^2/s^2 (the jerk and acceleration limits of the element).
    """

    ratio: float
    outer_limit: float


@dataclass(frozen=True)
class TimeProblem:
    """Minimum motion time over m spans with p quadrature points each.

    Attributes:
        basis: q at the quadrature points, shape (3, p, m).
        weights_mm: quadrature weights along s, shape (p, m).
        rows: scaled inequalities for given control points, shape (3, r, m); each row must stay below 1.
        start: state at the first knot.
        end: state at the last knot.
    """

    basis: FloatArray
    weights_mm: FloatArray
    rows: Callable[[FloatArray], FloatArray]
    start: FixedStart | RestEnd
    end: RestEnd


@dataclass(frozen=True)
class TimeSolution:
    """Control points, shape (m + 2,), with the figures of the solve."""

    control_points: FloatArray
    iterations: int
    row_count: int


def local_products(coefficients: FloatArray, control_points: FloatArray) -> FloatArray:
    """``sum_l coefficients[l] c[k + l]``: shape (3, r, m) and (m + 2,) to (r, m)."""
    m = coefficients.shape[2]
    result: FloatArray = coefficients[0] * control_points[:m]
    result += coefficients[1] * control_points[1 : m + 1]
    result += coefficients[2] * control_points[2 : m + 2]
    return result


def _scatter(coefficients: FloatArray, values: FloatArray) -> FloatArray:
    """Transpose of :func:`local_products`: shape (3, r, m) and (r, m) to (m + 2,)."""
    m = coefficients.shape[2]
    out = np.zeros(m + 2)
    for offset in range(3):
        out[offset : offset + m] += np.einsum("rk,rk->k", coefficients[offset], values)
    return out


class _Ends:
    """Elimination of the end control points: full vector c of n entries from the free ones."""

    def __init__(self, start: FixedStart | RestEnd, end: RestEnd, count: int) -> None:
        self.start = start
        self.end = end
        self.first_free = 2 if isinstance(start, FixedStart) else 1
        self.count = count
        limits = [] if isinstance(start, FixedStart) else [start.outer_limit]
        self.outer = np.array([0, count - 1][-len(limits) - 1 :])
        self.inverse_limits = 1.0 / np.array([*limits, end.outer_limit])

    def apply(self, control_points: FloatArray) -> FloatArray:
        """Make the end control points obey the end conditions."""
        c = control_points.copy()
        if isinstance(self.start, FixedStart):
            c[0], c[1] = self.start.first, self.start.second
        else:
            c[0] = c[1] / self.start.ratio
        c[-1] = c[-2] / self.end.ratio
        return c

    def expand(self, free: FloatArray) -> FloatArray:
        """Step of all control points from a step of the free ones."""
        d = np.zeros(self.count)
        d[self.first_free : -1] = free
        if isinstance(self.start, RestEnd):
            d[0] = d[1] / self.start.ratio
        d[-1] = d[-2] / self.end.ratio
        return d

    def restrict(self, gradient: FloatArray) -> FloatArray:
        g = gradient.copy()
        if isinstance(self.start, RestEnd):
            g[1] += g[0] / self.start.ratio
        g[-2] += g[-1] / self.end.ratio
        return g[self.first_free : -1]

    def restrict_band(self, band: FloatArray) -> FloatArray:
        """Reduced matrix, upper banded form (2, 1, 0 above the diagonal); ``band`` is changed."""
        if isinstance(self.start, RestEnd):
            r = self.start.ratio
            band[2, 1] += 2.0 * band[1, 1] / r + band[2, 0] / r**2
            band[1, 2] += band[0, 2] / r
        r = self.end.ratio
        band[2, -2] += 2.0 * band[1, -1] / r + band[2, -1] / r**2
        band[1, -2] += band[0, -1] / r
        return band[:, self.first_free : -1]


@dataclass
class _Iterate:
    """Control points with slacks and multipliers of the rows and of the outer control points."""

    c: FloatArray
    slack: FloatArray
    dual: FloatArray
    end_slack: FloatArray
    end_dual: FloatArray

    def gap(self) -> float:
        return float(np.vdot(self.slack, self.dual) + self.end_slack @ self.end_dual)


def minimise_time(
    problem: TimeProblem,
    initial: FloatArray,
    *,
    tolerance: float = 1e-5,
    feasibility: float = 1e-8,
    max_iterations: int = 120,
) -> TimeSolution:
    """Minimise the motion time.

    Args:
        problem: objective, inequalities and end states.
        initial: control points with q > 0 at every quadrature point, shape (m + 2,); need not be feasible.
        tolerance: relative duality gap and dual residual to reach.
        feasibility: largest violation of a row to leave.
        max_iterations: give up after so many iterations.

    Raises:
        SolverError: no convergence; the limits may be infeasible. The message holds the residuals.
    """
    # An infeasible problem diverges; that is found by the residuals, not by warnings.
    with np.errstate(over="ignore", invalid="ignore"):
        return _InteriorPoint(problem, initial).solve(tolerance, feasibility, max_iterations)


class _InteriorPoint:
    def __init__(self, problem: TimeProblem, initial: FloatArray) -> None:
        self.problem = problem
        self.ends = _Ends(problem.start, problem.end, len(initial))
        c = self.ends.apply(initial)
        self.rows = problem.rows(c)
        slack = np.maximum(1.0 - local_products(self.rows, c), 1e-2)
        end_slack = np.maximum(1.0 - self.ends.inverse_limits * c[self.ends.outer], 1e-2)
        self.size = slack.size + end_slack.size
        barrier = _FIRST_BARRIER * self._time(c)[0] / self.size
        self.at = _Iterate(c, slack, barrier / slack, end_slack, barrier / end_slack)

    def _time(self, c: FloatArray) -> tuple[float, FloatArray]:
        q = local_products(self.problem.basis, c)
        return float(np.sum(self.problem.weights_mm / np.sqrt(q))), q

    def solve(self, tolerance: float, feasibility: float, max_iterations: int) -> TimeSolution:
        violation = dual = gap = np.inf
        for iteration in range(max_iterations):
            at = self.at
            time, q = self._time(at.c)
            weighted = self.problem.weights_mm / np.sqrt(q)
            gradient = _scatter(self.problem.basis, -0.5 * weighted / q) + _scatter(self.rows, at.dual)
            gradient[self.ends.outer] += self.ends.inverse_limits * at.end_dual
            residual = local_products(self.rows, at.c) + at.slack - 1.0
            end_residual = self.ends.inverse_limits * at.c[self.ends.outer] + at.end_slack - 1.0
            violation = float(np.max(residual - at.slack, initial=0.0))
            free_gradient = self.ends.restrict(gradient)
            dual = float(np.sum(np.abs(free_gradient * at.c[self.ends.first_free : -1]))) / time
            gap = at.gap() / time
            if gap < tolerance and dual < tolerance and violation < feasibility:
                return TimeSolution(at.c, iteration, self.size)
            if not np.isfinite(gap):
                break
            least = _CENTRALITY * dual * time / self.size
            self._step(gradient, 0.75 * weighted / q**2, q, residual, end_residual, least)
        raise SolverError(
            f"no convergence in {max_iterations} iterations over {len(self.at.c)} control points: "
            f"gap {gap:.1e}, dual residual {dual:.1e}, limits exceeded by {violation:.1e}"
        )

    def _normal_matrix(self, curvature: FloatArray) -> FloatArray:
        at = self.at
        n, m = len(at.c), self.rows.shape[2]
        scale = at.dual / at.slack
        band = np.zeros((3, n))
        for i in range(3):
            weighted_row = self.rows[i] * scale
            weighted_basis = self.problem.basis[i] * curvature
            for j in range(i, 3):
                values = np.einsum("rk,rk->k", weighted_row, self.rows[j])
                values += np.einsum("rk,rk->k", weighted_basis, self.problem.basis[j])
                band[2 - (j - i), j : j + m] += values
        band[2, self.ends.outer] += self.ends.inverse_limits**2 * at.end_dual / at.end_slack
        return self.ends.restrict_band(band)

    def _step(
        self,
        gradient: FloatArray,
        curvature: FloatArray,
        q: FloatArray,
        residual: FloatArray,
        end_residual: FloatArray,
        least_complement: float,
    ) -> None:
        at = self.at
        try:
            factor = cholesky_banded(self._normal_matrix(curvature), check_finite=False)
        except LinAlgError as error:
            raise SolverError(
                f"the normal matrix lost its definiteness over {len(at.c)} control points: {error}"
            ) from error
        mean = at.gap() / self.size

        def direction(complement: FloatArray, end_complement: FloatArray) -> _Iterate:
            right = gradient + _scatter(self.rows, (at.dual * residual - complement) / at.slack)
            right[self.ends.outer] += (
                self.ends.inverse_limits * (at.end_dual * end_residual - end_complement) / at.end_slack
            )
            d_c = self.ends.expand(cho_solve_banded((factor, False), -self.ends.restrict(right), check_finite=False))
            d_slack = -residual - local_products(self.rows, d_c)
            d_end_slack = -end_residual - self.ends.inverse_limits * d_c[self.ends.outer]
            return _Iterate(
                d_c,
                d_slack,
                -(complement + at.dual * d_slack) / at.slack,
                d_end_slack,
                -(end_complement + at.end_dual * d_end_slack) / at.end_slack,
            )

        predictor = direction(at.slack * at.dual, at.end_slack * at.end_dual)
        primal, dual = self._lengths(predictor, 1.0)
        reached = _moved(at, predictor, primal, dual).gap() / self.size
        target = max(mean * (reached / mean) ** 3, least_complement)
        corrector = direction(
            at.slack * at.dual + predictor.slack * predictor.dual - target,
            at.end_slack * at.end_dual + predictor.end_slack * predictor.end_dual - target,
        )
        primal, dual = self._lengths(corrector, _STEP_TO_BOUNDARY)
        primal = min(primal, _longest(q, local_products(self.problem.basis, corrector.c), _Q_STEP_TO_ZERO))
        self.at = _moved(at, corrector, primal, dual)
        self.at.c = self.ends.apply(self.at.c)
        self.rows = self.problem.rows(self.at.c)
        self._raise_slacks()

    def _raise_slacks(self) -> None:
        """Where a limit leaves more room than its old tangent promised, the slack is that room."""
        room = 1.0 - local_products(self.rows, self.at.c)
        np.maximum(self.at.slack, room, out=self.at.slack)

    def _lengths(self, direction: _Iterate, fraction: float) -> tuple[float, float]:
        at = self.at
        primal = min(
            _longest(at.slack, direction.slack, fraction), _longest(at.end_slack, direction.end_slack, fraction)
        )
        dual = min(_longest(at.dual, direction.dual, fraction), _longest(at.end_dual, direction.end_dual, fraction))
        return primal, dual


def _moved(at: _Iterate, direction: _Iterate, primal: float, dual: float) -> _Iterate:
    return _Iterate(
        at.c + primal * direction.c,
        at.slack + primal * direction.slack,
        at.dual + dual * direction.dual,
        at.end_slack + primal * direction.end_slack,
        at.end_dual + dual * direction.end_dual,
    )


def _longest(values: FloatArray, steps: FloatArray, fraction: float) -> float:
    """Longest step in (0, 1] that keeps ``values + step * steps`` above ``(1 - fraction) values``."""
    with np.errstate(divide="ignore"):
        ratio = float(np.max(-steps / values, initial=0.0))
    return min(1.0, fraction / ratio) if ratio > 0.0 else 1.0
