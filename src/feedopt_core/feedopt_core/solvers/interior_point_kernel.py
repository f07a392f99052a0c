"""The passes of the interior point over spans, points, rows and sides, compiled.

At every point of every span stand n two-sided rows. With c the three control points of the span, q = B c there and
D = linear + sqrt(q) bend,

    y = linear c + sqrt(q) (root + bend c),    -limit_down <= y <= limit_up

A side is linearised as ``sigma D + beta B`` with its residual exact, so two numbers a side are all that the normal
matrix needs beside D and B. Rows with a bend are divided by sqrt(q) before they are linearised: y / sqrt(q) is linear
in q'', and its right side limit / sqrt(q) is convex, so that the linearisation lies inside the limit.

Everything is written out in scalars, and what belongs together lies together in memory: that is what makes it fast. It
all stands in one module because numba looks at no other one to find out whether its code on disk is still good.
"""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.compiled import compiled
from feedopt_core.solvers.interior_point_data import Ends, Iterate, Rows, Settings, System

CONVERGED, OUT_OF_ITERATIONS, DIVERGED, INDEFINITE = 0, 1, 2, 3
"""How the iterations ended."""
_STEP_TO_BOUNDARY, _CAUTIOUS_STEP_TO_BOUNDARY = 0.995, 0.9
_Q_STEP_TO_ZERO = 0.9
_DIVERGED = 1e8
"""Dual residual at which no solution is to be hoped for."""
_SHORT, _RECENTRE = 0.2, 0.5
"""After a step shorter than this the next one aims at this part of the gap, without second-order terms."""
_STALLED, _MOST_STALLS = 1e-3, 8
"""So many primal steps in a row shorter than this lead nowhere."""
_CENTRALITY = 0.5
"""Least duality gap to aim at, as a part of the dual residual: a gap far below it makes the steps short."""


@compiled
def _restrict(ends: Ends, vector: FloatArray) -> None:
    """Gradient by the free control points, in place; the others become zero."""
    last = len(vector) - 1
    if ends.start_ratio > 0.0:
        vector[1] += vector[0] / ends.start_ratio
    else:
        vector[1] = 0.0
    vector[last - 1] += vector[last] / ends.end_ratio
    vector[0] = vector[last] = 0.0


@compiled
def expand(ends: Ends, c: FloatArray) -> None:
    """End control points from the free ones, in place."""
    last = len(c) - 1
    if ends.start_ratio > 0.0:
        c[0] = c[1] / ends.start_ratio
    c[last] = c[last - 1] / ends.end_ratio


@compiled
def _restrict_band(ends: Ends, band: FloatArray) -> None:
    """Normal matrix by the free control points, in place; the others get a unit diagonal."""
    last = len(band) - 1
    if ends.start_ratio > 0.0:
        r = ends.start_ratio
        band[1, 0] += 2.0 * band[0, 1] / r + band[0, 0] / r**2
        band[1, 1] += band[0, 2] / r
    else:
        band[1, 0], band[1, 1], band[1, 2] = 1.0, 0.0, 0.0
    band[0, 0], band[0, 1], band[0, 2] = 1.0, 0.0, 0.0
    r = ends.end_ratio
    band[last - 1, 0] += 2.0 * band[last - 1, 1] / r + band[last, 0] / r**2
    band[last - 2, 1] += band[last - 2, 2] / r
    band[last, 0] = 1.0
    band[last - 1, 1] = band[last - 2, 2] = 0.0


@compiled
def _factorise(band: FloatArray) -> bool:
    """L D L' in place (D on the diagonal); False where the matrix is not positive definite."""
    n = len(band)
    for j in range(n):
        d = band[j, 0]
        if not 0.0 < d < np.inf:
            return False
        l1, l2 = band[j, 1] / d, band[j, 2] / d
        if j + 1 < n:
            band[j + 1, 0] -= l1 * band[j, 1]
            band[j + 1, 1] -= l1 * band[j, 2]
        if j + 2 < n:
            band[j + 2, 0] -= l2 * band[j, 2]
        band[j, 1], band[j, 2] = l1, l2
    return True


