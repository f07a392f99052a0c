"""Machines and paths that the core's tests share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.segments import PlanarSegment, Segment, SegmentKind, SegmentPlace
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import DriveModel, Machine, TrackingModel
from feedopt_core.smoothing.cubic_spline import interpolate_points

INFINITY = float("inf")


def kinematic_machine(
    feed: float = 150.0,
    velocity: Sequence[float] = (150.0, 150.0),
    acceleration: Sequence[float] = (500.0, 500.0),
    jerk: Sequence[float] = (25000.0, 25000.0),
) -> Machine:
    """Machine without a drive model; one coordinate an axis; mm and s."""
    count = len(velocity)
    axis_map = tuple(tuple(row) for row in np.eye(count).tolist())
    return Machine(
        "test", "", ("X", "Y", "Z")[:count], axis_map, feed, tuple(velocity), tuple(acceleration), tuple(jerk)
    )


def drive_machine(
    control_volts: float = 10.0,
    tracking_error_mm: float = 0.02,
    *,
    offset_volts: float = 0.148,
    coulomb_volts: float = 0.241,
) -> Machine:
    """Two equal axes with the X drive of the thesis' simulation study (table 3-1)."""
    drive = DriveModel(
        inertia_volts_s2_mm=(2.13e-3,) * 2,
        viscous_volts_s_mm=(4.67e-2,) * 2,
        offset_volts=(offset_volts,) * 2,
        coulomb_volts=(coulomb_volts,) * 2,
    )
    tracking = TrackingModel(tracking_kv_s=(4.49e-5,) * 2, tracking_ka_s2=(1.99e-5,) * 2, tracking_kj_s3=(5.2e-8,) * 2)
    return Machine(
        name="test",
        yaml_text="",
        axis_names=("X", "Y"),
        axis_map=((1.0, 0.0), (0.0, 1.0)),
        feed_limit_mm_s=150.0,
        velocity_limit_mm_s=(150.0, 150.0),
        acceleration_limit_mm_s2=(500.0, 3340.0),
        jerk_limit_mm_s3=(63000.0, 156000.0),
        control_limit_volts=(control_volts,) * 2,
        drive=drive,
        tracking_error_limit_mm=(tracking_error_mm,) * 2,
        tracking=tracking,
    )


def planar(
    kind: SegmentKind,
    length_mm: float,
    *,
    start: Sequence[float] = (0.0, 0.0),
    heading_rad: float = 0.0,
    curvature: float = 0.0,
    sharpness: float = 0.0,
    place: SegmentPlace | None = None,
) -> PlanarSegment:
    """Plane segment with its direction given as an angle from x."""
    tangent = np.array([np.cos(heading_rad), np.sin(heading_rad)])
    normal = np.array([-tangent[1], tangent[0]])
    at = place or SegmentPlace(1, 1, 0.0, last=True)
    return PlanarSegment(
        kind, at, length_mm, np.array(start, dtype=float), tangent, normal, np.zeros(2), curvature, sharpness
    )


def line(length_mm: float, heading_rad: float = 0.0, feed_limit_mm_s: float = INFINITY) -> PlanarSegment:
    """A whole program of one straight line from the origin."""
    place = SegmentPlace(1, 1, 0.0, feed_limit_mm_s, last=True)
    return planar(SegmentKind.LINE, length_mm, heading_rad=heading_rad, place=place)


def polyline(
    points: Sequence[tuple[float, float]], *, exact_stop: bool = True, feed_limits_mm_s: Sequence[float] | None = None
) -> list[PlanarSegment]:
    """Straight segments through points, each ending in an exact stop (or not)."""
    segments, s_mm = list[PlanarSegment](), 0.0
    for index in range(len(points) - 1):
        start, end = np.array(points[index], dtype=float), np.array(points[index + 1], dtype=float)
        length = float(np.linalg.norm(end - start))
        feed = feed_limits_mm_s[index] if feed_limits_mm_s else INFINITY
        place = SegmentPlace(index + 1, index + 1, s_mm, feed, exact_stop, last=index == len(points) - 2)
        heading = float(np.arctan2(end[1] - start[1], end[0] - start[0]))
        segments.append(planar(SegmentKind.LINE, length, start=points[index], heading_rad=heading, place=place))
        s_mm += length
    return segments


def spline(points: Iterable[Sequence[float]]) -> list[Segment]:
    """Smoothed segments through points."""
    array = np.array(list(points), dtype=float)
    return list(interpolate_points(array, list(range(1, len(array) + 1))))


def wandering_points(turns_rad: Sequence[float], chords_mm: Sequence[float]) -> FloatArray:
    """Points of a walk: one turn and one chord after the other, shape (n + 1, 2)."""
    heading = np.cumsum(np.asarray(turns_rad))
    steps = np.asarray(chords_mm)[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def toolpath_of(segments: Iterable[Segment]) -> Toolpath:
    """Toolpath with all segments."""
    toolpath = Toolpath()
    for segment in segments:
        toolpath.append(segment)
    return toolpath


def central_difference(values: FloatArray, step: float) -> FloatArray:
    """First derivative at the middle of seven equidistant rows, shape (7, ...), of sixth order."""
    weights = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / (60.0 * step)
    return np.asarray(np.tensordot(weights, values, axes=(0, 0)))
