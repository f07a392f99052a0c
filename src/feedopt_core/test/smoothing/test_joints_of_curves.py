"""Joints with arcs, helices and NURBS curves: G2 within the tolerance, or an exact stop."""

from __future__ import annotations

import math

import numpy as np
import pytest
from programmed_moves import (
    TOLERANCE_MM,
    arc,
    assert_counted,
    assert_smooth,
    ends,
    smoothed,
    stops_mm,
    straight,
)

from feedopt_core.audit.deviation import measure_deviation
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.geometry.segments import PlanarSegment, SegmentKind
from feedopt_core.programs.moves import ArcMove, LineMoves, Move, NurbsMove
from feedopt_core.smoothing.path_element import curve_between

SLOT: list[Move] = [
    straight([(0, 0), (50, 0)]),
    arc((50, 0), (50, 20), math.pi, line=2),
    straight([(50, 40), (0, 40)], first_line=3),
]
HELIX: list[Move] = [
    straight([(10, -30, 0), (10, 0, 0)]),
    arc((10, 0, 0), (0, 0), 5.0 * math.pi, rise_mm=12.0, line=2),
    straight([(-10, 0, 12), (-10, -30, 12)], first_line=3),
]
CORNER_WITH_ARC: list[Move] = [
    straight([(0, 0), (20, 0)]),
    arc((20, 0), (40, 0), math.pi, clockwise=True, line=2),
    straight([(60, 0), (80, 0)], first_line=3),
]
FULL_CIRCLE: list[Move] = [
    straight([(0, 0), (10, 0)]),
    arc((10, 0), (10, 5), 2.0 * math.pi, line=2),
    straight([(10, 0), (20, 0)], first_line=3),
]


def spiral_of_arcs(growth: float, count: int) -> list[Move]:
    moves, x, radius = list[Move](), 0.0, 5.0
    for index in range(count):
        center = x + (radius if index % 2 == 0 else -radius)
        moves.append(arc((x, 0.0), (center, 0.0), math.pi, line=index + 1))
        x = 2.0 * center - x
        radius += growth
    return moves


PROGRAMS: list[tuple[list[Move], int]] = [
    (SLOT, 2),
    (SLOT, 3),
    (HELIX, 3),
    (CORNER_WITH_ARC, 2),
    (FULL_CIRCLE, 2),
    (spiral_of_arcs(2.0, 8), 2),
    (spiral_of_arcs(0.001, 4), 2),
]


@pytest.mark.parametrize(("moves", "dimensions"), PROGRAMS)
def test_joints_are_g2_within_the_tolerance_without_a_stop(moves: list[Move], dimensions: int) -> None:
    segments = smoothed(moves, dimensions)
    assert_counted(segments)
    assert_smooth(segments, curvature_share=1e-8)
    assert stops_mm(segments) == []
    report = measure_deviation(moves, segments, TOLERANCE_MM)
    assert 0.0 < report.ratio <= 1.0


def test_step_of_curvature_overshoots_by_eight_percent_only() -> None:
    segments = smoothed(SLOT)
    blends = [segment for segment in segments if segment.kind == SegmentKind.NURBS]
    assert len(blends) == 2
    for blend in blends:
        bend = np.linalg.norm(blend.evaluate(np.linspace(0.0, blend.length_mm, 400)).d2r_ds2, axis=1)
        assert np.max(bend) == pytest.approx(1.0814 / 20.0, rel=2e-3)
        # The distance from what it replaces is 0.0027 times curvature times its length squared.
        assert 0.0027 / 20.0 * blend.length_mm**2 == pytest.approx(0.94 * TOLERANCE_MM, rel=0.06)