@compiled
def _solve(factor: FloatArray, vector: FloatArray) -> None:
    """Solve in place with the factor of :func:`_factorise`."""
    n = len(vector)
    for j in range(n):
        if j + 1 < n:
            vector[j + 1] -= factor[j, 1] * vector[j]
        if j + 2 < n:
            vector[j + 2] -= factor[j, 2] * vector[j]
    for j in range(n - 1, -1, -1):
        value = vector[j] / factor[j, 0]
        if j + 1 < n:
            value -= factor[j, 1] * vector[j + 1]
        if j + 2 < n:
            value -= factor[j, 2] * vector[j + 2]
        vector[j] = value


@compiled
def _add_square(band: FloatArray, k: int, weight: float, x0: float, x1: float, x2: float) -> None:
    """Add ``weight x x'`` of span k."""
    band[k, 0] += weight * x0 * x0
    band[k, 1] += weight * x0 * x1
    band[k, 2] += weight * x0 * x2
    band[k + 1, 0] += weight * x1 * x1
    band[k + 1, 1] += weight * x1 * x2
    band[k + 2, 0] += weight * x2 * x2


@compiled
def _add_product(band: FloatArray, k: int, x0: float, x1: float, x2: float, y0: float, y1: float, y2: float) -> None:
    """Add ``x y' + y x'`` of span k."""
    band[k, 0] += 2.0 * x0 * y0
    band[k, 1] += x0 * y1 + x1 * y0
    band[k, 2] += x0 * y2 + x2 * y0
    band[k + 1, 0] += 2.0 * x1 * y1
    band[k + 1, 1] += x1 * y2 + x2 * y1
    band[k + 2, 0] += 2.0 * x2 * y2


@compiled
def _assemble(rows: Rows, at: Iterate, system: System) -> tuple[float, float, float]:  # noqa: PLR0915 -- scalars
    """Residuals, gradient, right side of the predictor and normal matrix; slacks rise to the room a limit leaves.

    Returns:
        Motion time (not a number where q is not positive), sum of slack times multiplier, largest excess of a limit.
    """
    basis, weights, coefficients, limits, over_root = rows
    gradient, right, _, band, convex = system
    sides, gradients = at.sides, at.gradients
    spans, points, count = coefficients.shape[:3]
    time = gap = excess = 0.0
    gradient[:], right[:], band[:], convex[:] = 0.0, 0.0, 0.0, 0.0
    for k in range(spans):
        c0, c1, c2 = at.c[k], at.c[k + 1], at.c[k + 2]
        for p in range(points):
            b0, b1, b2 = basis[k, p, 0], basis[k, p, 1], basis[k, p, 2]
            q = b0 * c0 + b1 * c1 + b2 * c2
            if not q > 0.0:
                return np.nan, gap, excess
            root_q, half_over_q = np.sqrt(q), 0.5 / q
            half_over_root = half_over_q * root_q
            weighted = 2.0 * weights[k, p] * half_over_root
            time += weighted
            on_basis = right_basis = -weighted * half_over_q
            exact = positive = 3.0 * weighted * half_over_q * half_over_q
            square = x0 = x1 = x2 = h0 = h1 = h2 = g0 = g1 = g2 = r0 = r1 = r2 = 0.0
            for i in range(count):
                l0, l1, l2 = coefficients[k, p, i, 0], coefficients[k, p, i, 1], coefficients[k, p, i, 2]
                straight = l0 * c0 + l1 * c1 + l2 * c2
                divided, root = over_root[i] > 0.0, coefficients[k, p, i, 6]
                d0, d1, d2 = l0, l1, l2
                if divided:
                    d0 += root_q * coefficients[k, p, i, 3]
                    d1 += root_q * coefficients[k, p, i, 4]
                    d2 += root_q * coefficients[k, p, i, 5]
                y = d0 * c0 + d1 * c1 + d2 * c2 + root * root_q
                gradients[k, p, i, 0], gradients[k, p, i, 1], gradients[k, p, i, 2] = d0, d1, d2
                dual_d = pull_d = square_d = cross_d = bent = 0.0
                for side in range(2):
                    sigma = limits[k, p, i, side]
                    if sigma == 0.0:
                        continue
                    if side == 1:
                        sigma = -sigma
                    over = sigma * y - 1.0
                    excess = max(excess, over)
                    slack, dual = max(sides[k, p, i, side, 0], -over), sides[k, p, i, side, 1]
                    residual = over + slack
                    omega = dual / slack
                    pull = omega * residual
                    if divided:
                        beta = (1.0 - sigma * straight) * half_over_q
                        curvature = -3.0 * dual * beta * half_over_q
                        bent -= dual * sigma * half_over_q
                    else:
                        beta = sigma * root * half_over_root
                        curvature = -dual * beta * half_over_q
                    sides[k, p, i, side, 0], sides[k, p, i, side, 2] = slack, residual
                    sides[k, p, i, side, 3] = beta
                    gap += slack * dual
                    exact += curvature
                    positive += max(curvature, 0.0)
                    dual_d += sigma * dual
                    on_basis += beta * dual
                    pull_d += sigma * pull
                    right_basis += beta * pull
                    square_d += omega * sigma * sigma
                    cross_d += omega * sigma * beta
                    square += omega * beta * beta
                g0, g1, g2 = g0 + dual_d * d0, g1 + dual_d * d1, g2 + dual_d * d2
                r0, r1, r2 = r0 + pull_d * d0, r1 + pull_d * d1, r2 + pull_d * d2
                x0, x1, x2 = x0 + cross_d * d0, x1 + cross_d * d1, x2 + cross_d * d2
                h0, h1, h2 = h0 + bent * l0, h1 + bent * l1, h2 + bent * l2
                _add_square(band, k, square_d, d0, d1, d2)
            gradient[k] += g0 + on_basis * b0
            gradient[k + 1] += g1 + on_basis * b1
            gradient[k + 2] += g2 + on_basis * b2
            right[k] += r0 + right_basis * b0
            right[k + 1] += r1 + right_basis * b1
            right[k + 2] += r2 + right_basis * b2
            _add_square(band, k, square + exact, b0, b1, b2)
            _add_product(band, k, x0 + h0, x1 + h1, x2 + h2, b0, b1, b2)
            _add_square(convex, k, positive - exact, b0, b1, b2)
            _add_product(convex, k, -h0, -h1, -h2, b0, b1, b2)
    return time, gap, excess


