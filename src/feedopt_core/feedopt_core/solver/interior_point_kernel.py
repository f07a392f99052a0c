"""The passes of the interior point over spans, points, rows and sides, compiled.

Every point of every span has n two-sided rows. They are functions of q, q' and q'' there. With x = (q, q', q'') and
D = linear + sqrt(q) bend,

    y = linear x + sqrt(q) (root + bend x),    -limit_down <= y <= limit_up

A side is linearised as ``sigma D + beta (1, 0, 0)`` with its residual exact, so its factor of q, a sign and two numbers
a row are all that the normal matrix needs. Sums of a point are taken by x and turned to control points once. Rows with
a bend are divided by sqrt(q) before they are linearised: y / sqrt(q) is linear in q'', and its right side
limit / sqrt(q) is convex, so that the linearisation lies inside the limit.

Everything is written out in scalars, and data used together lie together in memory: that makes it fast.
"""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.compiled import compiled
from feedopt_core.solver.banded_system import direction, expand, factorise, restrict, restrict_band
from feedopt_core.solver.interior_point_data import (
    BEND,
    DOWN,
    FIRST,
    MAIN,
    SECOND,
    SLOPE,
    UP,
    VALUE,
    Ends,
    Iterate,
    PackedRows,
    Settings,
    System,
)

CONVERGED, OUT_OF_ITERATIONS, DIVERGED, INDEFINITE = 0, 1, 2, 3
"""How the iterations ended."""
_STEP_TO_BOUNDARY, _CAUTIOUS_STEP_TO_BOUNDARY = 0.995, 0.9
_Q_STEP_TO_ZERO = 0.9
_DIVERGED = 1e8
"""Dual residual above which the iterations are given up."""
_SHORT, _RECENTRE = 0.2, 0.5
"""After a step shorter than the first value, the next one aims at the second value times the gap, without second-order
terms."""
_STALLED, _MOST_STALLS = 1e-3, 8
"""Length of a stalled primal step, and the number of such steps in a row after which the iterations are given up."""
_CENTRALITY = 0.5
"""Least target of the duality gap, as a part of the dual residual: a gap far below the residual makes steps short."""


@compiled
def _three(factors: FloatArray) -> tuple[float, float, float]:
    """Factors of the three control points of a span."""
    return factors[0], factors[1], factors[-1]


