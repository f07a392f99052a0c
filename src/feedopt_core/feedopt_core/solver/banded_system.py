"""The banded linear system of the interior point by its free control points, compiled.

The outer control points follow from their neighbours (:class:`~.interior_point_data.Ends`), so they are eliminated
before the system is factorised and filled in again afterwards.
"""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.compiled import compiled
from feedopt_core.solver.interior_point_data import FIRST, MAIN, SECOND, Ends


@compiled
def restrict(ends: Ends, vector: FloatArray) -> None:
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
def restrict_band(ends: Ends, band: FloatArray) -> None:
    """Normal matrix by the free control points, in place; the others get a unit diagonal."""
    last = len(band) - 1
    if ends.start_ratio > 0.0:
        r = ends.start_ratio
        band[1, MAIN] += 2.0 * band[0, FIRST] / r + band[0, MAIN] / r**2
        band[1, FIRST] += band[0, SECOND] / r
    else:
        band[1, MAIN], band[1, FIRST], band[1, SECOND] = 1.0, 0.0, 0.0
    band[0, MAIN], band[0, FIRST], band[0, SECOND] = 1.0, 0.0, 0.0
    r = ends.end_ratio
    band[last - 1, MAIN] += 2.0 * band[last - 1, FIRST] / r + band[last, MAIN] / r**2
    band[last - 2, FIRST] += band[last - 2, SECOND] / r
    band[last, MAIN] = 1.0
    band[last - 1, FIRST] = band[last - 2, SECOND] = 0.0


@compiled
def factorise(band: FloatArray) -> bool:
    """L D L' in place (D on the diagonal); False where the matrix is not positive definite."""
    n = len(band)
    for j in range(n):
        d = band[j, MAIN]
        if not 0.0 < d < np.inf:
            return False
        l1, l2 = band[j, FIRST] / d, band[j, SECOND] / d
        if j + 1 < n:
            band[j + 1, MAIN] -= l1 * band[j, FIRST]
            band[j + 1, FIRST] -= l1 * band[j, SECOND]
        if j + 2 < n:
            band[j + 2, MAIN] -= l2 * band[j, SECOND]
        band[j, FIRST], band[j, SECOND] = l1, l2
    return True


@compiled
def solve(factor: FloatArray, vector: FloatArray) -> None:
    """Solve in place with the factor of :func:`factorise`."""
    n = len(vector)
    for j in range(n):
        if j + 1 < n:
            vector[j + 1] -= factor[j, FIRST] * vector[j]
        if j + 2 < n:
            vector[j + 2] -= factor[j, SECOND] * vector[j]
    for j in range(n - 1, -1, -1):
        value = vector[j] / factor[j, MAIN]
        if j + 1 < n:
            value -= factor[j, FIRST] * vector[j + 1]
        if j + 2 < n:
            value -= factor[j, SECOND] * vector[j + 2]
        vector[j] = value


@compiled
def direction(ends: Ends, factor: FloatArray, right: FloatArray) -> FloatArray:
    """Step of all control points from the factor and the right side of the system."""
    step = -right
    restrict(ends, step)
    solve(factor, step)
    expand(ends, step)
    return step
