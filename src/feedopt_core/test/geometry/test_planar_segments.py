"""Lines, arcs, clothoids and helices against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from core_paths import central_difference, planar
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import fresnel

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import PlanarSegment, SegmentKind, SegmentPlace

PLACE = SegmentPlace(4, 17, 0.0)


def helix(radius_mm: float, rise_per_mm: float, length_mm: float) -> PlanarSegment:
    """Circle of a radius around the origin in x and y, rising in z."""
    slope = np.sqrt(1.0 - rise_per_mm**2)
    return PlanarSegment(
        SegmentKind.ARC,
        PLACE,
        length_mm,
        start_mm=np.array([radius_mm, 0.0, 0.0]),
        tangent=np.array([0.0, 1.0, 0.0]),
        normal=np.array([-1.0, 0.0, 0.0]),
        rise=np.array([0.0, 0.0, rise_per_mm]),
        curvature_start_per_mm=1.0 / radius_mm,
        sharpness_per_mm2=0.0 * slope,
    )


def test_line_is_straight() -> None:
    points = planar(SegmentKind.LINE, 50.0, start=(3.0, -2.0), heading_rad=0.7).evaluate(np.linspace(0.0, 50.0, 11))
    direction = np.array([np.cos(0.7), np.sin(0.7)])
    assert np.allclose(points.r_mm, [3.0, -2.0] + np.linspace(0.0, 50.0, 11)[:, None] * direction, atol=1e-13)
    assert np.allclose(points.dr_ds, direction, atol=1e-15)
    assert np.all(points.d2r_ds2 == 0.0)
    assert np.all(points.d3r_ds3 == 0.0)


@pytest.mark.parametrize("curvature", [0.2, -0.2, 5.0, 1e-6])
def test_arc_is_a_circle(curvature: float) -> None:
    radius = 1.0 / curvature
    s = np.linspace(0.0, min(2.0 * np.pi * abs(radius), 100.0), 41)
    points = planar(SegmentKind.ARC, float(s[-1]), curvature=curvature).evaluate(s)
    angle = s * curvature
    # 1 - cos written so that it keeps its digits where the arc is nearly straight.
    closed_form = radius * np.column_stack([np.sin(angle), 2.0 * np.sin(0.5 * angle) ** 2])
    assert np.allclose(points.r_mm, closed_form, rtol=0.0, atol=1e-12)
    normal = np.column_stack([-np.sin(angle), np.cos(angle)])
    tangent = np.column_stack([np.cos(angle), np.sin(angle)])
    assert np.allclose(points.dr_ds, tangent, atol=1e-13)
    assert np.allclose(points.d2r_ds2, curvature * normal, atol=1e-13)
    assert np.allclose(points.d3r_ds3, -(curvature**2) * tangent, atol=1e-12)


@pytest.mark.parametrize("sharpness", [0.01, -0.01, 0.5])
def test_clothoid_follows_the_fresnel_integrals(sharpness: float) -> None:
    s = np.linspace(0.0, 15.0, 61)
    points = planar(SegmentKind.CLOTHOID, 15.0, sharpness=sharpness).evaluate(s)
    scale = np.sqrt(np.pi / abs(sharpness))
    sine, cosine = fresnel(s / scale)
    assert np.allclose(points.r_mm, scale * np.column_stack([cosine, np.sign(sharpness) * sine]), atol=1e-12)
    assert np.allclose(np.linalg.norm(points.d2r_ds2, axis=1), abs(sharpness) * s, atol=1e-13)


def test_clothoid_read_backwards_is_a_clothoid() -> None:
    """From curvature to straight: the mirror image of the one that starts straight."""
    length, sharpness = 12.0, 0.02
    forward = planar(SegmentKind.CLOTHOID, length, sharpness=sharpness)
    end = forward.evaluate(np.array([length]))
    turned = float(np.arctan2(-end.dr_ds[0, 1], -end.dr_ds[0, 0]))
    # Travelled the other way, the same bend turns to the other side.
    backward = planar(
        SegmentKind.CLOTHOID,
        length,
        start=end.r_mm[0].tolist(),
        heading_rad=turned,
        curvature=-sharpness * length,
        sharpness=sharpness,
    )
    s = np.linspace(0.0, length, 31)
    assert np.allclose(backward.evaluate(s).r_mm, forward.evaluate(length - s).r_mm, atol=1e-12)
    assert np.allclose(backward.evaluate(s).dr_ds, -forward.evaluate(length - s).dr_ds, atol=1e-12)


def test_helix_has_the_closed_form() -> None:
    radius, rise = 8.0, 0.3
    slope = np.sqrt(1.0 - rise**2)
    s = np.linspace(0.0, 100.0, 73)
    points = helix(radius, rise, 100.0).evaluate(s)
    angle = s * slope / radius
    expected = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), rise * s])
    assert np.allclose(points.r_mm, expected, atol=1e-12)
    assert np.allclose(np.linalg.norm(points.dr_ds, axis=1), 1.0, atol=1e-14)
    # Curvature of a helix: r / (r^2 + c^2) with pitch 2 pi c.
    c = radius * rise / slope
    assert np.allclose(np.linalg.norm(points.d2r_ds2, axis=1), radius / (radius**2 + c**2), atol=1e-14)


@given(
    heading=st.floats(-3.1, 3.1),
    curvature=st.floats(-0.5, 0.5),
    sharpness=st.floats(-0.05, 0.05),
    at=st.floats(0.1, 19.9),
)
def test_derivatives_agree_with_differences(heading: float, curvature: float, sharpness: float, at: float) -> None:
    segment = planar(SegmentKind.CLOTHOID, 20.0, heading_rad=heading, curvature=curvature, sharpness=sharpness)
    step = 0.01
    around = segment.evaluate(np.linspace(at - 3.0 * step, at + 3.0 * step, 7))
    here = segment.evaluate(np.array([at]))
    assert np.allclose(central_difference(around.r_mm, step), here.dr_ds[0], atol=1e-10)
    assert np.allclose(central_difference(around.dr_ds, step), here.d2r_ds2[0], atol=1e-10)
    assert np.allclose(central_difference(around.d2r_ds2, step), here.d3r_ds3[0], atol=1e-10)
    assert abs(np.linalg.norm(here.dr_ds[0]) - 1.0) < 1e-14


def test_long_clothoid_keeps_its_accuracy() -> None:
    """Many turns: the quadrature of the displacement must follow them."""
    s = np.array([100.0, 200.0])
    points = planar(SegmentKind.CLOTHOID, 200.0, sharpness=0.05).evaluate(s)
    scale = np.sqrt(np.pi / 0.05)
    sine, cosine = fresnel(s / scale)
    assert np.allclose(points.r_mm, scale * np.column_stack([cosine, sine]), atol=1e-10)


@pytest.mark.parametrize("length", [0.0, -1.0])
def test_segment_without_length_is_refused(length: float) -> None:
    with pytest.raises(ToolpathError, match="segment 4 has length") as caught:
        planar(SegmentKind.LINE, length, place=PLACE)
    assert caught.value.line == 17


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_segment_that_is_not_finite_is_refused(value: float) -> None:
    with pytest.raises(ToolpathError, match="segment 4 holds a value that is not finite"):
        planar(SegmentKind.LINE, value, place=PLACE)
    with pytest.raises(ToolpathError, match="not finite"):
        planar(SegmentKind.CLOTHOID, 1.0, sharpness=value, place=PLACE)
    with pytest.raises(ToolpathError, match="not finite") as caught:
        planar(SegmentKind.LINE, 1.0, start=(0.0, value), place=PLACE)
    assert caught.value.line == 17
