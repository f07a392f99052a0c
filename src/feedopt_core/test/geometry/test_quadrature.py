"""Gauss-Legendre quadrature against integrals in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from feedopt_core.geometry.quadrature import gauss_legendre


@pytest.mark.parametrize("points", [1, 3, 12, 16])
def test_polynomials_up_to_twice_the_points_are_exact(points: int) -> None:
    nodes, weights = gauss_legendre(points)
    assert nodes.shape == weights.shape == (points,)
    for degree in range(2 * points):
        assert weights @ nodes**degree == pytest.approx(1.0 / (degree + 1), rel=1e-13)


def test_the_next_degree_misses_by_the_known_remainder() -> None:
    # The remainder of n points for x^2n on [0, 1] is (n!)^4 / ((2n + 1) (2n)!^2): 1/2800 for three points.
    nodes, weights = gauss_legendre(3)
    assert 1.0 / 7.0 - weights @ nodes**6 == pytest.approx(1.0 / 2800.0, rel=1e-10)


def test_an_interval_of_any_length() -> None:
    nodes, weights = gauss_legendre(12)
    assert 2.0 * weights @ np.cos(1.0 + 2.0 * nodes) == pytest.approx(np.sin(3.0) - np.sin(1.0), rel=1e-14)
