"""The smoothest quintic B-spline in a tube: least integral of |r'''|^2 with every site within its tolerance.

    minimise   integral |r'''(u)|^2 du      subject to   |r(u_j) - p_j| <= tolerance_j   for every site j

The conditions of its optimum are those of a penalised least-squares spline whose weights are the multipliers: above
zero where a site touches the tube, zero elsewhere. So the weights are found by multiplying each with distance over
tolerance, which is exact where the force of a site on the curve stays the same; every step is one banded solve that all
coordinates share.
"""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.compiled import compiled
from feedopt_core.geometry.quadrature import gauss_legendre

DEGREE = 5
_MAIN = 0
"""Column of the main diagonal of a banded matrix; column k holds the k-th one above it."""
_ORDER = DEGREE + 1
_SMOOTHEST_SPANS = 6.0
_INTERPOLATING_SPANS = 0.05
_STEP_DOWN = 0.4
_STEP_UP = 4.0
_AIM = 0.97
# Exact for the square of a third derivative, which is of degree 4 in a span.
_NODES, _WEIGHTS = gauss_legendre(3)


@compiled
def _basis(knots: FloatArray, span: int, u: float, degree: int, out: FloatArray) -> None:
    """The degree + 1 B-splines that are not zero on a knot span, at u (Cox-de Boor)."""
    left = np.empty(degree + 1)
    right = np.empty(degree + 1)
    out[0] = 1.0
    for j in range(1, degree + 1):
        left[j] = u - knots[span + 1 - j]
        right[j] = knots[span + j] - u
        saved = 0.0
        for i in range(j):
            share = out[i] / (right[i + 1] + left[j - i])
            out[i] = saved + right[i + 1] * share
            saved = left[j - i] * share
        out[j] = saved


@compiled
def site_basis(knots: FloatArray, u: FloatArray) -> tuple[IntArray, FloatArray]:
    """First control point and the six basis values of each site, shapes (n,) and (n, 6); u does not decrease."""
    count = len(knots) - _ORDER
    first = np.empty(len(u), dtype=np.int64)
    values = np.empty((len(u), _ORDER))
    span = DEGREE
    for j in range(len(u)):
        while span < count - 1 and u[j] >= knots[span + 1]:
            span += 1
        _basis(knots, span, u[j], DEGREE, values[j])
        first[j] = span - DEGREE
    return first, values


@compiled
def roughness(knots: FloatArray) -> FloatArray:
    """Upper bands of the matrix H with ``integral |r'''|^2 du = P^T H P``: entry [i, k] is H[i, i + k]; (n, 6)."""
    count = len(knots) - _ORDER
    bands = np.zeros((count, _ORDER))
    third = np.empty((3, _ORDER))
    work = np.empty((_ORDER, _ORDER))
    quadratic = np.empty(3)
    for span in range(DEGREE, count):
        width = knots[span + 1] - knots[span]
        work[:] = 0.0
        for i in range(_ORDER):
            work[i, i] = 1.0
        # The control points of the third derivative, each a combination of the six of the curve.
        for derivative in range(3):
            degree = DEGREE - derivative
            for i in range(degree):
                low = span - degree + 1 + i
                factor = degree / (knots[low + degree] - knots[low])
                for k in range(_ORDER):
                    work[i, k] = factor * (work[i + 1, k] - work[i, k])
        for g in range(3):
            u = knots[span] + width * _NODES[g]
            _basis(knots, span, u, 2, quadratic)
            for k in range(_ORDER):
                third[g, k] = quadratic[0] * work[0, k] + quadratic[1] * work[1, k] + quadratic[2] * work[2, k]
        for g in range(3):
            for a in range(_ORDER):
                for b in range(a, _ORDER):
                    bands[span - DEGREE + a, b - a] += _WEIGHTS[g] * width * third[g, a] * third[g, b]
    return bands


@compiled
def _solve_banded(bands: FloatArray, right: FloatArray, low: int, high: int) -> bool:
    """Solve in place by Cholesky for the unknowns low to high; bands as in ``roughness``. False if not positive."""
    for i in range(low, high):
        for k in range(min(_ORDER, high - i)):
            value = bands[i, k]
            for m in range(max(low, i + k - DEGREE), i):
                value -= bands[m, i - m] * bands[m, i + k - m]
            if k == 0:
                if not value > 0.0:
                    return False
                bands[i, _MAIN] = np.sqrt(value)
            else:
                bands[i, k] = value / bands[i, _MAIN]
    dimensions = right.shape[1]
    for i in range(low, high):
        for m in range(max(low, i - DEGREE), i):
            for c in range(dimensions):
                right[i, c] -= bands[m, i - m] * right[m, c]
        for c in range(dimensions):
            right[i, c] /= bands[i, _MAIN]
    for i in range(high - 1, low - 1, -1):
        for m in range(i + 1, min(i + _ORDER, high)):
            for c in range(dimensions):
                right[i, c] -= bands[i, m - i] * right[m, c]
        for c in range(dimensions):
            right[i, c] /= bands[i, _MAIN]
    return True


