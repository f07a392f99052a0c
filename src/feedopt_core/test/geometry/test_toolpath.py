"""The toolpath as it grows: joints, what is refused, evaluation over several segments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_paths import INFINITY, planar, polyline, spline, toolpath_of

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import PlanarSegment, SegmentKind, SegmentPlace
from feedopt_core.geometry.toolpath import Toolpath

FIRST = SegmentPlace(1, 3, 0.0)


def line_then(**changes: object) -> tuple[PlanarSegment, PlanarSegment]:
    """A line of 10 mm along x and the segment that follows it, with changes to the latter's place."""
    place = replace(SegmentPlace(2, 8, 10.0, last=True), **changes)  # type: ignore[arg-type]
    return planar(SegmentKind.LINE, 10.0, place=FIRST), planar(SegmentKind.LINE, 5.0, start=(10.0, 0.0), place=place)


def test_path_grows_segment_by_segment() -> None:
    first, second = line_then()
    toolpath = Toolpath()
    assert (toolpath.start_mm, toolpath.end_mm, toolpath.complete) == (0.0, 0.0, False)
    toolpath.append(first)
    assert (toolpath.end_mm, toolpath.complete) == (10.0, False)
    toolpath.append(second)
    assert (toolpath.end_mm, toolpath.complete) == (15.0, True)
    assert toolpath.segments == (first, second)


def test_lost_segment_is_noticed() -> None:
    toolpath = Toolpath()
    first, second = line_then(sequence=3)
    toolpath.append(first)
    with pytest.raises(ToolpathError, match="segment 3 came after 1: one is lost") as caught:
        toolpath.append(second)
    assert caught.value.line == 8


def test_segment_that_comes_twice_is_noticed() -> None:
    toolpath = Toolpath()
    first, _ = line_then()
    toolpath.append(first)
    with pytest.raises(ToolpathError, match="segment 1 came after 1"):
        toolpath.append(first)


def test_lost_start_is_noticed() -> None:
    with pytest.raises(ToolpathError, match="the first segment has sequence 2: the start of the program is lost"):
        Toolpath().append(line_then()[1])


@pytest.mark.parametrize("gap_mm", [1e-4, 3.0])
def test_gap_is_refused(gap_mm: float) -> None:
    toolpath = toolpath_of([line_then()[0]])
    beyond = planar(SegmentKind.LINE, 5.0, start=(10.0 + gap_mm, 0.0), place=SegmentPlace(2, 8, 10.0))
    with pytest.raises(ToolpathError, match=f"segment 2 starts {gap_mm:g} mm from the end of the one before") as caught:
        toolpath.append(beyond)
    assert caught.value.line == 8
    assert toolpath.end_mm == 10.0


def test_arc_length_that_does_not_go_on_is_refused() -> None:
    first, second = line_then(s_start_mm=25.0)
    toolpath = toolpath_of([first])
    with pytest.raises(ToolpathError):
        toolpath.append(second)


def test_segment_after_the_last_is_refused() -> None:
    toolpath = toolpath_of(line_then())
    beyond = planar(SegmentKind.LINE, 5.0, start=(15.0, 0.0), place=SegmentPlace(3, 9, 15.0))
    with pytest.raises(ToolpathError):
        toolpath.append(beyond)


@pytest.mark.parametrize("turn_rad", [1e-4, 1.0, np.pi])
def test_corner_is_refused_where_the_machine_does_not_stop(turn_rad: float) -> None:
    turned = planar(SegmentKind.LINE, 5.0, start=(10.0, 0.0), heading_rad=turn_rad, place=SegmentPlace(2, 8, 10.0))
    toolpath = toolpath_of([line_then()[0]])
    with pytest.raises(ToolpathError, match="smooth the corner or stop there") as caught:
        toolpath.append(turned)
    assert caught.value.line == 8
    stopping = toolpath_of([replace(line_then()[0], place=replace(FIRST, exact_stop=True))])
    stopping.append(turned)
    assert stopping.end_mm == 15.0


