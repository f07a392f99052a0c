"""A toolpath evaluates its packed segments as each of them does alone, however many came and went."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from core_paths import spline, toolpath_of, wandering_points

from feedopt_core.arrays import FloatArray, record
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.packed_path import Queue
from feedopt_core.geometry.path_points import PathPoints
from feedopt_core.geometry.segments import NurbsSegment, PlanarSegment, Segment, SegmentKind, SegmentPlace
from feedopt_core.geometry.toolpath import Toolpath

KINDS = (SegmentKind.LINE, SegmentKind.ARC, SegmentKind.CLOTHOID)


def planar_chain(count: int, seed: int, dimensions: int = 2) -> Iterator[PlanarSegment]:
    """Lines, arcs and clothoids in turn, each tangent to the one before."""
    draw = np.random.default_rng(seed)
    start, tangent, s_mm = np.zeros(dimensions), np.eye(dimensions)[0], 0.0
    for index in range(count):
        kind = KINDS[index % 3]
        curvature = draw.uniform(-1.0, 1.0) if kind is not SegmentKind.LINE else 0.0
        sharpness = draw.uniform(-0.5, 0.5) if kind is SegmentKind.CLOTHOID else 0.0
        normal = np.zeros(dimensions)
        normal[:2] = -tangent[1], tangent[0]
        place = SegmentPlace(index + 1, index + 1, s_mm, draw.uniform(10.0, 100.0), last=index == count - 1)
        segment = PlanarSegment(
            kind, place, draw.uniform(0.01, 2.0), start, tangent, normal, np.zeros(dimensions), curvature, sharpness
        )
        yield segment
        end = segment.evaluate(np.array([segment.length_mm]))
        start, tangent, s_mm = end.r_mm[0], end.dr_ds[0], s_mm + segment.length_mm


def alternating(seed: int) -> list[Segment]:
    """A spline of several segments, then a line and an arc that go on from it."""
    draw = np.random.default_rng(seed)
    curved = spline(wandering_points(draw.uniform(-0.5, 0.5, 150), draw.uniform(0.5, 3.0, 150)))
    curved[-1] = replace(curved[-1], place=replace(curved[-1].place, last=False))
    last = curved[-1]
    end = last.evaluate(np.array([last.length_mm]))
    place = SegmentPlace(len(curved) + 1, 1, last.place.s_start_mm + last.length_mm)
    normal = np.array([-end.dr_ds[0, 1], end.dr_ds[0, 0]])
    line = PlanarSegment(SegmentKind.LINE, place, 3.0, end.r_mm[0], end.dr_ds[0], normal, np.zeros(2), 0.0, 0.0)
    place = SegmentPlace(place.sequence + 1, 1, place.s_start_mm + 3.0, last=True)
    start = end.r_mm[0] + 3.0 * end.dr_ds[0]
    arc = PlanarSegment(SegmentKind.ARC, place, 4.0, start, end.dr_ds[0], normal, np.zeros(2), 0.2, 0.0)
    return [*curved, line, arc]


def one_by_one(segments: list[Segment], s_mm: FloatArray) -> PathPoints:
    """Every point by the segment that owns it, the later one at a joint."""
    starts = np.array([segment.place.s_start_mm for segment in segments])
    owner = np.clip(np.searchsorted(starts, s_mm, side="right") - 1, 0, len(starts) - 1)
    parts = [segments[k].evaluate(np.array([s - starts[k]])) for k, s in zip(owner, s_mm, strict=True)]
    rows = ([part.r_mm, part.dr_ds, part.d2r_ds2, part.d3r_ds3] for part in parts)
    return PathPoints(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def assert_equal(found: PathPoints, expected: PathPoints) -> None:
    for name in ("r_mm", "dr_ds", "d2r_ds2", "d3r_ds3"):
        values = getattr(expected, name)
        np.testing.assert_allclose(getattr(found, name), values, rtol=1e-12, atol=1e-12 * np.max(np.abs(values)))


PATHS = {
    "plane": list(planar_chain(300, 1)),
    "space": list(planar_chain(60, 2, 3)),
    "splines": alternating(3),
}


@pytest.mark.parametrize("name", PATHS)
def test_every_point_is_that_of_its_segment(name: str) -> None:
    segments = PATHS[name]
    toolpath = toolpath_of(segments)
    joints = np.array([segment.place.s_start_mm for segment in segments] + [toolpath.end_mm])
    s_mm = np.random.default_rng(4).permutation(np.concatenate([joints, np.linspace(0.0, toolpath.end_mm, 700)]))
    assert_equal(toolpath.evaluate(s_mm), one_by_one(segments, s_mm))


@pytest.mark.parametrize("name", PATHS)
def test_axis_derivatives_are_those_of_the_points(name: str) -> None:
    toolpath = toolpath_of(PATHS[name])
    s_mm = np.linspace(0.0, toolpath.end_mm, 500)
    points = toolpath.evaluate(s_mm)
    every = np.stack([points.dr_ds, points.d2r_ds2, points.d3r_ds3])
    k = np.random.default_rng(6).uniform(-2.0, 2.0, (4, points.r_mm.shape[1]))
    expected = np.einsum("ad,ond->oan", k, every)
    np.testing.assert_allclose(
        toolpath.axis_derivatives(s_mm, k), expected, rtol=1e-12, atol=1e-12 * np.max(np.abs(expected))
    )
    bend = np.maximum(np.linalg.norm(points.d2r_ds2, axis=1), np.sqrt(np.linalg.norm(points.d3r_ds3, axis=1)))
    np.testing.assert_allclose(toolpath.bend_length_mm(s_mm), 1.0 / np.maximum(bend, 1e-12), rtol=1e-14)


def test_whole_numbers_are_arc_lengths_too() -> None:
    """TOPP-RA asks for the path at the integer 0 first."""
    toolpath = toolpath_of(alternating(3))
    whole, real = toolpath.evaluate(np.array([0, 2])), toolpath.evaluate(np.array([0.0, 2.0]))
    assert np.array_equal(whole.r_mm, real.r_mm)
    derivatives = [toolpath.axis_derivatives(s_mm, np.eye(2)) for s_mm in (np.array([0, 2]), np.array([0.0, 2.0]))]
    assert np.array_equal(*derivatives)


def test_axis_map_of_other_dimensions_is_refused() -> None:
    with pytest.raises(ToolpathError, match="the path has 3 coordinates, the axes of the machine follow 2"):
        toolpath_of(PATHS["space"]).axis_derivatives(np.zeros(1), np.eye(2))


@pytest.mark.parametrize("name", PATHS)
def test_what_is_left_after_a_discard_does_not_change(name: str) -> None:
    whole, passing = toolpath_of(PATHS[name]), Toolpath()
    for segment in PATHS[name]:
        passing.append(segment)
        passing.discard_before(passing.end_mm - 7.0)
        s_mm = np.linspace(passing.start_mm, passing.end_mm, 23)
        # Not at the newest joint: the whole path goes on there.
        assert_equal(passing.evaluate(s_mm[:-1]), whole.evaluate(s_mm[:-1]))
        assert np.array_equal(passing.feed_limits_mm_s(s_mm[1:-1]), whole.feed_limits_mm_s(s_mm[1:-1]))
    inner = passing.joints_mm(passing.start_mm, passing.end_mm)
    assert np.array_equal(inner, whole.joints_mm(passing.start_mm, passing.end_mm))


def test_feed_limit_is_the_lower_one_at_a_joint() -> None:
    segments = PATHS["plane"]
    toolpath = toolpath_of(segments)
    feeds = [segment.place.feed_limit_mm_s for segment in segments]
    joints = np.array([segment.place.s_start_mm for segment in segments[1:]])
    assert toolpath.feed_limits_mm_s(joints).tolist() == [min(pair) for pair in pairwise(feeds)]
    inside = joints - 1e-3
    assert toolpath.feed_limits_mm_s(inside).tolist() == feeds[:-1]


def test_memory_follows_what_is_held() -> None:
    toolpath, sizes = Toolpath(), list[int]()
    tracemalloc.start()
    for index, segment in enumerate(planar_chain(6000, 5)):
        toolpath.append(segment)
        toolpath.discard_before(toolpath.end_mm - 50.0)
        if index % 1000 == 999:
            sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    # About 50 segments are held at any time; what they need may sway, but 5000 more must not add to it.
    assert sizes[-1] < 1.2 * sizes[0]
    assert len(toolpath.segments) < 200


def test_queue_gives_room_back() -> None:
    pair = record(start="f8", end="f8")
    values = np.zeros(10000, pair)
    values["start"], values["end"] = np.arange(10000.0), np.arange(10000.0) + 0.5
    queue = Queue(pair)
    queue.append(values)
    queue.drop(9990)
    assert queue.held.tolist() == [(float(k), k + 0.5) for k in range(9990, 10000)]
    assert queue.held.base is not None and queue.held.base.nbytes < 2000
    queue.append(values[:1])
    queue.shorten(1)
    assert (len(queue), queue.dropped) == (10, 9990)


@pytest.mark.parametrize("s_mm", [-1e-3, float("nan"), 1e9])
def test_place_off_the_path_is_refused(s_mm: float) -> None:
    with pytest.raises(ToolpathError, match="outside the path"):
        toolpath_of(PATHS["splines"]).evaluate(np.array([0.0, s_mm]))


def test_no_point_is_no_point() -> None:
    assert toolpath_of(PATHS["space"]).evaluate(np.zeros(0)).r_mm.shape == (0, 3)


def test_map_pieces_need_not_end_at_knots() -> None:
    """A piece of the arc-length map may run over a knot of the curve: the span is found by the parameter."""
    segment = next(each for each in PATHS["splines"] if isinstance(each, NurbsSegment))
    arc_length_map = segment.arc_length_map
    s_mm = np.linspace(0.0, segment.length_mm, 400)
    u = arc_length_map.parameter(s_mm)
    position = segment.curve.evaluate(u)[0]
    shifted = replace(segment, curve=replace(segment.curve, spans=segment.curve.spans.copy()))
    places = shifted.packed.pieces["own_span"]
    places[:] = places[::-1].copy()
    np.testing.assert_allclose(shifted.evaluate(s_mm).r_mm, position, rtol=1e-12, atol=1e-12)