@compiled
def _assemble(  # noqa: PLR0915 -- scalars
    rows: PackedRows, at: Iterate, system: System, primal: float, dual_step: float
) -> tuple[float, float, float]:
    """Residuals, gradient, right side of the predictor and normal matrix, after the last steps of slacks and duals.

    A slack is raised where y leaves more of the limit than that.

    Returns:
        Motion time (NaN where q is not positive), sum of slack times multiplier, largest violation of a limit.
    """
    basis, weights, first, counts, coefficients, limits, over_root = rows
    gradient, right, _, band, convex = system
    sides, linearised = at.sides, at.linearised
    spans, points = weights.shape
    time = gap = violation = 0.0
    gradient[:], right[:], band[:], convex[:] = 0.0, 0.0, 0.0, 0.0
    for k in range(spans):
        c0, c1, c2 = at.c[k], at.c[k + 1], at.c[k + 2]
        for p in range(points):
            if weights[k, p] == 0.0:
                continue
            v0, v1, v2 = _three(basis[k, p, VALUE])
            s0, s1, s2 = _three(basis[k, p, SLOPE])
            n0, n1, n2 = _three(basis[k, p, BEND])
            q, slope, bend = v0 * c0 + v1 * c1 + v2 * c2, s0 * c0 + s1 * c1 + s2 * c2, n0 * c0 + n1 * c1 + n2 * c2
            if not q > 0.0:
                return np.nan, gap, violation
            root, half_over_q = np.sqrt(q), 0.5 / q
            half_over_root = half_over_q * root
            weighted = 2.0 * weights[k, p] * half_over_root
            time += weighted
            g0 = r0 = -weighted * half_over_q
            exact = positive = 3.0 * weighted * half_over_q * half_over_q
            g1 = g2 = r1 = r2 = h0 = h1 = m00 = m01 = m02 = m11 = m12 = m22 = 0.0
            for r in range(first[k, p], first[k, p] + counts[k, p]):
                row = coefficients[r]
                l0, l1, on_root = row.on_q, row.on_slope, row.on_root
                d0, d1, d2 = l0, l1, 0.0
                divided = over_root[r] > 0.0
                if divided:
                    d0 += root * row.on_root_q
                    d1 += root * row.on_root_slope
                    d2 = root * row.on_root_bend
                y, straight = d0 * q + d1 * slope + d2 * bend + on_root * root, l0 * q + l1 * slope
                linearised[r].on_slope, linearised[r].on_bend = d1, d2
                dual_0 = dual_d = pull_0 = pull_d = omega_0 = omega_d = omega_dd = bent = 0.0
                for side in (UP, DOWN):
                    sigma = limits[r, side]
                    if sigma == 0.0:
                        continue
                    if side == DOWN:
                        sigma = -sigma
                    state = sides[r, side]
                    over = sigma * y - 1.0
                    violation = max(violation, over)
                    slack = max(state.slack + primal * state.d_slack, -over)
                    dual = state.dual + dual_step * state.d_dual
                    residual = over + slack
                    omega = dual / slack
                    pull = omega * residual
                    bending = dual * half_over_q
                    if divided:
                        beta = (1.0 - sigma * straight) * half_over_q
                        curvature = -3.0 * bending * beta
                        bent -= bending * sigma
                    else:
                        beta = sigma * on_root * half_over_root
                        curvature = -bending * beta
                    on_q = sigma * d0 + beta
                    state.slack, state.dual, state.residual, state.on_q = slack, dual, residual, on_q
                    gap += slack * dual
                    exact += curvature
                    positive += max(curvature, 0.0)
                    dual_0 += dual * on_q
                    dual_d += dual * sigma
                    pull_0 += pull * on_q
                    pull_d += pull * sigma
                    omega_q, omega_s = omega * on_q, omega * sigma
                    omega_0 += omega_q * on_q
                    omega_d += omega_s * on_q
                    omega_dd += omega_s * sigma
                g0, g1, g2 = g0 + dual_0, g1 + dual_d * d1, g2 + dual_d * d2
                r0, r1, r2 = r0 + pull_0, r1 + pull_d * d1, r2 + pull_d * d2
                h0, h1 = h0 + bent * l0, h1 + bent * l1
                e1, e2 = omega_dd * d1, omega_dd * d2
                m00, m01, m02 = m00 + omega_0, m01 + omega_d * d1, m02 + omega_d * d2
                m11, m12, m22 = m11 + e1 * d1, m12 + e1 * d2, m22 + e2 * d2
            gradient[k] += g0 * v0 + g1 * s0 + g2 * n0
            gradient[k + 1] += g0 * v1 + g1 * s1 + g2 * n1
            gradient[k + 2] += g0 * v2 + g1 * s2 + g2 * n2
            right[k] += r0 * v0 + r1 * s0 + r2 * n0
            right[k + 1] += r0 * v1 + r1 * s1 + r2 * n1
            right[k + 2] += r0 * v2 + r1 * s2 + r2 * n2
            # The convex part leaves out what h and negative curvature add.
            x00, m00, m01 = positive - exact - 2.0 * h0, m00 + exact + 2.0 * h0, m01 + h1
            half = 0.5 * x00
            x0, x1, x2 = half * v0 - h1 * s0, half * v1 - h1 * s1, half * v2 - h1 * s2
            convex[k, MAIN] += 2.0 * x0 * v0
            convex[k, FIRST] += x0 * v1 + x1 * v0
            convex[k, SECOND] += x0 * v2 + x2 * v0
            convex[k + 1, MAIN] += 2.0 * x1 * v1
            convex[k + 1, FIRST] += x1 * v2 + x2 * v1
            convex[k + 2, MAIN] += 2.0 * x2 * v2
            x0, x1, x2 = m00 * v0 + m01 * s0 + m02 * n0, m00 * v1 + m01 * s1 + m02 * n1, m00 * v2 + m01 * s2 + m02 * n2
            y0, y1, y2 = m01 * v0 + m11 * s0 + m12 * n0, m01 * v1 + m11 * s1 + m12 * n1, m01 * v2 + m11 * s2 + m12 * n2
            z0, z1, z2 = m02 * v0 + m12 * s0 + m22 * n0, m02 * v1 + m12 * s1 + m22 * n1, m02 * v2 + m12 * s2 + m22 * n2
            band[k, MAIN] += v0 * x0 + s0 * y0 + n0 * z0
            band[k, FIRST] += v0 * x1 + s0 * y1 + n0 * z1
            band[k, SECOND] += v0 * x2 + s0 * y2 + n0 * z2
            band[k + 1, MAIN] += v1 * x1 + s1 * y1 + n1 * z1
            band[k + 1, FIRST] += v1 * x2 + s1 * y2 + n1 * z2
            band[k + 2, MAIN] += v2 * x2 + s2 * y2 + n2 * z2
    return time, gap, violation