@compiled
def _add_ends(ends: Ends, at: Iterate, system: System) -> tuple[float, float]:
    """Limits of the outer control points; returns their part of gap and excess."""
    gap = excess = 0.0
    last = len(at.c) - 1
    for end in range(2):
        inverse = ends.end_inverse_limit if end else ends.start_inverse_limit
        if inverse == 0.0:
            continue
        place = last if end else 0
        over, dual = inverse * at.c[place] - 1.0, at.ends[end, 1]
        slack = max(at.ends[end, 0], -over)
        at.ends[end, 0], at.ends[end, 2] = slack, over + slack
        gap += slack * dual
        excess = max(excess, over)
        system.gradient[place] += inverse * dual
        system.right[place] += inverse * dual / slack * (over + slack)
        system.band[place, 0] += inverse * inverse * dual / slack
    return gap, excess


@compiled
def _predict(
    rows: Rows, ends: Ends, at: Iterate, system: System, step: FloatArray, weight: float
) -> tuple[float, float, float, float, float]:
    """Look along the predictor: turns the right side into the corrector's and sets its centre.

    ``weight`` is that of the second-order terms: 1, or 0 to leave them out.

    Returns:
        Longest primal and dual step as inverse ratios; three sums from which the gap after a step follows: of
        d_slack * dual, slack * d_dual and d_slack * d_dual.
    """
    basis, _, coefficients, limits, _ = rows
    _, right, centre, _, _ = system
    sides, gradients = at.sides, at.gradients
    spans, points, count = coefficients.shape[:3]
    primal = dual_ratio = by_slack = by_dual = both = 0.0
    centre[:] = 0.0
    for k in range(spans):
        s0, s1, s2 = step[k], step[k + 1], step[k + 2]
        for p in range(points):
            b0, b1, b2 = basis[k, p, 0], basis[k, p, 1], basis[k, p, 2]
            dq = b0 * s0 + b1 * s1 + b2 * s2
            right_basis = centre_basis = r0 = r1 = r2 = m0 = m1 = m2 = 0.0
            for i in range(count):
                d0, d1, d2 = gradients[k, p, i, 0], gradients[k, p, i, 1], gradients[k, p, i, 2]
                dd = d0 * s0 + d1 * s1 + d2 * s2
                right_d = centre_d = 0.0
                for side in range(2):
                    sigma = limits[k, p, i, side]
                    if sigma == 0.0:
                        continue
                    if side == 1:
                        sigma = -sigma
                    slack, dual, beta = sides[k, p, i, side, 0], sides[k, p, i, side, 1], sides[k, p, i, side, 3]
                    inverse = 1.0 / slack
                    d_slack = -sides[k, p, i, side, 2] - sigma * dd - beta * dq
                    relative = d_slack * inverse
                    d_dual = -dual * (1.0 + relative)
                    primal, dual_ratio = max(primal, -relative), max(dual_ratio, 1.0 + relative)
                    second = weight * d_slack * d_dual
                    sides[k, p, i, side, 6] = second
                    by_slack += d_slack * dual
                    by_dual += slack * d_dual
                    both += d_slack * d_dual
                    right_d -= sigma * second * inverse
                    right_basis -= beta * second * inverse
                    centre_d += sigma * inverse
                    centre_basis += beta * inverse
                r0, r1, r2 = r0 + right_d * d0, r1 + right_d * d1, r2 + right_d * d2
                m0, m1, m2 = m0 + centre_d * d0, m1 + centre_d * d1, m2 + centre_d * d2
            right[k] += r0 + right_basis * b0
            right[k + 1] += r1 + right_basis * b1
            right[k + 2] += r2 + right_basis * b2
            centre[k] += m0 + centre_basis * b0
            centre[k + 1] += m1 + centre_basis * b1
            centre[k + 2] += m2 + centre_basis * b2
    for end in range(2):
        inverse_limit = ends.end_inverse_limit if end else ends.start_inverse_limit
        if inverse_limit == 0.0:
            continue
        place = len(at.c) - 1 if end else 0
        slack, dual = at.ends[end, 0], at.ends[end, 1]
        d_slack = -at.ends[end, 2] - inverse_limit * step[place]
        d_dual = -dual * (1.0 + d_slack / slack)
        primal, dual_ratio = max(primal, -d_slack / slack), max(dual_ratio, 1.0 + d_slack / slack)
        at.ends[end, 6] = weight * d_slack * d_dual
        by_slack += d_slack * dual
        by_dual += slack * d_dual
        both += d_slack * d_dual
        right[place] -= inverse_limit * at.ends[end, 6] / slack
        centre[place] += inverse_limit / slack
    return primal, dual_ratio, by_slack, by_dual, both