@compiled
def _improve(
    control: FloatArray,
    rough: FloatArray,
    basis: tuple[IntArray, FloatArray],
    weights: FloatArray,
    residual: FloatArray,
    free: tuple[int, int],
) -> bool:
    """Newton step of the weighted problem for the free control points, which is its solution; residual is p - r."""
    first, values = basis
    low, high = free
    count, dimensions = control.shape
    bands = rough.copy()
    right = np.zeros((count, dimensions))
    for i in range(count):
        for c in range(dimensions):
            right[i, c] -= rough[i, _MAIN] * control[i, c]
        for k in range(1, min(_ORDER, count - i)):
            for c in range(dimensions):
                right[i, c] -= rough[i, k] * control[i + k, c]
                right[i + k, c] -= rough[i, k] * control[i, c]
    for j in range(len(weights)):
        for a in range(_ORDER):
            row = first[j] + a
            weighted = weights[j] * values[j, a]
            for b in range(a, _ORDER):
                bands[row, b - a] += weighted * values[j, b]
            for c in range(dimensions):
                right[row, c] += weighted * residual[j, c]
    if not _solve_banded(bands, right, low, high):
        return False
    for i in range(low, high):
        for c in range(dimensions):
            control[i, c] += right[i, c]
    return True


@compiled
def _residuals(
    control: FloatArray, basis: tuple[IntArray, FloatArray], points_mm: FloatArray, residual: FloatArray
) -> None:
    first, values = basis
    for j in range(len(first)):
        for c in range(control.shape[1]):
            value = points_mm[j, c]
            for a in range(_ORDER):
                value -= values[j, a] * control[first[j] + a, c]
            residual[j, c] = value


@compiled
def site_weights(knots: FloatArray, u: FloatArray, follow_spans: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Initial weights, and their lower and upper bounds, shape (m,) each.

    A penalised spline follows what is longer than about 6 l where the weight a unit of length is l^-6; the weights to
    start from have l at that many spans.
    """
    sites = len(u)
    first, least, most = np.empty(sites), np.empty(sites), np.empty(sites)
    span = DEGREE
    for j in range(sites):
        while span < len(knots) - _ORDER - 1 and u[j] >= knots[span + 1]:
            span += 1
        share = 0.5 * (u[min(j + 1, sites - 1)] - u[max(j - 1, 0)])
        per_length = share / (knots[span + 1] - knots[span]) ** 6
        first[j] = per_length / follow_spans**6
        least[j] = per_length / _SMOOTHEST_SPANS**6
        most[j] = per_length / _INTERPOLATING_SPANS**6
    return first, least, most


@compiled
def fit_in_tube(
    knots: FloatArray,
    sites: tuple[FloatArray, FloatArray, FloatArray],
    control: FloatArray,
    free: tuple[int, int],
    weights: FloatArray,
    steps: int,
) -> None:
    """Move the free control points to the smoothest curve in the tube.

    Args:
        knots: clamped, shape (n + 6,).
        sites: parameters (not decreasing, shape (m,)), points (shape (m, d), mm) and tolerances (shape (m,), mm).
        control: control points, shape (n, d); the free ones are overwritten.
        free: first free control point, and the first one after them.
        weights: of the sites, to start from; overwritten by those to go on from, shape (m,).
        steps: solves, at least one.
    """
    u, points_mm, tolerance_mm = sites
    basis = site_basis(knots, u)
    rough = roughness(knots)
    _, least, most = site_weights(knots, u, 1.0)
    residual = np.empty_like(points_mm)
    ratio = np.empty(len(u))
    best = np.inf
    kept = control.copy()
    kept_weights = weights.copy()
    for _ in range(steps):
        _residuals(control, basis, points_mm, residual)
        if not _improve(control, rough, basis, weights, residual, free):
            break
        _residuals(control, basis, points_mm, residual)
        worst = 0.0
        for j in range(len(u)):
            square = 0.0
            for c in range(points_mm.shape[1]):
                square += residual[j, c] ** 2
            ratio[j] = np.sqrt(square) / tolerance_mm[j]
            worst = max(worst, ratio[j])
        # The last curve inside the tube is the smoothest one found; outside it, the closest.
        closest = worst <= max(1.0, best)
        for j in range(len(u)):
            factor = min(max(ratio[j] / _AIM, _STEP_DOWN), _STEP_UP)
            weights[j] = min(max(weights[j] * factor, least[j]), most[j])
        if closest:
            best = worst
            kept[:] = control
            kept_weights[:] = weights
    control[:] = kept
    weights[:] = kept_weights