@compiled
def _add_ends(ends: Ends, at: Iterate, system: System, primal: float, dual_step: float) -> tuple[float, float]:
    """Do the work of :func:`_assemble` for the limits of the outer control points; returns their gap and violation."""
    gap = violation = 0.0
    last = len(at.c) - 1
    for end in range(2):
        inverse = ends.end_inverse_limit if end else ends.start_inverse_limit
        if inverse == 0.0:
            continue
        place = last if end else 0
        state = at.ends[end]
        over, dual = inverse * at.c[place] - 1.0, state.dual + dual_step * state.d_dual
        slack = max(state.slack + primal * state.d_slack, -over)
        state.slack, state.dual, state.residual = slack, dual, over + slack
        gap += slack * dual
        violation = max(violation, over)
        system.gradient[place] += inverse * dual
        system.right[place] += inverse * dual / slack * (over + slack)
        system.band[place, MAIN] += inverse * inverse * dual / slack
    return gap, violation


@compiled
def _predict(
    rows: PackedRows, ends: Ends, at: Iterate, system: System, step: FloatArray, weight: float
) -> tuple[float, float, float, float]:
    """Evaluate the predictor step: replaces the right side by that of the corrector and sets its centre.

    ``weight`` is that of the second-order terms: 1, or 0 to leave them out.

    Returns:
        Smallest and largest ratio of a slack's step to the slack; sums of d_slack * dual and of d_slack * d_dual.
    """
    basis, first, counts, limits = rows.basis, rows.first, rows.counts, rows.inverse_limits
    _, right, centre, _, _ = system
    sides, linearised = at.sides, at.linearised
    spans, points = counts.shape
    least = most = by_slack = both = 0.0
    centre[:] = 0.0
    for k in range(spans):
        c0, c1, c2 = step[k], step[k + 1], step[k + 2]
        for p in range(points):
            if counts[k, p] == 0:
                continue
            v0, v1, v2 = _three(basis[k, p, VALUE])
            s0, s1, s2 = _three(basis[k, p, SLOPE])
            n0, n1, n2 = _three(basis[k, p, BEND])
            dq, d_slope, d_bend = (
                v0 * c0 + v1 * c1 + v2 * c2,
                s0 * c0 + s1 * c1 + s2 * c2,
                n0 * c0 + n1 * c1 + n2 * c2,
            )
            r0 = r1 = r2 = m0 = m1 = m2 = 0.0
            for r in range(first[k, p], first[k, p] + counts[k, p]):
                d1, d2 = linearised[r].on_slope, linearised[r].on_bend
                dd = d1 * d_slope + d2 * d_bend
                right_d = centre_d = 0.0
                for side in (UP, DOWN):
                    sigma = limits[r, side]
                    if sigma == 0.0:
                        continue
                    if side == DOWN:
                        sigma = -sigma
                    state = sides[r, side]
                    dual, on_q, inverse = state.dual, state.on_q, 1.0 / state.slack
                    d_slack = -state.residual - sigma * dd - on_q * dq
                    relative = d_slack * inverse
                    product = -d_slack * dual * (1.0 + relative)
                    second = weight * product
                    state.second_order = second
                    least, most = min(least, relative), max(most, relative)
                    by_slack += d_slack * dual
                    both += product
                    pull = second * inverse
                    r0 -= on_q * pull
                    right_d -= sigma * pull
                    m0 += on_q * inverse
                    centre_d += sigma * inverse
                r1, r2 = r1 + right_d * d1, r2 + right_d * d2
                m1, m2 = m1 + centre_d * d1, m2 + centre_d * d2
            right[k] += r0 * v0 + r1 * s0 + r2 * n0
            right[k + 1] += r0 * v1 + r1 * s1 + r2 * n1
            right[k + 2] += r0 * v2 + r1 * s2 + r2 * n2
            centre[k] += m0 * v0 + m1 * s0 + m2 * n0
            centre[k + 1] += m0 * v1 + m1 * s1 + m2 * n1
            centre[k + 2] += m0 * v2 + m1 * s2 + m2 * n2
    for end in range(2):
        inverse_limit = ends.end_inverse_limit if end else ends.start_inverse_limit
        if inverse_limit == 0.0:
            continue
        place = len(at.c) - 1 if end else 0
        state = at.ends[end]
        d_slack = -state.residual - inverse_limit * step[place]
        relative = d_slack / state.slack
        d_dual = -state.dual * (1.0 + relative)
        least, most = min(least, relative), max(most, relative)
        state.second_order = weight * d_slack * d_dual
        by_slack += d_slack * state.dual
        both += d_slack * d_dual
        right[place] -= inverse_limit * state.second_order / state.slack
        centre[place] += inverse_limit / state.slack
    return least, most, by_slack, both