@compiled
def _correct(rows: Rows, ends: Ends, at: Iterate, step: FloatArray, target: float) -> tuple[float, float, float]:
    """Steps of slacks and multipliers along the corrector; longest primal, dual and q step as inverse ratios."""
    basis, _, coefficients, limits, _ = rows
    sides, gradients = at.sides, at.gradients
    spans, points, count = coefficients.shape[:3]
    primal = dual_ratio = q_ratio = 0.0
    for k in range(spans):
        s0, s1, s2 = step[k], step[k + 1], step[k + 2]
        c0, c1, c2 = at.c[k], at.c[k + 1], at.c[k + 2]
        for p in range(points):
            b0, b1, b2 = basis[k, p, 0], basis[k, p, 1], basis[k, p, 2]
            dq = b0 * s0 + b1 * s1 + b2 * s2
            q_ratio = max(q_ratio, -dq / (b0 * c0 + b1 * c1 + b2 * c2))
            for i in range(count):
                dd = gradients[k, p, i, 0] * s0 + gradients[k, p, i, 1] * s1 + gradients[k, p, i, 2] * s2
                for side in range(2):
                    sigma = limits[k, p, i, side]
                    if sigma == 0.0:
                        continue
                    if side == 1:
                        sigma = -sigma
                    slack, dual = sides[k, p, i, side, 0], sides[k, p, i, side, 1]
                    inverse = 1.0 / (slack * dual)
                    d_slack = -sides[k, p, i, side, 2] - sigma * dd - sides[k, p, i, side, 3] * dq
                    aim = target - sides[k, p, i, side, 6] - dual * d_slack
                    d_dual = aim * dual * inverse - dual
                    sides[k, p, i, side, 4], sides[k, p, i, side, 5] = d_slack, d_dual
                    primal = max(primal, -d_slack * dual * inverse)
                    dual_ratio = max(dual_ratio, 1.0 - aim * inverse)
    for end in range(2):
        inverse_limit = ends.end_inverse_limit if end else ends.start_inverse_limit
        if inverse_limit == 0.0:
            continue
        place = len(at.c) - 1 if end else 0
        slack, dual = at.ends[end, 0], at.ends[end, 1]
        d_slack = -at.ends[end, 2] - inverse_limit * step[place]
        d_dual = (target - at.ends[end, 6] - dual * d_slack) / slack - dual
        at.ends[end, 4], at.ends[end, 5] = d_slack, d_dual
        primal, dual_ratio = max(primal, -d_slack / slack), max(dual_ratio, -d_dual / dual)
    return primal, dual_ratio, q_ratio


