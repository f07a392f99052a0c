"""Interpolators: exact on lines, of their order on curves, and the published construction's own promises."""

from __future__ import annotations

import numpy as np
import pytest
from benchmark.curves.parameter_maps import (
    NaturalMap,
    PredictorCorrectorMap,
    TaylorMap,
    feed_correction_map,
)

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.arc_length import map_arc_length
from feedopt_core.geometry.nurbs import NurbsCurve

LINE = NurbsCurve.from_control_net(2, np.repeat([0.0, 1.0], 3), np.array([[0.0, 0], [3, 4], [6, 8]]), np.ones(3))
PARABOLA = NurbsCurve.from_control_net(2, np.repeat([0.0, 1.0], 3), np.array([[0.0, 0], [5, 0], [10, 10]]), np.ones(3))
WAVE = NurbsCurve.from_control_net(
    3,
    np.array([0.0, 0, 0, 0, 0.4, 0.7, 1, 1, 1, 1]),
    np.array([[0.0, 0], [2, 6], [9, 5], [10, -4], [18, -3], [20, 2]]),
    np.ones(6),
)


def parabola_length_mm(u):
    """Arc length of x = 10 u, y = 10 u^2, in closed form."""
    return 10.0 * (0.5 * u * np.sqrt(1.0 + 4.0 * u**2) + 0.25 * np.arcsinh(2.0 * u))


def maps_of(curve):
    length_mm = map_arc_length(curve.evaluate, curve.joints).length_mm
    return {
        "natural": NaturalMap(curve, length_mm),
        "Taylor 1": TaylorMap(curve, 1),
        "Taylor 2": TaylorMap(curve, 2),
        "predictor-corrector": PredictorCorrectorMap(curve),
        "feed correction": feed_correction_map(curve),
        "own": map_arc_length(curve.evaluate, curve.joints),
    }


@pytest.mark.parametrize("name", maps_of(LINE))
def test_line_is_exact(name):
    s_mm = np.linspace(0.0, 10.0, 101)
    assert maps_of(LINE)[name].parameter(s_mm) == pytest.approx(s_mm / 10.0, abs=1e-12)


@pytest.mark.parametrize(("name", "order"), [("Taylor 1", 1), ("Taylor 2", 2)])
def test_taylor_series_have_their_order(name, order):
    """The drift over a fixed length falls by 2^order when the steps are halved."""
    errors = []
    for count in (100, 200, 400):
        s_mm = np.linspace(0.0, 10.0, count + 1)
        u = maps_of(PARABOLA)[name].parameter(s_mm)
        errors.append(abs(parabola_length_mm(u[-1]) - 10.0))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize(
    ("name", "error_mm"), [("predictor-corrector", 1e-6), ("own", 1e-9), ("feed correction", 5e-3)]
)
def test_arc_length_on_the_parabola(name, error_mm):
    s_mm = np.linspace(0.0, parabola_length_mm(1.0), 301)
    u = maps_of(PARABOLA)[name].parameter(s_mm)
    assert np.max(np.abs(parabola_length_mm(u) - s_mm)) < error_mm


def test_natural_interpolation_ignores_the_arc_length():
    length_mm = parabola_length_mm(1.0)
    u = NaturalMap(PARABOLA, length_mm).parameter(np.array([0.0, 0.5 * length_mm, length_mm]))
    assert u == pytest.approx([0.0, 0.5, 1.0])
    assert abs(parabola_length_mm(u[1]) - 0.5 * length_mm) > 1.0


@pytest.mark.parametrize("curve", [PARABOLA, WAVE])
def test_feed_correction_meets_its_promises(curve):
    """C2 at the joints, ends exact, and a mean squared error of u of 1e-10 at most."""
    fitted = feed_correction_map(curve)
    exact = map_arc_length(curve.evaluate, curve.joints)
    assert fitted.length_mm == pytest.approx(exact.length_mm, abs=1e-9)
    s_mm = np.linspace(0.0, exact.length_mm, 2001)
    squared = np.mean((fitted.parameter(s_mm) - exact.parameter(s_mm)) ** 2)
    assert squared < 2e-10
    lengths = np.diff(fitted.s_mm)
    for derivative, scale in enumerate((1.0, 1.0, 2.0)):
        powers = np.arange(8.0)
        factor = np.ones(8) if not derivative else powers * (powers - 1.0 if derivative == 2 else 1.0)
        at_end = fitted.coefficients @ factor / lengths**derivative
        at_start = scale * fitted.coefficients[:, derivative] / lengths**derivative
        assert at_end[:-1] == pytest.approx(at_start[1:], abs=1e-9)


def test_feed_correction_splits_where_the_speed_of_the_parameter_varies():
    assert len(feed_correction_map(LINE).coefficients) < len(feed_correction_map(WAVE).coefficients)


def test_curve_with_zero_derivative_is_refused():
    curve = NurbsCurve.from_control_net(
        2, np.array([0.0, 0, 0, 0.5, 0.5, 1, 1, 1]), np.array([[0.0, 0], [1, 0], [2, 0], [2, 0], [2, 0]]), np.ones(5)
    )
    with pytest.raises(ToolpathError, match="dr/du of the curve is zero"):
        feed_correction_map(curve)
