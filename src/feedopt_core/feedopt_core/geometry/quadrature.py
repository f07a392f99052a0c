"""Gauss-Legendre quadrature."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray


def gauss_legendre(points: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of Gauss-Legendre quadrature on [0, 1], two arrays of shape (points,).

    ``integral of f over [a, b] = (b - a) sum(weights f(a + (b - a) nodes))``, exact for polynomials up to degree
    2 points - 1. Source: Golub and Welsch, Calculation of Gauss quadrature rules, Math. Comp. 23 (1969), as
    ``numpy.polynomial.legendre.leggauss`` has it.
    """
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return (nodes + 1.0) / 2.0, weights / 2.0