def test_evaluation_in_any_order_over_several_segments() -> None:
    segments = [
        planar(SegmentKind.LINE, 10.0, place=FIRST),
        planar(SegmentKind.ARC, 5.0 * np.pi, start=(10.0, 0.0), curvature=0.1, place=SegmentPlace(2, 2, 10.0)),
        planar(
            SegmentKind.LINE,
            4.0,
            start=(20.0, 10.0),
            heading_rad=np.pi / 2.0,
            place=SegmentPlace(3, 3, 10.0 + 5.0 * np.pi, last=True),
        ),
    ]
    toolpath = toolpath_of(segments)
    s = np.array([toolpath.end_mm, 0.0, 10.0 + 2.5 * np.pi, 5.0, 10.0])
    points = toolpath.evaluate(s)
    half = 10.0 * np.sqrt(0.5)
    assert np.allclose(points.r_mm, [[20, 14], [0, 0], [10 + half, 10 - half], [5, 0], [10, 0]], atol=1e-12)
    # At a joint the segment that follows counts.
    assert np.allclose(points.d2r_ds2[4], [0.0, 0.1], atol=1e-15)


def test_evaluation_of_nothing_gives_nothing() -> None:
    assert toolpath_of(line_then()).evaluate(np.zeros(0)).r_mm.shape == (0, 2)


@pytest.mark.parametrize("s_mm", [-1e-3, 15.001, float("nan"), INFINITY])
def test_evaluation_outside_is_refused(s_mm: float) -> None:
    with pytest.raises(ToolpathError, match=r"outside the path.*, 0 to 15 mm"):
        toolpath_of(line_then()).evaluate(np.array([1.0, s_mm]))


def test_evaluation_of_an_empty_path_is_refused() -> None:
    with pytest.raises(ToolpathError, match="outside the path"):
        Toolpath().evaluate(np.zeros(1))


def test_path_left_behind_is_forgotten() -> None:
    segments = polyline([(0, 0), (10, 0), (20, 0), (30, 0)], exact_stop=False)
    toolpath = toolpath_of(segments)
    toolpath.discard_before(9.0)
    assert toolpath.start_mm == 0.0
    toolpath.discard_before(20.0)
    assert toolpath.start_mm == 20.0
    assert np.allclose(toolpath.evaluate(np.array([25.0])).r_mm, [[25.0, 0.0]])
    with pytest.raises(ToolpathError, match=r"outside the path.*, 20 to 30 mm"):
        toolpath.evaluate(np.array([19.0]))
    toolpath.discard_before(1e9)
    assert (toolpath.start_mm, toolpath.end_mm) == (20.0, 30.0)


def test_slower_feed_counts_at_a_joint() -> None:
    toolpath = toolpath_of(
        polyline([(0, 0), (10, 0), (20, 0), (30, 0)], exact_stop=False, feed_limits_mm_s=[50.0, 20.0, INFINITY])
    )
    s = np.array([0.0, 9.999, 10.0, 15.0, 20.0, 20.001, 30.0])
    assert toolpath.feed_limits_mm_s(s).tolist() == [50.0, 50.0, 20.0, 20.0, 20.0, INFINITY, INFINITY]


def test_joints_around_two_arc_lengths() -> None:
    toolpath = toolpath_of(polyline([(0, 0), (10, 0), (20, 0), (30, 0)], exact_stop=False))
    assert toolpath.joints_mm(0.0, 30.0).tolist() == [0.0, 10.0, 20.0, 30.0]
    assert toolpath.joints_mm(10.0, 20.0).tolist() == [10.0, 20.0]
    assert toolpath.joints_mm(9.9, 20.1).tolist() == [0.0, 10.0, 20.0, 30.0]


def test_every_point_of_a_spline_is_a_joint() -> None:
    points = np.array([(7.0 * k, 3.0 * np.sin(k)) for k in range(20)])
    toolpath = toolpath_of(spline(points))
    joints = toolpath.joints_mm(0.0, toolpath.end_mm)
    assert len(joints) == 20
    assert np.allclose(toolpath.evaluate(joints).r_mm, points, atol=1e-8)


def test_exact_stops_are_the_ends_of_their_segments() -> None:
    segments = polyline([(0, 0), (10, 0), (10, 5), (20, 5)])
    assert toolpath_of(segments).exact_stops_mm().tolist() == [10.0, 15.0, 25.0]
    assert toolpath_of(line_then()).exact_stops_mm().tolist() == []
