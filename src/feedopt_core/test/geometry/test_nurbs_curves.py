"""NURBS curves: a rational circle, derivatives, refusals; and the map from arc length to the parameter."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from core_paths import central_difference
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.arc_length import TOLERANCE_MM, map_arc_length
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.geometry.segments import NurbsSegment, SegmentPlace

RADIUS_MM = 7.0


def segment_of(curve: NurbsCurve) -> NurbsSegment:
    return NurbsSegment(SegmentPlace(1, 1, 0.0, last=True), curve, map_arc_length(curve.evaluate, curve.joints))


def circle() -> NurbsCurve:
    """Full circle as nine weighted points of a quadratic NURBS (the textbook form)."""
    corner = np.sqrt(0.5)
    net = RADIUS_MM * np.array(
        [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], dtype=float
    )
    weights = np.array([1, corner, 1, corner, 1, corner, 1, corner, 1])
    knots = np.array([0, 0, 0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75, 1, 1, 1])
    return NurbsCurve.from_control_net(2, knots, net, weights)


def wave(degree: int = 3, weights: FloatArray | None = None) -> NurbsCurve:
    """A bent curve of two or more spans."""
    net = np.array([[0, 0], [5, 8], [12, -6], [20, 7], [26, 1], [30, 4]], dtype=float)
    inner = np.linspace(0.0, 1.0, len(net) - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.ones(degree)])
    return NurbsCurve.from_control_net(degree, knots, net, np.ones(len(net)) if weights is None else weights)


def true_length(curve: NurbsCurve, end_u: float) -> float:
    """Arc length from the start by adaptive quadrature, knot span by knot span."""
    inner = [float(u) for u in curve.joints if u < end_u]
    edges = [*inner, end_u]

    def speed(u: float) -> float:
        return float(np.linalg.norm(curve.evaluate(np.array([u]))[1][0]))

    pieces = pairwise(edges)
    return sum(quad(speed, low, high, epsabs=1e-13, epsrel=1e-13, limit=200)[0] for low, high in pieces)


def test_rational_circle_is_a_circle() -> None:
    segment = segment_of(circle())
    assert segment.length_mm == pytest.approx(2.0 * np.pi * RADIUS_MM, abs=1e-9)
    s = np.linspace(0.0, segment.length_mm, 200)
    points = segment.evaluate(s)
    angle = s / RADIUS_MM
    radial = np.column_stack([np.cos(angle), np.sin(angle)])
    tangent = np.column_stack([-np.sin(angle), np.cos(angle)])
    assert np.allclose(points.r_mm, RADIUS_MM * radial, atol=1e-9)
    assert np.allclose(points.dr_ds, tangent, atol=1e-10)
    assert np.allclose(points.d2r_ds2, -radial / RADIUS_MM, atol=1e-10)
    assert np.allclose(points.d3r_ds3, -tangent / RADIUS_MM**2, atol=1e-10)


def test_joints_of_the_circle_are_its_quarters() -> None:
    quarters = 2.0 * np.pi * RADIUS_MM * np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    assert np.allclose(segment_of(circle()).joints_mm, quarters, atol=1e-9)


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
@pytest.mark.parametrize("rational", [False, True])
def test_derivatives_with_respect_to_the_parameter(degree: int, rational: bool) -> None:
    weights = np.array([1.0, 0.6, 2.0, 1.0, 1.7, 0.9]) if rational else None
    curve = wave(degree, weights)
    step = 1e-4
    for u in (curve.joints[:-1] + curve.joints[1:]) / 2.0:
        around = curve.evaluate(u + step * np.arange(-3, 4))
        here = curve.evaluate(np.array([u]))
        for order in range(3):
            scale = 1.0 + float(np.max(np.abs(here[order + 1])))
            assert np.allclose(central_difference(around[order], step), here[order + 1][0], atol=1e-7 * scale)


@pytest.mark.parametrize("degree", [3, 4])
@pytest.mark.parametrize("rational", [False, True])
def test_derivatives_with_respect_to_arc_length(degree: int, rational: bool) -> None:
    segment = segment_of(wave(degree, np.array([1.0, 0.6, 2.0, 1.0, 1.7, 0.9]) if rational else None))
    step = 0.01
    joints = segment.joints_mm
    for at in np.concatenate([(joints[:-1] + joints[1:]) / 2.0, joints[:-1] + 0.5, joints[1:] - 0.5]):
        around = segment.evaluate(at + step * np.arange(-3, 4))
        here = segment.evaluate(np.array([at]))
        assert abs(np.linalg.norm(here.dr_ds[0]) - 1.0) < 1e-13
        assert np.allclose(central_difference(around.r_mm, step), here.dr_ds[0], atol=2e-8)
        assert np.allclose(central_difference(around.dr_ds, step), here.d2r_ds2[0], atol=2e-8)
        assert np.allclose(central_difference(around.d2r_ds2, step), here.d3r_ds3[0], atol=2e-7)


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_map_error_stays_below_its_bound(degree: int) -> None:
    curve = wave(degree, np.array([1.0, 0.6, 2.0, 1.0, 1.7, 0.9]))
    arc_length = map_arc_length(curve.evaluate, curve.joints)
    assert arc_length.error_mm <= TOLERANCE_MM
    assert arc_length.length_mm == pytest.approx(true_length(curve, 1.0), abs=1e-10)
    # Stretches between the points the map checks itself at.
    for s in np.linspace(0.0, arc_length.length_mm, 38)[1:-1]:
        u = float(arc_length.parameter(np.array([s]))[0])
        assert abs(true_length(curve, u) - s) < 2.0 * TOLERANCE_MM


@settings(max_examples=25)
@given(st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=3, max_size=6))
def test_map_error_of_random_curves(steps: list[tuple[float, float]]) -> None:
    """Control points that always go on in x, so the curve never stands still."""
    net = np.cumsum(np.array([[3.0 + dx, dy] for dx, dy in [(0.0, 0.0), *steps]]), axis=0)
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, len(net) - 2), np.ones(3)])
    curve = NurbsCurve.from_control_net(3, knots, net, np.ones(len(net)))
    segment = segment_of(curve)
    assert segment.length_mm == pytest.approx(true_length(curve, 1.0), abs=1e-10)
    s = 0.37 * segment.length_mm
    u = float(segment.arc_length_map.parameter(np.array([s]))[0])
    assert abs(true_length(curve, u) - s) < 2.0 * TOLERANCE_MM


def test_map_is_increasing_and_reaches_both_ends() -> None:
    curve = wave()
    arc_length = map_arc_length(curve.evaluate, curve.joints)
    u = arc_length.parameter(np.linspace(0.0, arc_length.length_mm, 1000))
    assert np.all(np.diff(u) > 0.0)
    assert (u[0], u[-1]) == (pytest.approx(0.0, abs=1e-15), pytest.approx(1.0, abs=1e-12))


def test_looser_tolerance_takes_fewer_pieces() -> None:
    curve = wave()
    fine = map_arc_length(curve.evaluate, curve.joints, 1e-10)
    coarse = map_arc_length(curve.evaluate, curve.joints, 1e-3)
    assert len(coarse.s_mm) < len(fine.s_mm)
    assert coarse.error_mm <= 1e-3


def test_curve_that_stands_still_is_refused() -> None:
    net = np.array([[1.0, 2.0]] * 4)
    curve = NurbsCurve.from_control_net(3, np.array([0.0] * 4 + [1.0] * 4), net, np.ones(4))
    with pytest.raises(ToolpathError, match="turns round on the spot"):
        map_arc_length(curve.evaluate, curve.joints)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"degree": 1}, "needs degree >= 2"),
        ({"net": np.zeros((3, 2))}, "needs degree >= 2 and more points"),
        ({"knots": np.linspace(0.0, 1.0, 9)}, "needs 8 knots.* has 9 and 4"),
        ({"weights": np.ones(3)}, "needs 8 knots.* has 8 and 3"),
        ({"weights": np.array([1.0, 0.0, 1.0, 1.0])}, "NURBS weight 1 is 0, must be above zero"),
        ({"weights": np.array([1.0, 1.0, 1.0, -2.0])}, "NURBS weight 3 is -2, must be above zero"),
        ({"weights": np.array([1.0, np.nan, 1.0, 1.0])}, "weights"),
        ({"net": np.array([[0.0, 0.0], [1.0, np.inf], [2.0, 0.0], [3.0, 0.0]])}, "control points"),
        ({"knots": np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, np.nan, 1.0])}, "knots"),
        ({"knots": np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.5, 1.0])}, "knots"),
        ({"knots": np.zeros(8)}, "knots"),
    ],
)
def test_impossible_control_net_is_refused(change: dict[str, object], cause: str) -> None:
    parts: dict[str, object] = {
        "degree": 3,
        "knots": np.array([0.0] * 4 + [1.0] * 4),
        "net": np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0], [3.0, 0.0]]),
        "weights": np.ones(4),
    }
    parts |= change
    with pytest.raises(ToolpathError, match=cause):
        NurbsCurve.from_control_net(*parts.values())  # type: ignore[arg-type]
