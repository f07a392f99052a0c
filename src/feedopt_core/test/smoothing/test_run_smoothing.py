"""Runs of short moves: the curve that replaces them, against closed forms and an own distance check."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from core_motion import plan_path
from core_paths import kinematic_machine, toolpath_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from run_shapes import (
    TOLERANCE_MM,
    circle_points,
    corner_points,
    curve_points,
    relief_points,
    segments_of,
    smooth,
    worst_distance_mm,
)

from feedopt_core.smoothing.runs.smoother import RunSmoother

FEW = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)


def wave(chord_mm: float, decimals: int, length_mm: float = 40.0):
    x = np.arange(0.0, length_mm, chord_mm)
    return np.round(np.column_stack([x, 2.0 * np.sin(0.4 * x) + 0.5 * np.sin(1.3 * x)]), decimals)


def test_points_on_a_circle_become_a_circle():
    radius_mm = 10.0
    pieces = smooth(circle_points(radius_mm, 400))
    radius = np.linalg.norm(curve_points(pieces), axis=1)
    assert np.max(np.abs(radius - radius_mm)) <= TOLERANCE_MM
    toolpath = toolpath_of(segments_of(pieces))
    # Away from the ends, which are free, the curvature is the circle's.
    s = np.linspace(5.0, toolpath.end_mm - 5.0, 500)
    curvature = np.linalg.norm(toolpath.evaluate(s).d2r_ds2, axis=1)
    assert np.max(np.abs(curvature * radius_mm - 1.0)) < 0.01


def test_points_whose_chords_leave_the_circle_by_the_tolerance():
    radius_mm = 10.0
    count = int(np.ceil(np.pi / np.arccos(1.0 - TOLERANCE_MM / radius_mm))) + 1
    pieces = smooth(circle_points(radius_mm, count))
    assert worst_distance_mm(pieces, circle_points(radius_mm, count)) <= TOLERANCE_MM
    toolpath = toolpath_of(segments_of(pieces))
    s = np.linspace(5.0, toolpath.end_mm - 5.0, 500)
    curvature = np.linalg.norm(toolpath.evaluate(s).d2r_ds2, axis=1)
    assert np.max(np.abs(curvature * radius_mm - 1.0)) < 0.05


def test_points_on_a_line_become_a_line():
    points = np.linspace([0.0, 1.0, 2.0], [30.0, -5.0, 4.0], 700)
    pieces = smooth(points)
    toolpath = toolpath_of(segments_of(pieces))
    assert toolpath.end_mm == pytest.approx(np.linalg.norm(points[-1] - points[0]), abs=1e-9)
    assert np.max(np.abs(toolpath.evaluate(np.linspace(0.0, toolpath.end_mm, 100)).d2r_ds2)) < 1e-6


@pytest.mark.parametrize("dimensions", [2, 3])
def test_two_points_are_joined_straight(dimensions):
    points = np.array([[1.0, 2.0, 3.0], [4.0, 6.0, 3.0]])[:, :dimensions]
    (piece,) = smooth(points)
    assert piece.arc_length_map.length_mm == pytest.approx(5.0, abs=1e-9)
    assert worst_distance_mm([piece], points) < 1e-6
    assert piece.line == 1


@pytest.mark.parametrize(("chord_mm", "decimals"), [(0.1, 4), (0.1, 3), (0.01, 4), (0.01, 3), (0.001, 4), (0.001, 3)])
def test_programmed_decimals_and_chord_lengths_cost_no_time(chord_mm, decimals):
    machine = kinematic_machine(feed=220.0)
    reference = plan_path(machine, segments_of(smooth(wave(0.1, 9)))).motion_time_s
    points = wave(chord_mm, decimals)
    pieces = smooth(points)
    programmed = np.append(points[: -1 : max(1, round(0.01 / chord_mm))], points[-1:], axis=0)
    assert worst_distance_mm(pieces, programmed) <= TOLERANCE_MM
    spans = sum(len(piece.curve.joints) - 1 for piece in pieces)
    assert spans <= 110
    assert plan_path(machine, segments_of(pieces)).motion_time_s == pytest.approx(reference, rel=0.01)


def test_pieces_join_with_equal_curvature_and_change_of_curvature():
    pieces = smooth(np.concatenate([wave(0.1, 4, 400.0), np.array([0.0, 1.0]) + wave(0.1, 4, 400.0)[::-1]]))
    assert len(pieces) > 3
    segments = segments_of(pieces)
    for before, after in pairwise(segments):
        end, start = before.evaluate(np.array([before.length_mm])), after.evaluate(np.zeros(1))
        assert np.allclose(end.r_mm, start.r_mm, rtol=0.0, atol=1e-9)
        assert np.allclose(end.dr_ds, start.dr_ds, rtol=0.0, atol=1e-8)
        assert np.allclose(end.d2r_ds2, start.d2r_ds2, rtol=1e-6, atol=1e-7)
        assert np.allclose(end.d3r_ds3, start.d3r_ds3, rtol=1e-5, atol=1e-5)


def test_directions_given_are_taken_at_zero_curvature():
    points = circle_points(20.0, 300, 1.0)
    # Tangents of the circle, turned by less than the tolerance allows within a chord.
    start, end = np.array([0.0, 1.0]), np.array([-np.sin(1.0), np.cos(1.0)])
    pieces = smooth(points, start_direction=start, end_direction=end)
    toolpath = toolpath_of(segments_of(pieces))
    ends = toolpath.evaluate(np.array([0.0, toolpath.end_mm]))
    assert np.allclose(ends.dr_ds, [start, end], rtol=0.0, atol=1e-9)
    assert np.max(np.abs(ends.d2r_ds2)) < 1e-6
    assert np.allclose(ends.r_mm, points[[0, -1]], rtol=0.0, atol=1e-10)
    assert worst_distance_mm(pieces, points) <= TOLERANCE_MM


def test_no_piece_spans_a_change_of_feed():
    points = wave(0.1, 4)
    feed = np.where(np.arange(len(points)) <= 150, 20.0, np.where(np.arange(len(points)) <= 151, 30.0, 40.0))
    pieces = smooth(points, feed_mm_s=feed)
    assert [piece.feed_mm_s for piece in pieces] == sorted(piece.feed_mm_s for piece in pieces)
    assert {piece.feed_mm_s for piece in pieces} == {20.0, 30.0, 40.0}
    for value, first in ((30.0, 150), (40.0, 151)):
        piece = next(piece for piece in pieces if piece.feed_mm_s == value)
        assert piece.line == first + 1
        assert np.linalg.norm(piece.curve.evaluate(np.zeros(1))[0][0] - points[first]) <= TOLERANCE_MM


def test_infinite_feed_is_no_change_of_feed():
    points = wave(0.1, 4)
    assert len(smooth(points, feed_mm_s=np.full(len(points), np.inf))) == len(smooth(points))


def test_relief_rows_in_space():
    points = relief_points()
    pieces = smooth(points)
    assert worst_distance_mm(pieces, points) <= TOLERANCE_MM


@pytest.mark.parametrize("degrees", [1, 20, 60, 90, 120, 150, 170, 178, 180])
def test_a_corner_inside_a_run_is_rounded_within_the_tolerance(degrees):
    points = corner_points(np.radians(degrees))
    pieces = smooth(points)
    assert worst_distance_mm(pieces, points) <= TOLERANCE_MM
    assert max(piece.deviation_mm for piece in pieces) <= TOLERANCE_MM


def test_reversals_one_behind_the_other():
    # Turns of 2.94 rad in a row: without room on both sides of each, a curve may stand still at their tips.
    count = 12
    points = np.column_stack([np.arange(count) % 2, 0.1 * np.arange(count)])
    pieces = smooth(points)
    assert worst_distance_mm(pieces, points) <= TOLERANCE_MM


def test_points_closer_than_rounding_and_repeated_points():
    rng = np.random.default_rng(5)
    steps = np.where(rng.random(3000) < 0.4, 0.0, np.where(rng.random(3000) < 0.5, 1e-7, 0.03))
    x = np.cumsum(steps)
    points = np.column_stack([x, 0.3 * np.sin(x)])
    pieces = smooth(points)
    assert worst_distance_mm(pieces, points) <= TOLERANCE_MM
    curve = curve_points(pieces)
    assert np.allclose(curve[[0, -1]], points[[0, -1]], rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("count", [1, 5])
def test_a_run_of_one_place_has_no_pieces(count):
    assert smooth(np.ones((count, 3))) == []


def test_a_run_without_points_has_no_pieces():
    assert RunSmoother(TOLERANCE_MM).finish() == []


def test_the_first_pieces_leave_before_the_run_ends_and_little_is_held():
    smoother = RunSmoother(TOLERANCE_MM)
    points = wave(0.02, 4, 2000.0)
    lines, feed = np.arange(len(points)), np.full(len(points), 50.0)
    given_mm, lag_mm = 0.0, []
    for low in range(0, len(points), 500):
        for piece in smoother.add(points[low : low + 500], lines[low : low + 500], feed[low : low + 500]):
            given_mm = float(piece.curve.control_points_mm[-1, 0])
        lag_mm.append(points[min(low + 499, len(points) - 1), 0] - given_mm)
    assert max(lag_mm) < 300.0


@FEW
@given(data=st.data(), kind=st.sampled_from(["wave", "corner", "noise", "walk"]))
def test_any_division_into_blocks_gives_the_same_curve(data, kind):
    rng = np.random.default_rng(7)
    points = {
        "wave": wave(0.03, 3, 150.0),
        "corner": np.concatenate([corner_points(1.0), np.array([30.0, 0.0]) + corner_points(2.0)[::-1]]),
        "noise": wave(0.05, 9, 60.0) + rng.normal(0.0, 0.001, (len(wave(0.05, 9, 60.0)), 2)),
        "walk": np.cumsum(rng.normal(0.0, 0.3, (150, 2)), axis=0),
    }[kind]
    blocks = data.draw(st.lists(st.integers(0, len(points) // 2), max_size=6))
    whole, divided = smooth(points), smooth(points, blocks=blocks)
    assert len(whole) == len(divided)
    for one, other in zip(whole, divided, strict=True):
        assert np.array_equal(one.curve.knots, other.curve.knots)
        assert np.array_equal(one.curve.control_points_mm, other.curve.control_points_mm)
        assert (one.line, one.feed_mm_s, one.deviation_mm) == (other.line, other.feed_mm_s, other.deviation_mm)


@FEW
@given(
    turns=st.lists(st.floats(-1.2, 1.2), min_size=1, max_size=60),
    chords=st.lists(st.floats(1e-7, 2.0), min_size=60, max_size=60),
    tolerance_mm=st.sampled_from([0.002, 0.01, 0.05]),
    rise=st.floats(-0.5, 0.5),
)
def test_any_walk_is_followed_within_the_tolerance(turns, chords, tolerance_mm, rise):
    heading = np.cumsum(turns)
    steps = np.asarray(chords[: len(turns)])[:, None] * np.column_stack(
        [np.cos(heading), np.sin(heading), np.full(len(turns), rise)]
    )
    points = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    if np.max(np.linalg.norm(points, axis=1)) < tolerance_mm:
        return
    pieces = smooth(points, tolerance_mm=tolerance_mm)
    worst_mm = worst_distance_mm(pieces, points)
    assert worst_mm <= max(piece.deviation_mm for piece in pieces) + 1e-9 <= tolerance_mm + 2e-9
    curve = curve_points(pieces)
    assert np.allclose(curve[[0, -1]], points[[0, -1]], rtol=0.0, atol=1e-9)
