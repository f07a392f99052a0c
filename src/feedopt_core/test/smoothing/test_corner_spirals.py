"""Euler-spiral pairs at corners: closed forms of their size, deviation and curvature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from programmed_moves import TOLERANCE_MM, assert_smooth, ends, smoothed, straight
from scipy.integrate import quad
from scipy.special import fresnel

from feedopt_core.geometry.segments import PlanarSegment, SegmentKind
from feedopt_core.smoothing.corners.euler_pair import EulerPair, turning_angle

ANGLES = [1e-4, 0.05, 0.5, math.pi / 2.0, 2.2, 2.9]


@pytest.mark.parametrize("angle", ANGLES)
def test_pair_of_unit_length_ends_where_the_fresnel_integrals_say(angle: float) -> None:
    pair = EulerPair.turning(angle)
    scale = math.sqrt(math.pi / angle)
    sine, cosine = fresnel(1.0 / scale)
    assert pair.forward == pytest.approx(scale * cosine, rel=1e-13)
    assert pair.sideways == pytest.approx(scale * sine, rel=1e-12)
    # The end lies on the bisector, whose foot on the side is the corner.
    assert pair.cut - pair.forward == pytest.approx(pair.sideways * math.tan(angle / 2.0), rel=1e-12)
    assert pair.deviation == pytest.approx(math.hypot(pair.cut - pair.forward, pair.sideways), rel=1e-12)


def test_deviation_of_a_shallow_pair_is_a_sixth_of_angle_times_length() -> None:
    assert EulerPair.turning(1e-3).deviation == pytest.approx(1e-3 / 6.0, rel=1e-6)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("dimensions", [2, 3])
def test_corner_uses_the_tolerance_and_keeps_to_the_sides(angle: float, dimensions: int) -> None:
    tilt = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0][:, :dimensions]
    way = np.array([[0.0, 0.0], [4000.0, 0.0]])
    way = np.vstack([way, way[1] + 4000.0 * np.array([math.cos(angle), math.sin(angle)])])
    points = way @ tilt[:, :2].T if dimensions == 3 else way
    segments = smoothed([straight(points)], dimensions)
    assert [segment.kind for segment in segments] == [
        SegmentKind.LINE,
        SegmentKind.CLOTHOID,
        SegmentKind.CLOTHOID,
        SegmentKind.LINE,
    ]
    assert_smooth(segments, curvature_share=1e-9)
    corner = points[1]
    middle = ends(segments[1])[1]
    room_limited = EulerPair.turning(angle).length_mm(TOLERANCE_MM, 1e9) > segments[1].length_mm * 1.0001
    deviation = np.linalg.norm(middle.r_mm[0] - corner)
    assert deviation == pytest.approx(TOLERANCE_MM, rel=1e-6) or (room_limited and deviation < TOLERANCE_MM)
    for spiral in segments[1:3]:
        assert isinstance(spiral, PlanarSegment)
        assert abs(spiral.sharpness_per_mm2) * spiral.length_mm**2 == pytest.approx(angle, rel=1e-12)
    peak = np.linalg.norm(middle.d2r_ds2[0])
    assert peak == pytest.approx(angle / segments[1].length_mm, rel=1e-9)


def test_length_of_the_path_is_sides_less_what_the_pair_saves() -> None:
    segments = smoothed([straight([(0, 0), (50, 0), (50, 50)])])
    pair = EulerPair.turning(math.pi / 2.0)
    length = TOLERANCE_MM / pair.deviation
    expected = 100.0 - 2.0 * pair.cut * length + 2.0 * length
    assert sum(segment.length_mm for segment in segments) == pytest.approx(expected, rel=1e-13)


def test_short_sides_limit_the_pair_to_half_of_each() -> None:
    side = 0.3
    segments = smoothed([straight([(0.0, 0.0), (side, 0.0), (side, side)])], tolerance_mm=side)
    cut = EulerPair.turning(math.pi / 2.0).cut * segments[1].length_mm
    assert segments[1].kind == SegmentKind.CLOTHOID
    assert 0.48 * side < cut <= 0.5 * side


def test_turning_angle_is_accurate_near_zero_and_near_a_reversal() -> None:
    for angle in (1e-9, 1e-5, 3.1, math.pi):
        turned = np.array([math.cos(angle), math.sin(angle)])
        assert turning_angle(np.array([1.0, 0.0]), turned) == pytest.approx(angle, rel=1e-6)


def test_heading_of_the_spirals_adds_up_to_the_turn() -> None:
    _, first, second, _ = smoothed([straight([(0, 0), (5, 0), (5, 5)])])
    curvature = [
        quad(lambda s, p=part: float(np.linalg.norm(p.evaluate(np.array([s])).d2r_ds2)), 0.0, part.length_mm)
        for part in (first, second)
    ]
    assert curvature[0][0] + curvature[1][0] == pytest.approx(math.pi / 2.0, rel=1e-9)
