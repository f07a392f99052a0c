"""Round trips through the messages, serialised as on the wire."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import PlanarSegment, Segment, SegmentKind, SegmentPlace
from feedopt_core.machine.machine_file import Machine, load_machine
from feedopt_core.motion.certificate import Certificate
from feedopt_core.motion.chunk import Chunk, SolverFigures
from feedopt_core.motion.profile import ElementKind, FeedProfile
from feedopt_core.smoothing.cubic_spline import interpolate_points
from feedopt_node.conversions import (
    chunk_from_message,
    chunk_to_message,
    doubles,
    floats,
    machine_from_message,
    machine_to_message,
    nanoseconds,
    segment_from_message,
    segment_to_message,
    time_message,
)


def over_the_wire(message: Any) -> Any:
    return deserialize_message(serialize_message(message), type(message))


def assert_same(left: Any, right: Any) -> None:
    """Equal field by field; arrays bit by bit."""
    assert type(left) is type(right)
    if isinstance(left, np.ndarray):
        np.testing.assert_array_equal(left, right)
    elif is_dataclass(left):
        for entry in fields(left):
            assert_same(getattr(left, entry.name), getattr(right, entry.name))
    elif isinstance(left, float):
        assert left == right or (math.isnan(left) and math.isnan(right))
    elif not callable(left) and type(left).__module__ in ("builtins", "feedopt_core.geometry.segments"):
        assert left == right


def planar(dimensions: int) -> PlanarSegment:
    unit = np.eye(dimensions)
    return PlanarSegment(
        kind=SegmentKind.CLOTHOID,
        place=SegmentPlace(3, 17, 12.5, 40.0, True, rapid=True, dwell_s=0.25, events=("M3 S900", "M8")),
        length_mm=2.25,
        start_mm=np.arange(1.0, dimensions + 1.0) / 3.0,
        tangent=unit[0],
        normal=unit[1],
        rise=np.zeros(dimensions) if dimensions == 2 else unit[2] * 0.1,
        curvature_start_per_mm=-0.1,
        sharpness_per_mm2=1.0 / 7.0,
    )


def nurbs() -> Segment:
    points_mm = np.array([[0.0, 0.0], [10.0, 3.0], [20.0, -1.0], [31.0, 0.5]])
    return next(iter(interpolate_points(points_mm, [1, 2, 3, 4])))


@pytest.mark.parametrize("segment", [planar(2), planar(3), nurbs()], ids=["plane", "space", "nurbs"])
def test_segment_survives_the_wire(segment: Segment) -> None:
    message = over_the_wire(segment_to_message(segment, 5))
    assert message.program_id == 5
    again = segment_from_message(message)
    assert_same(segment, again)
    s_mm = np.linspace(0.0, segment.length_mm, 50)
    np.testing.assert_array_equal(segment.evaluate(s_mm).r_mm, again.evaluate(s_mm).r_mm)


def test_feed_limit_infinity_survives() -> None:
    assert math.isinf(segment_from_message(over_the_wire(segment_to_message(nurbs(), 1))).place.feed_limit_mm_s)


def test_segment_with_an_impossible_value_is_refused() -> None:
    message = segment_to_message(planar(2), 1)
    message.length_mm = math.nan
    with pytest.raises(ToolpathError, match="not finite"):
        segment_from_message(message)


def chunk(axes: int) -> Chunk:
    profile = FeedProfile(
        kind=np.array([ElementKind.REST_START, ElementKind.QUADRATIC, ElementKind.REST_END], dtype=np.int64),
        s_mm=np.array([0.0, 1.0, 2.0, 3.0]),
        q_mm2_s2=np.array([0.0, 4.0, 4.0]),
        dq_ds_mm_s2=np.array([0.0, 0.5, -0.5]),
        d2q_ds2_per_s2=np.array([0.0, -1.0, 0.0]),
        jerk_mm_s3=np.array([16.0 / 9.0, 0.0, 16.0 / 9.0]),
    )
    row = tuple(float(i + 1) / 3.0 for i in range(axes))
    certificate = Certificate(row, row, row, (), (), 0.99, "jerk", "X", 1.25)
    figures = SolverFigures("lp", "lp", 10, 20, 3, 0.125, 0.0625, True)
    return Chunk(4, 9, True, 0.0, 2.0, 3.0, 0.0, 1.5, 0.25, profile, certificate, figures)


def test_chunk_survives_the_wire() -> None:
    original = chunk(2)
    message = over_the_wire(chunk_to_message(original, 7))
    assert message.program_id == 7
    again = chunk_from_message(message)
    assert_same(original, again)
    t_s = np.linspace(0.0, original.profile.duration_s, 50)
    np.testing.assert_array_equal(original.profile.states_at(t_s).s_mm, again.profile.states_at(t_s).s_mm)


@pytest.mark.parametrize("name", ["router_simulation", "case_b", "hbot"])
def test_machine_survives_the_wire(name: str) -> None:
    machine = load_machine(name)
    again: Machine = machine_from_message(over_the_wire(machine_to_message(machine)))
    assert again == machine


def test_machine_without_drive_model_is_nan_on_the_wire() -> None:
    machine = load_machine("case_b")
    assert machine.drive is None
    assert all(math.isnan(value) for value in machine_to_message(machine).inertia_volts_s2_mm)


def test_stamp_is_exact() -> None:
    at_ns = 1_700_000_000_123_456_789
    assert nanoseconds(over_the_wire(time_message(at_ns))) == at_ns


def test_arrays_cross_row_major_whatever_their_layout() -> None:
    values = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    np.testing.assert_array_equal(floats(doubles(values)), np.arange(6.0))
    np.testing.assert_array_equal(floats([1.0, 2.0]), [1.0, 2.0])


def test_numpy_scalars_become_plain_ones() -> None:
    """A wrong type in a field is not refused by rclpy: it aborts the process when the message is sent."""
    original = replace(chunk(2), sequence=np.int64(4), last=np.bool_(True), t_start_s=0, s_commit_mm=np.float64(2.0))
    again = chunk_from_message(over_the_wire(chunk_to_message(original, 7)))
    assert (again.sequence, again.last, again.t_start_s, again.s_commit_mm) == (4, True, 0.0, 2.0)
    place = replace(planar(2).place, sequence=np.int64(3), s_start_mm=np.float64(12.5))
    assert_same(segment_from_message(over_the_wire(segment_to_message(replace(planar(2), place=place), 1))), planar(2))