@compiled
def _correct(rows: PackedRows, ends: Ends, at: Iterate, step: FloatArray, target: float) -> tuple[float, float, float]:
    """Set the corrector's steps of slacks and multipliers; returns inverses of the longest primal, dual and q step."""
    basis, weights, first, counts, _, limits, _ = rows
    sides, linearised = at.sides, at.linearised
    spans, points = counts.shape
    primal = dual_ratio = q_ratio = 0.0
    for k in range(spans):
        c0, c1, c2 = step[k], step[k + 1], step[k + 2]
        for p in range(points):
            if weights[k, p] == 0.0:
                continue
            v0, v1, v2 = _three(basis[k, p, VALUE])
            s0, s1, s2 = _three(basis[k, p, SLOPE])
            n0, n1, n2 = _three(basis[k, p, BEND])
            dq = v0 * c0 + v1 * c1 + v2 * c2
            d_slope = s0 * c0 + s1 * c1 + s2 * c2
            d_bend = n0 * c0 + n1 * c1 + n2 * c2
            q_ratio = max(q_ratio, -dq / (v0 * at.c[k] + v1 * at.c[k + 1] + v2 * at.c[k + 2]))
            for r in range(first[k, p], first[k, p] + counts[k, p]):
                dd = linearised[r].on_slope * d_slope + linearised[r].on_bend * d_bend
                for side in (UP, DOWN):
                    sigma = limits[r, side]
                    if sigma == 0.0:
                        continue
                    if side == DOWN:
                        sigma = -sigma
                    state = sides[r, side]
                    dual = state.dual
                    inverse = 1.0 / (state.slack * dual)
                    d_slack = -state.residual - sigma * dd - state.on_q * dq
                    aim = target - state.second_order - dual * d_slack
                    state.d_slack, state.d_dual = d_slack, aim * dual * inverse - dual
                    primal = max(primal, -d_slack * dual * inverse)
                    dual_ratio = max(dual_ratio, 1.0 - aim * inverse)
    for end in range(2):
        inverse_limit = ends.end_inverse_limit if end else ends.start_inverse_limit
        if inverse_limit == 0.0:
            continue
        place = len(at.c) - 1 if end else 0
        state = at.ends[end]
        slack, dual = state.slack, state.dual
        d_slack = -state.residual - inverse_limit * step[place]
        d_dual = (target - state.second_order - dual * d_slack) / slack - dual
        state.d_slack, state.d_dual = d_slack, d_dual
        primal, dual_ratio = max(primal, -d_slack / slack), max(dual_ratio, -d_dual / dual)
    return primal, dual_ratio, q_ratio