@compiled
def _move(rows: Rows, at: Iterate, primal: float, dual: float) -> None:
    """Take the corrector's steps of slacks and multipliers."""
    sides = at.sides
    spans, points, count = rows.coefficients.shape[:3]
    for k in range(spans):
        for p in range(points):
            for i in range(count):
                for side in range(2):
                    sides[k, p, i, side, 0] += primal * sides[k, p, i, side, 4]
                    sides[k, p, i, side, 1] += dual * sides[k, p, i, side, 5]
    for end in range(2):
        at.ends[end, 0] += primal * at.ends[end, 4]
        at.ends[end, 1] += dual * at.ends[end, 5]


@compiled
def look(rows: Rows, ends: Ends, at: Iterate, system: System) -> tuple[float, float, float]:
    """Set the linear system at the iterate; motion time, sum of slack times multiplier, largest excess of a limit."""
    time, total, excess = _assemble(rows, at, system)
    end_total, end_excess = _add_ends(ends, at, system)
    return time, total + end_total, max(excess, end_excess)


@compiled
def _length(ratio: float, fraction: float) -> float:
    """Longest step in (0, 1] whose inverse ratio leaves ``1 - fraction`` of every value."""
    return min(1.0, fraction / ratio) if ratio > 0.0 else 1.0


@compiled
def _direction(ends: Ends, factor: FloatArray, right: FloatArray) -> FloatArray:
    step = -right
    _restrict(ends, step)
    _solve(factor, step)
    expand(ends, step)
    return step


@compiled
def iterate(
    rows: Rows, ends: Ends, at: Iterate, system: System, size: int, settings: Settings
) -> tuple[int, int, float, float, float]:
    """Predictor-corrector iterations in place; ``size`` is the number of sides and limits.

    Returns:
        How they ended, their number, and gap, dual residual (both by the motion time) and excess at the end.
    """
    fraction = _CAUTIOUS_STEP_TO_BOUNDARY if settings.cautious else _STEP_TO_BOUNDARY
    gap = dual = excess = np.inf
    short, stalls = False, 0
    for iteration in range(settings.max_iterations):
        time, total, excess = look(rows, ends, at, system)
        _restrict(ends, system.gradient)
        dual, gap = np.sum(np.abs(system.gradient * at.c)) / time, total / time
        if gap < settings.tolerance and dual < settings.tolerance and excess < settings.feasibility:
            return CONVERGED, iteration, gap, dual, excess
        if not (gap < np.inf and dual < _DIVERGED and stalls < _MOST_STALLS):
            return DIVERGED, iteration, gap, dual, excess
        factor = system.band + system.convex if settings.cautious else system.band.copy()
        _restrict_band(ends, factor)
        if not _factorise(factor):
            factor = system.band + system.convex
            _restrict_band(ends, factor)
            if not _factorise(factor):
                return INDEFINITE, iteration, gap, dual, excess
        step = _direction(ends, factor, system.right)
        primal_ratio, dual_ratio, by_slack, by_dual, both = _predict(
            rows, ends, at, system, step, 0.0 if short else 1.0
        )
        primal, dual_step = _length(primal_ratio, 1.0), _length(dual_ratio, 1.0)
        reached = total + primal * by_slack + dual_step * by_dual + primal * dual_step * both
        target = max(total * (reached / total) ** 3, _CENTRALITY * dual * time) / size
        if short:
            target = max(target, _RECENTRE * total / size)
        step = _direction(ends, factor, system.right + target * system.centre)
        primal_ratio, dual_ratio, q_ratio = _correct(rows, ends, at, step, target)
        primal = min(_length(primal_ratio, fraction), _length(q_ratio, _Q_STEP_TO_ZERO))
        dual_step = _length(dual_ratio, fraction)
        short = min(primal, dual_step) < _SHORT
        stalls = stalls + 1 if primal < _STALLED else 0
        at.c[:] += primal * step
        expand(ends, at.c)
        _move(rows, at, primal, dual_step)
    return OUT_OF_ITERATIONS, settings.max_iterations, gap, dual, excess
