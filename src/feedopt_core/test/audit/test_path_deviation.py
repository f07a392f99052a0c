"""The deviation checker: closed forms, and what a plain distance between two sets of points would miss."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_paths import planar, polyline
from programmed_moves import arc, smoothed, straight

from feedopt_core.audit.deviation import measure_deviation
from feedopt_core.geometry.segments import SegmentKind, SegmentPlace
from feedopt_core.programs.moves import Move, NurbsMove, PathMode, ProgramEvent
from feedopt_core.smoothing.corners.euler_pair import EulerPair


def test_path_that_is_the_program_has_no_deviation() -> None:
    points = [(0.0, 0.0), (30.0, 0.0), (30.0, 40.0)]
    report = measure_deviation([straight(points)], polyline(points), 0.01)
    assert report.worst_mm < 1e-12
    assert report.holds


def test_shifted_line_is_off_by_the_shift_and_names_its_line() -> None:
    program = [straight([(0, 0), (30, 0), (60, 0)], first_line=11)]
    report = measure_deviation(program, polyline([(0.0, 0.0), (30.0, 0.0), (60.0, 0.02)]), 0.01)
    assert report.worst_mm == pytest.approx(0.02, rel=1e-6)
    assert report.ratio == pytest.approx(2.0, rel=1e-6)
    assert not report.holds
    assert report.line == 12
    assert np.allclose(report.at_mm, [60.0, 0.02])


@pytest.mark.parametrize("angle", [0.4, math.pi / 2.0, 2.6])
def test_corner_pair_is_off_by_its_closed_form_at_the_corner(angle: float) -> None:
    pair, length = EulerPair.turning(angle), 3.0
    after = np.array([math.cos(angle), math.sin(angle)])
    curves = pair.curves(np.zeros(2), np.array([1.0, 0.0]), after, length)
    side = pair.cut * length
    program: list[Move] = [straight([(-side, 0.0), (0.0, 0.0), tuple(side * after)])]
    report = measure_deviation(program, curves, 0.5)
    assert report.worst_mm == pytest.approx(pair.deviation * length, rel=1e-4)
    assert np.allclose(report.at_mm, [0.0, 0.0])


def test_chord_of_an_arc_is_off_by_its_sagitta() -> None:
    program: list[Move] = [arc((10.0, 0.0), (0.0, 0.0), 0.2)]
    end = (10.0 * math.cos(0.2), 10.0 * math.sin(0.2))
    report = measure_deviation(program, polyline([(10.0, 0.0), end]), 0.01)
    assert report.worst_mm == pytest.approx(10.0 * (1.0 - math.cos(0.1)), rel=1e-3)


def test_arc_of_another_radius_is_seen_from_both_sides() -> None:
    place = SegmentPlace(1, 1, 0.0, last=True)
    wide = planar(
        SegmentKind.ARC,
        10.03 * math.pi,
        start=(10.03, 0.0),
        heading_rad=math.pi / 2.0,
        curvature=1 / 10.03,
        place=place,
    )
    report = measure_deviation([arc((10.0, 0.0), (0.0, 0.0), math.pi)], [wide], 0.01)
    assert report.worst_mm == pytest.approx(0.03, rel=1e-2)


def test_short_cut_to_a_neighbouring_pass_is_found() -> None:
    # Two passes 0.005 mm apart: every point of the cut path is within the tolerance of some programmed point.
    program = [straight([(0, 0), (100, 0), (100, 0.005), (0, 0.005), (0, 0.01), (100, 0.01)])]
    cut = polyline([(0.0, 0.0), (0.0, 0.01), (100.0, 0.01)])
    assert measure_deviation(program, cut, 0.01).ratio > 100.0


def test_way_there_and_back_on_one_line_is_followed() -> None:
    points = [(0.0, 0.0), (100.0, 0.0), (3.0, 0.0), (60.0, 0.0), (60.0, 50.0)] * 3
    assert measure_deviation([straight(points)], polyline(points), 0.01).worst_mm < 1e-9


def test_spike_that_is_left_out_is_found() -> None:
    program = [straight([(0, 0), (50, 0), (50, 0.3), (50, 0), (100, 0)])]
    report = measure_deviation(program, polyline([(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)]), 0.01)
    assert report.worst_mm == pytest.approx(0.3, rel=1e-9)


def test_tolerance_is_the_one_of_the_move_and_events_are_passed_over() -> None:
    program: list[Move] = [
        ProgramEvent("M3", 1),
        straight([(0, 0), (30, 0)], mode=PathMode(tolerance_mm=0.1), first_line=2),
        ProgramEvent("M2", 3, end=True),
        straight([(30, 0), (30, 30)], first_line=4),
    ]
    report = measure_deviation(program, polyline([(0.0, 0.0), (30.0, 0.05)]), 0.01)
    assert report.ratio == pytest.approx(0.5, rel=1e-6)
    assert report.tolerance_mm == 0.1


def test_rational_curve_is_compared_with_its_exact_circle() -> None:
    weights = np.array([1.0, math.sqrt(0.5), 1.0])
    control = np.array([[10.0, 0.0, 0.0], [10.0, 10.0, 0.0], [0.0, 10.0, 0.0]])
    quarter = NurbsMove(2, np.array([0.0, 0, 0, 1, 1, 1]), control, weights, 1, 50.0)
    place = SegmentPlace(1, 1, 0.0, last=True)
    circle = planar(
        SegmentKind.ARC, 5.0 * math.pi, start=(10.0, 0.0), heading_rad=math.pi / 2.0, curvature=0.1, place=place
    )
    assert measure_deviation([quarter], [circle], 0.01).ratio < 2e-3


def test_rounded_corner_that_the_path_meets_again_is_not_taken_for_the_later_pass() -> None:
    points = [(0.0, 0.0, 0.0), (15.0, 0.0, 0.0), (15.0, 0.0, 3.0), (15.0, 0.0, -0.5), (40.0, 0.0, -0.5)]
    # More points than one anchor holds, and a corner at every place in between.
    for count in range(56, 72):
        before = [(-0.1 * k, 0.2 * k, 0.0) for k in range(count, 0, -1)]
        program: list[Move] = [straight(np.array([*before, *points]))]
        assert measure_deviation(program, smoothed(program, 3), 0.01).holds
