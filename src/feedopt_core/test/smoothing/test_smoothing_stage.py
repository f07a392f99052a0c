"""The smoothing stage as a stream: feeds, rapids, events, exact stops, degenerate moves, scale, memory."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
from programmed_moves import (
    FEED_MM_S,
    TOLERANCE_MM,
    arc,
    assert_counted,
    assert_smooth,
    ends,
    path_of,
    smoothed,
    stops_mm,
    straight,
)

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.audit.deviation import measure_deviation
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import SegmentKind
from feedopt_core.programs.moves import LineMoves, Move, PathMode, ProgramEvent
from feedopt_core.smoothing.runs import run as runs
from feedopt_core.smoothing.runs.smoother import RunPiece
from feedopt_core.smoothing.stage import smooth

SQUARE = [(0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0), (0.0, 0.0)]


def test_a_blend_takes_the_lower_of_its_two_feeds_and_the_line_it_leaves() -> None:
    moves = [straight(SQUARE[:2], feed_mm_s=80.0), straight(SQUARE[1:3], feed_mm_s=30.0, first_line=2)]
    segments = smoothed(moves)
    assert [segment.place.feed_limit_mm_s for segment in segments] == [80.0, 30.0, 30.0, 30.0]
    assert [segment.place.source_line for segment in segments] == [1, 1, 1, 2]


def test_feed_change_on_a_straight_line_is_a_joint_without_a_blend() -> None:
    moves = [straight([(0, 0), (50, 0)], feed_mm_s=80.0), straight([(50, 0), (90, 0)], feed_mm_s=30.0, first_line=2)]
    segments = smoothed(moves)
    assert [segment.length_mm for segment in segments] == [50.0, 40.0]


def test_collinear_moves_of_one_feed_are_one_segment() -> None:
    segments = smoothed([straight([(0, 0), (10, 5), (20, 10), (26, 13), (26, 40)])])
    assert [segment.kind for segment in segments] == [0, 2, 2, 0]
    assert [segment.place.source_line for segment in segments] == [1, 1, 1, 4]


def test_rapids_are_limited_by_the_machine_alone_and_have_their_own_tolerance() -> None:
    moves: list[Move] = [
        straight([(0, 0), (0, 40), (30, 40)], rapid=True),
        straight([(30, 40), (30, 0)], first_line=3),
    ]
    segments = list(smooth(iter(moves), 0.01, 2, rapid_tolerance_mm=0.5))
    assert [segment.place.rapid for segment in segments] == [True] * 4 + [False] * 3
    assert [segment.place.feed_limit_mm_s for segment in segments] == [math.inf] * 4 + [FEED_MM_S] * 3
    path = path_of(segments)
    corners = [(0.0, 40.0), (30.0, 40.0)]
    s_mm = np.linspace(0.0, path.end_mm, 200_001)
    distances = [float(np.min(np.linalg.norm(path.evaluate(s_mm).r_mm - corner, axis=1))) for corner in corners]
    assert distances[0] == pytest.approx(0.5, rel=1e-3)
    # Where the feed move begins, its tolerance holds.
    assert distances[1] == pytest.approx(0.01, rel=2e-2)


def test_events_go_to_the_segment_behind_them_and_stops_to_the_one_before() -> None:
    moves: list[Move] = [
        ProgramEvent("M3 S9000", 1, stop=True, dwell_s=2.0),
        straight(SQUARE[:2], first_line=2),
        ProgramEvent("M8", 3),
        straight(SQUARE[1:3], first_line=4),
        ProgramEvent("G4 P0.5", 5, stop=True, dwell_s=0.5),
        ProgramEvent("M5", 6),
        straight(SQUARE[2:4], first_line=7),
        ProgramEvent("M2", 8, stop=True, end=True),
        straight(SQUARE[3:], first_line=9),
    ]
    segments = smoothed(moves)
    assert [segment.place.events for segment in segments] == [
        ("M3 S9000",),
        (),
        ("M8",),
        (),
        ("G4 P0.5", "M5"),
    ]
    assert [segment.place.exact_stop for segment in segments] == [False, False, False, True, False]
    assert [segment.place.dwell_s for segment in segments] == [0.0, 0.0, 0.0, 0.5, 0.0]
    assert np.allclose(stops_mm(segments), [[50.0, 50.0]])


def test_event_at_a_curved_joint_goes_to_the_side_behind_the_blend() -> None:
    moves: list[Move] = [straight([(0, 0), (50, 0)]), ProgramEvent("M8", 2), arc((50, 0), (50, 20), math.pi, line=3)]
    assert [segment.place.events for segment in smoothed(moves)] == [(), (), ("M8",)]


def test_exact_stop_mode_ends_every_move_at_rest_at_its_very_point() -> None:
    mode = PathMode(exact_stop=True)
    chords = [(0.001 * k, 0.0005 * (k % 2)) for k in range(9)]
    segments = smoothed([straight([*SQUARE[1:], *chords[1:]], mode=mode)])
    assert all(segment.kind == SegmentKind.LINE for segment in segments)
    # The last one is the end of the program.
    assert np.allclose(stops_mm(segments), [*SQUARE[2:], *chords[1:-1]], atol=1e-12)


def test_tolerance_of_the_program_goes_before_the_one_of_the_run() -> None:
    segments = smoothed([straight(SQUARE[:3], mode=PathMode(tolerance_mm=0.2))])
    assert np.linalg.norm(ends(segments[1])[1].r_mm[0] - SQUARE[1]) == pytest.approx(0.2, rel=1e-9)


def test_naive_cam_detection_joins_moves_that_stay_close_to_a_line() -> None:
    jog = [(0.0, 0.0), (10.0, 0.0), (20.0, 0.003), (30.0, 0.0), (30.0, 20.0)]
    assert smoothed([straight(jog)])[0].kind == SegmentKind.NURBS
    move = straight(jog, mode=PathMode(naive_cam_mm=0.004))
    segments = smoothed([move])
    assert [segment.kind for segment in segments] == [0, 2, 2, 0]
    assert measure_deviation([move], segments, TOLERANCE_MM).ratio <= 1.0


def test_program_without_motion_is_refused() -> None:
    point = LineMoves(np.zeros(3), np.zeros((2, 3)), np.array([1, 2]), np.array([5.0, 5.0]))
    for moves in ([], [ProgramEvent("M3", 1)], [point]):
        with pytest.raises(ToolpathError, match="holds no motion"):
            list(smooth(iter(moves), TOLERANCE_MM, 2))


DEGENERATE = {
    "duplicates": [(0, 0), (0, 0), (10, 0), (10, 0), (10, 0), (10, 10), (10, 10)],
    "tiny": [(0, 0), (10, 0), (10 + 1e-7, 0), (10 + 1e-7, 1e-7), (10, 10), (10 - 1e-7, 10)],
    "many tiny": [(0, 0), *((5 + 1e-7 * k, 1e-7 * (k % 2)) for k in range(60)), (20, 0)],
    "below rounding": [(1e5, 1e5), (1e5 + 3, 1e5), (1e5 + 3 + 1e-11, 1e5 + 1e-11), (1e5 + 3, 1e5 + 4)],
    "short side": [(0, 0), (10, 0), (10, 1e-3), (0, 10)],
    "there and back": [(0, 0), (10, 0), (0, 0), (10, 0), (0, 0)],
    "one tiny move": [(0, 0), (1e-7, 0)],
    "comb": [(0.02 * k, 0.02 * (k // 2 % 2)) for k in range(40)],
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_moves_give_the_path(name: str) -> None:
    points = DEGENERATE[name]
    segments = smoothed([straight(points)])
    assert_counted(segments)
    assert_smooth(segments)
    assert measure_deviation([straight(points)], segments, TOLERANCE_MM).ratio <= 1.005
    assert np.allclose(ends(segments[0])[0].r_mm[0], points[0], atol=1e-9)
    assert np.allclose(ends(segments[-1])[1].r_mm[0], points[-1], atol=1e-9)


def test_tiny_side_between_two_arcs_is_bridged_by_their_blend() -> None:
    moves: list[Move] = [
        arc((0, 0), (0, 10), math.pi / 2.0),
        straight([(10, 10), (10, 10.002)], first_line=2),
        arc((10, 10.002), (4, 10.002), math.pi / 2.0, line=3),
    ]
    segments = smoothed(moves)
    assert [segment.kind for segment in segments] == [SegmentKind.ARC, SegmentKind.NURBS, SegmentKind.ARC]
    assert measure_deviation(moves, segments, TOLERANCE_MM).ratio <= 1.0


@pytest.mark.parametrize("factor", [1000.0, 1.0 / 25.4])
def test_scaled_program_gives_the_scaled_path(factor: float) -> None:
    points = np.array([*SQUARE, (10.0, 30.0), (15.0, 30.0), (20.0, 35.0), (20.0, 45.0)])

    def program(scale: float) -> list[Move]:
        start, center = scale * points[-1], scale * (points[-1] + [0.0, -8.0])
        return [straight(scale * points), arc(tuple(start), tuple(center), 2.0, line=20)]

    plain, scaled = smoothed(program(1.0)), smoothed(program(factor), tolerance_mm=factor * TOLERANCE_MM)
    assert [segment.kind for segment in plain] == [segment.kind for segment in scaled]
    given = [segment.length_mm * factor for segment in plain]
    assert np.allclose([segment.length_mm for segment in scaled], given, rtol=1e-6)


def test_first_segments_leave_long_before_the_program_is_read() -> None:
    read = 0

    def endless() -> Iterator[Move]:
        nonlocal read
        for block in itertools.count():
            read += 1
            k = np.arange(101) + 100 * block
            yield straight(np.column_stack([5.0 * k, 20.0 * (k % 2)]), first_line=1 + 100 * block)

    segments = list(itertools.islice(smooth(endless(), TOLERANCE_MM, 2), 30))
    assert len(segments) == 30
    assert read <= 12


def test_blocks_do_not_matter() -> None:
    k = np.arange(1500)
    points = np.column_stack([5.0 * k, 20.0 * (k % 2)])
    whole = smoothed([straight(points)])
    divided = smoothed([straight(points[i : i + 402], first_line=i + 1) for i in range(0, len(points) - 1, 401)])
    assert [segment.kind for segment in whole] == [segment.kind for segment in divided]
    lengths = [[segment.length_mm for segment in segments] for segments in (whole, divided)]
    assert np.allclose(*lengths, rtol=1e-12)


def test_run_of_any_length_leaves_in_pieces_within_the_tolerance() -> None:
    angle = np.linspace(0.0, 6.0, 6001)
    points = 200.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    read = 0

    def blocks() -> Iterator[Move]:
        nonlocal read
        for first in range(0, len(points) - 1, 200):
            read += 1
            yield straight(points[first : first + 201], first_line=first + 1)

    stream = smooth(blocks(), TOLERANCE_MM, 2)
    segments = [next(stream)]
    assert read < 25
    segments += stream
    assert_counted(segments)
    assert_smooth(segments)
    assert all(segment.kind == SegmentKind.NURBS for segment in segments)
    assert measure_deviation([straight(points)], segments, TOLERANCE_MM).ratio <= 1.0


def test_long_straight_sides_next_to_a_run_stay_straight() -> None:
    angle = np.linspace(0.0, math.pi, 120)
    bow = np.column_stack([20.0 * np.sin(angle) + 60.0, 20.0 - 20.0 * np.cos(angle)])
    points = np.concatenate([[(0.0, 0.0)], bow, [(0.0, 40.0)]])
    segments = smoothed([straight(points)])
    assert_smooth(segments)
    assert segments[0].kind == segments[-1].kind == SegmentKind.LINE
    assert min(segments[0].length_mm, segments[-1].length_mm) > 50.0
    assert stops_mm(segments) == []
    assert measure_deviation([straight(points)], segments, TOLERANCE_MM).ratio <= 1.0


def test_corner_hidden_in_a_run_of_short_moves_is_rounded_within_the_tolerance() -> None:
    along = np.arange(0.0, 20.0, 0.05)
    wave = np.column_stack([along, 0.4 * np.sin(0.5 * along)])
    points = np.concatenate([wave, wave[-1] + np.column_stack([0.3 * np.sin(0.4 * along), along])[1:]])
    segments = smoothed([straight(points)])
    assert_smooth(segments)
    assert stops_mm(segments) == []
    assert measure_deviation([straight(points)], segments, TOLERANCE_MM).ratio <= 1.0


class RefusingSmoother:
    """A run smoother that finds no curve: at once, or at the end."""

    at_once = False

    def __init__(self, tolerance_mm: float, start_direction: FloatArray | None = None) -> None:
        self.tolerance_mm, self.start_direction = tolerance_mm, start_direction

    def add(self, points_mm: FloatArray, lines: IntArray, feed_mm_s: FloatArray) -> list[RunPiece]:
        if self.at_once:
            raise ToolpathError("no curve")
        return []

    def finish(self, end_direction: FloatArray | None = None) -> list[RunPiece]:
        raise ToolpathError("no curve")


@pytest.mark.parametrize("at_once", [False, True])
def test_moves_no_curve_stands_for_are_followed_one_by_one(monkeypatch: pytest.MonkeyPatch, at_once: bool) -> None:
    monkeypatch.setattr(runs, "RunSmoother", RefusingSmoother)
    monkeypatch.setattr(RefusingSmoother, "at_once", at_once)
    angle = np.linspace(0.0, math.pi, 700)
    bow = np.column_stack([20.0 * np.sin(angle) + 60.0, 20.0 - 20.0 * np.cos(angle)])
    points = np.concatenate([[(0.0, 0.0)], bow, [(0.0, 40.0)]])
    segments = smoothed([straight(points)])
    assert_counted(segments)
    assert_smooth(segments)
    assert all(segment.kind != SegmentKind.NURBS for segment in segments)
    assert len(segments) > 1400
    assert measure_deviation([straight(points)], segments, TOLERANCE_MM).ratio <= 1.0