@compiled
def _look(
    rows: PackedRows, ends: Ends, at: Iterate, system: System, primal: float, dual_step: float
) -> tuple[float, float, float]:
    """Take the last steps of slacks and multipliers and set the linear system at the iterate.

    Args:
        rows, ends, at, system: control points of ``at`` already moved.
        primal, dual_step: lengths of the steps of slacks and multipliers.

    Returns:
        Motion time, sum of slack times multiplier, largest violation of a limit.
    """
    time, total, violation = _assemble(rows, at, system, primal, dual_step)
    end_total, end_violation = _add_ends(ends, at, system, primal, dual_step)
    return time, total + end_total, max(violation, end_violation)


@compiled
def _length(ratio: float, fraction: float) -> float:
    """Longest step in (0, 1] whose inverse ratio leaves ``1 - fraction`` of every value."""
    return min(1.0, fraction / ratio) if ratio > 0.0 else 1.0


@compiled
def iterate(
    rows: PackedRows, ends: Ends, at: Iterate, system: System, size: int, share: float, settings: Settings
) -> tuple[int, int, float, float, float]:
    """Predictor-corrector iterations in place.

    Args:
        rows, ends, at, system: the problem; ``at`` holds the first iterate, then the last one.
        size: number of sides, with the limits of the outer control points.
        share: that number by the one of the whole problem.
        settings: when to end.

    Returns:
        How they ended, their number, and gap, dual residual (both by the motion time) and violation at the end.
    """
    fraction = _CAUTIOUS_STEP_TO_BOUNDARY if settings.cautious else _STEP_TO_BOUNDARY
    gap = dual = violation = np.inf
    primal = dual_step = 0.0
    short, stalls = False, 0
    for iteration in range(settings.max_iterations):
        time, total, violation = _look(rows, ends, at, system, primal, dual_step)
        restrict(ends, system.gradient)
        dual, gap = np.sum(np.abs(system.gradient * at.c)) / time, total / time
        if gap < settings.tolerance and dual < settings.tolerance and violation < settings.feasibility:
            return CONVERGED, iteration, gap, dual, violation
        if not (gap < np.inf and dual < _DIVERGED and stalls < _MOST_STALLS):
            return DIVERGED, iteration, gap, dual, violation
        factor = system.band + system.convex if settings.cautious else system.band.copy()
        restrict_band(ends, factor)
        if not factorise(factor):
            factor = system.band + system.convex
            restrict_band(ends, factor)
            if not factorise(factor):
                return INDEFINITE, iteration, gap, dual, violation
        step = direction(ends, factor, system.right)
        least, most, by_slack, both = _predict(rows, ends, at, system, step, 0.0 if short else 1.0)
        # Along the predictor slack * d_dual + d_slack * dual = -slack * dual: the sums and ratios of the dual follow.
        primal, dual_step = _length(-least, 1.0), _length(1.0 + most, 1.0)
        reached = total + primal * by_slack - dual_step * (total + by_slack) + primal * dual_step * both
        target = max(total * (reached / total) ** 3, _CENTRALITY * share * dual * time) / size
        if short:
            target = max(target, _RECENTRE * total / size)
        step = direction(ends, factor, system.right + target * system.centre)
        primal_ratio, dual_ratio, q_ratio = _correct(rows, ends, at, step, target)
        primal = min(_length(primal_ratio, fraction), _length(q_ratio, _Q_STEP_TO_ZERO))
        dual_step = _length(dual_ratio, fraction)
        short = min(primal, dual_step) < _SHORT
        stalls = stalls + 1 if primal < _STALLED else 0
        at.c[:] += primal * step
        expand(ends, at.c)
    return OUT_OF_ITERATIONS, settings.max_iterations, gap, dual, violation