def test_arcs_stay_arcs_between_their_blends() -> None:
    middle = next(segment for segment in smoothed(HELIX, 3) if segment.kind == SegmentKind.ARC)
    assert isinstance(middle, PlanarSegment)
    points = middle.evaluate(np.linspace(0.0, middle.length_mm, 50))
    assert np.allclose(np.linalg.norm(points.r_mm[:, :2], axis=1), 10.0, rtol=1e-12)
    slope = 12.0 / math.hypot(50.0 * math.pi, 12.0)
    assert np.allclose(points.dr_ds[:, 2], slope, rtol=1e-12)


@pytest.mark.parametrize("off_mm", [0.0, 0.004, -0.004])
def test_arc_with_a_rounded_centre_meets_both_of_its_ends(off_mm: float) -> None:
    move = arc((10, 0), (0, 0), 1.9)
    rounded = ArcMove(
        move.start_mm, move.end_mm, np.array([off_mm, 0.3 * off_mm, 0.0]), move.normal, 1.9 - off_mm / 9.0, 0.0, 1, 50.0
    )
    (segment,) = smoothed([rounded])
    start, end = ends(segment)
    assert np.allclose(start.r_mm[0], move.start_mm[:2], atol=1e-12)
    assert np.allclose(end.r_mm[0], move.end_mm[:2], atol=1e-12)
    assert segment.length_mm == pytest.approx(19.0, abs=2.0 * abs(off_mm) + 1e-9)


def test_reversal_and_cusp_are_exact_stops() -> None:
    assert np.allclose(stops_mm(smoothed([straight([(0, 0), (50, 0), (20, 0)])])), [[50.0, 0.0]])
    cusp: list[Move] = [arc((0, 0), (0, 10), math.pi, line=1), arc((0, 20), (0, 30), math.pi, clockwise=False, line=2)]
    assert np.allclose(stops_mm(smoothed(cusp)), [[0.0, 20.0]])


def nurbs(degree: int, knots: list[float], points: list[tuple[float, ...]], weights: list[float] | None = None) -> Move:
    control = np.pad(np.array(points, dtype=float), ((0, 0), (0, 3 - len(points[0]))))
    given = np.ones(len(points)) if weights is None else np.array(weights)
    return NurbsMove(degree, np.array(knots, dtype=float), control, given, 7, 50.0)


WAVE = [(0.0, 0.0), (5.0, 8.0), (12.0, -3.0), (18.0, 6.0), (25.0, 0.0), (31.0, 4.0)]


def test_smooth_nurbs_curve_stays_the_same_curve() -> None:
    knots = [0, 0, 0, 0, 1, 2, 3, 3, 3, 3]
    (segment,) = smoothed([nurbs(3, knots, WAVE)])
    assert segment.kind == SegmentKind.NURBS
    programmed = NurbsCurve.from_control_net(3, np.array(knots, dtype=float), np.array(WAVE), np.ones(6))
    u = segment.arc_length_map.parameter(np.linspace(0.0, segment.length_mm, 40))  # type: ignore[union-attr]
    given = programmed.evaluate(u)[0]
    assert np.allclose(segment.evaluate(np.linspace(0.0, segment.length_mm, 40)).r_mm, given, atol=1e-9)
    assert segment.place.source_line == 7
    assert segment.place.feed_limit_mm_s == 50.0


@pytest.mark.parametrize(
    ("degree", "knots"),
    [(3, [0, 0, 0, 0, 1, 1, 2, 2, 2, 2]), (2, [0, 0, 0, 1, 2, 3, 4, 4, 4]), (4, [0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2])],
)
def test_knots_that_break_the_curvature_are_blended(degree: int, knots: list[float]) -> None:
    move = nurbs(degree, knots, WAVE)
    segments = smoothed([move])
    assert_smooth(segments)
    assert stops_mm(segments) == []
    assert measure_deviation([move], segments, TOLERANCE_MM).ratio <= 1.0


