"""Displayed paths in metres, and diagnostics."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import deserialize_message, serialize_message

from feedopt_core.geometry.segments import PlanarSegment, SegmentKind, SegmentPlace
from feedopt_core.motion.certificate import Certificate
from feedopt_core.motion.chunk import Chunk, SolverFigures
from feedopt_core.motion.profile import FeedProfile
from feedopt_planner.conversions import (
    MAX_DISPLAY_POINTS,
    DisplayPath,
    chunk_diagnostics,
)


def line(sequence: int, length_mm: float = 10.0) -> PlanarSegment:
    along = np.array([0.6, 0.8])
    start_mm = (sequence - 1) * length_mm * along
    place = SegmentPlace(sequence, sequence, (sequence - 1) * length_mm)
    return PlanarSegment(
        SegmentKind.LINE, place, length_mm, start_mm, along, np.array([-0.8, 0.6]), np.zeros(2), 0.0, 0.0
    )


def test_the_displayed_path_is_in_metres_and_each_joint_once() -> None:
    display = DisplayPath(spacing_mm=2.0)
    display.add(line(1))
    display.add(line(2))
    message = display.to_message(1_500_000_000)
    points = [(pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) for pose in message.poses]
    s_m = np.arange(11) * 0.002
    np.testing.assert_allclose(points, np.column_stack([0.6 * s_m, 0.8 * s_m, 0.0 * s_m]), atol=1e-15)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    serialize_message(message)


def test_long_paths_are_thinned_and_keep_their_ends() -> None:
    display = DisplayPath(spacing_mm=0.001)
    for sequence in range(1, 6):
        display.add(line(sequence))
    message = display.to_message(0)
    assert len(message.poses) <= MAX_DISPLAY_POINTS
    first, last = message.poses[0].pose.position, message.poses[-1].pose.position
    assert (first.x, first.y) == (0.0, 0.0)
    assert math.hypot(last.x, last.y) == pytest.approx(0.050, abs=1e-12)


def test_no_segments_no_points() -> None:
    assert list(DisplayPath(1.0).to_message(0).poses) == []


def chunk() -> Chunk:
    rows = ([1, 2], [0.0, 1.0, 2.0], [0.0, 4.0], [0.0, 0.0], [0.0, 0.0], [1.0, 1.0])
    profile = FeedProfile(*(np.array(row) for row in rows))
    certificate = Certificate((1.0,), (2.0,), (3.0,), (), (), 0.5, "jerk", "X", 1.5)
    figures = SolverFigures("lp", "lp", 1, 2, 3, 0.1, 0.2, False)
    return Chunk(4, 9, True, 0.0, 2.0, 2.0, 0.0, 1.5, 0.25, profile, certificate, figures)


def test_diagnostics_name_cost_and_certificate_and_warn_of_a_fallback() -> None:
    message = chunk_diagnostics(chunk(), 5)
    again = deserialize_message(serialize_message(message), type(message))
    values = {entry.key: entry.value for entry in again.status[0].values}
    assert values["chunk"] == "4"
    assert values["solve_time_s"] == "0.100000"
    assert (values["worst_quantity"], values["worst_axis"]) == ("jerk", "X")
    assert again.status[0].level == DiagnosticStatus.OK
    fallback = replace(chunk(), figures=replace(chunk().figures, fallback=True))
    assert chunk_diagnostics(fallback, 5).status[0].level == DiagnosticStatus.WARN
