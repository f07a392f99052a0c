"""The C2 spline through programmed points."""

from __future__ import annotations

import numpy as np
import pytest
from core_paths import spline, toolpath_of, wandering_points
from hypothesis import given, settings
from hypothesis import strategies as st

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.path_points import PathPoints
from feedopt_core.geometry.segments import Segment

WALK = st.lists(st.tuples(st.floats(-1.2, 1.2), st.floats(2.0, 20.0)), min_size=2, max_size=20)


def ends(segment: Segment) -> tuple[PathPoints, PathPoints]:
    return segment.evaluate(np.zeros(1)), segment.evaluate(np.array([segment.length_mm]))


def on_circle(count: int, radius_mm: float) -> FloatArray:
    """Points of a closed circle, the last repeats the first."""
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    return radius_mm * np.column_stack([np.cos(angle), np.sin(angle)])


def assert_c2(before: PathPoints, after: PathPoints) -> None:
    assert np.allclose(before.r_mm, after.r_mm, atol=1e-8)
    assert np.allclose(before.dr_ds, after.dr_ds, atol=1e-9)
    assert np.allclose(before.d2r_ds2, after.d2r_ds2, atol=1e-8)


@settings(max_examples=25)
@given(WALK)
def test_spline_passes_through_its_points_and_is_c2(walk: list[tuple[float, float]]) -> None:
    points = wandering_points(*zip(*walk, strict=True))
    toolpath = toolpath_of(spline(points))
    at_mm = toolpath.joints_mm(0.0, toolpath.end_mm)
    # Not-a-knot ends: the polynomials of the first two intervals are one, and so are those of the last two.
    through = toolpath.evaluate(at_mm).r_mm
    for point in points:
        assert np.min(np.linalg.norm(through - point, axis=1)) < 1e-7
    for before, after in zip(toolpath.segments[:-1], toolpath.segments[1:], strict=True):
        assert_c2(ends(before)[1], ends(after)[0])
    inside = at_mm[1:-1]
    hair = 1e-9
    left, right = toolpath.evaluate(inside - hair), toolpath.evaluate(inside + hair)
    assert np.allclose(left.d2r_ds2, right.d2r_ds2, atol=1e-6)


def test_closed_contour_is_c2_at_its_start_too() -> None:
    points = np.array([(0, 0), (20, -3), (31, 12), (14, 25), (-6, 17), (0, 0)], dtype=float)
    segments = spline(points)
    assert_c2(ends(segments[-1])[1], ends(segments[0])[0])
    assert np.allclose(ends(segments[-1])[1].r_mm, points[0], atol=1e-8)


def test_open_contour_that_nearly_closes_stays_open() -> None:
    points = np.array([(0, 0), (20, -3), (31, 12), (14, 25), (-6, 17), (0, 1e-3)], dtype=float)
    segments = spline(points)
    assert not np.allclose(ends(segments[-1])[1].dr_ds, ends(segments[0])[0].dr_ds, atol=1e-3)


@pytest.mark.parametrize(("count", "tolerance"), [(12, 3e-4), (24, 2e-5), (48, 2e-6)])
def test_spline_through_points_of_a_circle_is_nearly_the_circle(count: int, tolerance: float) -> None:
    radius = 30.0
    toolpath = toolpath_of(spline(on_circle(count, radius)))
    assert toolpath.end_mm == pytest.approx(2.0 * np.pi * radius, rel=tolerance)
    points = toolpath.evaluate(np.linspace(0.0, toolpath.end_mm, 500))
    assert np.allclose(np.linalg.norm(points.r_mm, axis=1), radius, rtol=tolerance)


def test_circle_converges_with_the_fourth_order() -> None:
    """A cubic spline's position error falls by 16 when the points are twice as dense."""
    errors = []
    for count in (16, 32, 64):
        toolpath = toolpath_of(spline(on_circle(count, 10.0)))
        radii = np.linalg.norm(toolpath.evaluate(np.linspace(0.0, toolpath.end_mm, 2000)).r_mm, axis=1)
        errors.append(float(np.max(np.abs(radii - 10.0))))
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.15)


def test_two_points_give_the_straight_line() -> None:
    toolpath = toolpath_of(spline([(1.0, 2.0), (31.0, 42.0)]))
    assert toolpath.end_mm == pytest.approx(50.0, abs=1e-10)
    points = toolpath.evaluate(np.linspace(0.0, 50.0, 9))
    assert np.allclose(points.dr_ds, [0.6, 0.8], atol=1e-12)
    assert np.allclose(points.d2r_ds2, 0.0, atol=1e-12)


def test_three_dimensions_are_smoothed_alike() -> None:
    angle = np.linspace(0.0, 6.0, 40)
    points = np.column_stack([9.0 * np.cos(angle), 9.0 * np.sin(angle), 2.0 * angle])
    toolpath = toolpath_of(spline(points))
    # Length of a helix.
    assert toolpath.end_mm == pytest.approx(6.0 * np.hypot(9.0, 2.0), rel=1e-6)


def test_segments_continue_one_another() -> None:
    segments = spline([(4.0 * k, np.cos(0.8 * k)) for k in range(40)])
    assert [segment.place.sequence for segment in segments] == list(range(1, len(segments) + 1))
    starts = np.array([segment.place.s_start_mm for segment in segments])
    lengths = np.array([segment.length_mm for segment in segments])
    assert starts[0] == 0.0
    assert np.allclose(starts[1:], np.cumsum(lengths)[:-1], rtol=1e-15)
    assert [segment.place.last for segment in segments] == [False] * (len(segments) - 1) + [True]


def test_segments_arrive_before_the_whole_program_is_mapped() -> None:
    """A long program streams: the first segment covers a small part of it."""
    segments = spline([(4.0 * k, np.cos(0.8 * k)) for k in range(200)])
    assert len(segments) >= 20


@pytest.mark.parametrize("factor", [0.01, 100.0])
def test_smoothing_does_not_depend_on_the_scale(factor: float) -> None:
    points = np.array([(0, 0), (20, -3), (31, 12), (14, 25), (-6, 17)], dtype=float)
    small, large = toolpath_of(spline(points)), toolpath_of(spline(factor * points))
    assert large.end_mm == pytest.approx(factor * small.end_mm, rel=1e-10)
    at = np.linspace(0.0, 1.0, 40)
    scaled = large.evaluate(at * large.end_mm).r_mm / factor
    assert np.allclose(scaled, small.evaluate(at * small.end_mm).r_mm, atol=1e-8)