def test_corner_inside_a_nurbs_curve_is_a_corner() -> None:
    move = nurbs(2, [0, 0, 0, 1, 1, 2, 2, 2], [(0, 0), (5, 0), (10, 0), (10, 5), (10, 12)])
    segments = smoothed([move])
    assert_smooth(segments)
    assert measure_deviation([move], segments, TOLERANCE_MM).ratio <= 1.0


def test_nurbs_of_degree_one_is_a_polyline() -> None:
    segments = smoothed([nurbs(1, [0, 0, 1, 2, 2], [(0, 0), (10, 0), (10, 10)])])
    assert [segment.kind for segment in segments] == [0, 2, 2, 0]


@pytest.mark.parametrize(
    ("knots", "weights", "text"),
    [
        ([0, 0, 0, 0, 1, 2, 3, 3, 3, 3], [1, 1, 0, 1, 1, 1], "weight"),
        ([0, 0, 0, 0, 2, 1, 3, 3, 3, 3], [1] * 6, "decrease"),
        ([0, 1, 2, 3, 4, 5, 6, 7, 8, 9], [1] * 6, "clamp"),
        ([0, 0, 0, 0, 1, 3, 3, 3, 3], [1] * 6, "knots"),
    ],
)
def test_bad_nurbs_are_refused_with_their_line(knots: list[float], weights: list[float], text: str) -> None:
    with pytest.raises(ToolpathError, match=text) as caught:
        smoothed([nurbs(3, knots, WAVE, weights)])
    assert caught.value.line == 7


def test_part_of_a_rational_curve_is_the_same_curve() -> None:
    knots = np.array([0, 0, 0, 0, 1, 1, 2, 2, 2, 2], dtype=float)
    whole = NurbsCurve.from_control_net(3, knots, np.array(WAVE), np.array([1.0, 2.0, 0.5, 1.0, 3.0, 1.0]))
    for start, end in ((0.0, 2.0), (0.3, 1.7), (0.0, 1.0), (1.0, 2.0), (1.2, 1.4)):
        cut = curve_between(whole, start, end)
        u = np.linspace(start, end, 23)[:-1]
        for given, found in zip(whole.evaluate(u), cut.evaluate(u), strict=True):
            assert np.allclose(given, found, rtol=1e-9, atol=1e-9)


def test_program_that_jumps_is_refused_with_its_line() -> None:
    moves: list[Move] = [straight([(0, 0), (5, 0)]), straight([(5, 0.1), (9, 0)], first_line=2)]
    with pytest.raises(ToolpathError, match=r"0\.1 mm from the end") as caught:
        smoothed(moves)
    assert caught.value.line == 2


@pytest.mark.parametrize(
    "move",
    [
        straight([(0, 0, 0), (5, 0, 0), (5, 5, -1)]),
        arc((0, 0, 0), (5, 0), 1.0, rise_mm=1.0, line=2),
        ArcMove(
            np.zeros(3),
            np.array([0.0, 10.0, 0.0]),
            np.array([0.0, 5.0, 0.0]),
            np.array([1.0, 0, 0]),
            math.pi,
            0.0,
            2,
            9.0,
        ),
        LineMoves(np.zeros(3), np.array([[1.0, 2.0, math.nan]]), np.array([2]), np.array([5.0])),
    ],
)
def test_z_on_a_plane_machine_and_values_that_are_not_finite_are_refused(move: Move) -> None:
    with pytest.raises(ToolpathError, match=r"no axis for it|not finite") as caught:
        smoothed([move])
    assert caught.value.line == 2


def test_plane_program_at_a_height_stays_there_on_a_machine_with_z() -> None:
    segments = smoothed([straight([(0, 0, 3.5), (5, 0, 3.5), (5, 5, 3.5)])], 3)
    for segment in segments:
        assert np.all(segment.evaluate(np.linspace(0.0, segment.length_mm, 5)).r_mm[:, 2] == 3.5)
    assert smoothed([straight([(0, 0, 3.5), (5, 0, 3.5)])])[0].length_mm == 5.0
