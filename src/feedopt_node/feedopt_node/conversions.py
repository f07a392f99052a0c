"""Conversions between feedopt messages and domain types of the core. Arrays become ``array.array``, row-major.

``array.array("d", values.tobytes())`` is a hundred times faster than assigning a numpy array to a message field.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from builtin_interfaces.msg import Time

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.arc_length import ORDER, ArcLengthMap
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.geometry.segments import NurbsSegment, PlanarSegment, Segment, SegmentKind, SegmentPlace
from feedopt_core.machine.machine_file import DriveModel, Machine, TrackingModel
from feedopt_core.motion.certificate import Certificate
from feedopt_core.motion.chunk import Chunk, SolverFigures
from feedopt_core.motion.profile import FeedProfile
from feedopt_core.units import NS_PER_S
from feedopt_msgs.msg import FeedProfileChunk, ToolpathSegment
from feedopt_msgs.msg import Machine as MachineMessage

_PROFILE_FIELDS = ("s_mm", "q_mm2_s2", "dq_ds_mm_s2", "d2q_ds2_per_s2", "jerk_mm_s3")
_CERTIFICATE_ROWS = (
    "max_velocity_mm_s",
    "max_acceleration_mm_s2",
    "max_jerk_mm_s3",
    "max_control_volts",
    "max_tracking_error_mm",
)
_CERTIFICATE_FIELDS = ("worst_ratio", "worst_quantity", "worst_axis", "worst_s_mm")
_CHUNK_FIELDS = tuple(entry.name for entry in fields(Chunk) if entry.name not in ("profile", "certificate", "figures"))
_FIGURES = tuple(entry.name for entry in fields(SolverFigures))
_PLACE_FIELDS = tuple(entry.name for entry in fields(SegmentPlace) if entry.name != "events")
_DRIVE_FIELDS = tuple(entry.name for entry in fields(DriveModel))
_KINEMATIC_LIMITS = ("velocity_limit_mm_s", "acceleration_limit_mm_s2", "jerk_limit_mm_s3")
_TRACKING_FIELDS = tuple(entry.name for entry in fields(TrackingModel))

_PLAIN: dict[str, Callable[[Any], object]] = {"boolean": bool, "uint": int, "int": int, "double": float, "string": str}

_Model = TypeVar("_Model", DriveModel, TrackingModel)


def time_message(nanoseconds: int) -> Time:
    """Wall-clock nanoseconds since the epoch as a stamp."""
    return Time(sec=nanoseconds // NS_PER_S, nanosec=nanoseconds % NS_PER_S)


def nanoseconds(stamp: Time) -> int:
    """Stamp as wall-clock nanoseconds since the epoch."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def doubles(values: FloatArray) -> array[float]:
    """A float64 array of any shape as the value of a message field, row-major."""
    return array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())


def floats(field: Sequence[float]) -> FloatArray:
    """Copy of a message field as a float64 array, shape (n,)."""
    return np.array(field, dtype=np.float64) if not isinstance(field, array) else np.frombuffer(field).copy()


def set_plain(message: Any, name: str, value: object) -> None:
    """Set a scalar field, converted to its exact type: rclpy does not check, and a wrong type aborts the process."""
    setattr(message, name, _PLAIN[message.get_fields_and_field_types()[name].rstrip("0123456789")](value))


def segment_to_message(segment: Segment, program_id: int) -> ToolpathSegment:
    """Segment of a program as a message; the publisher sets the stamp."""
    place = segment.place
    message = ToolpathSegment(program_id=program_id, kind=int(segment.kind), length_mm=float(segment.length_mm))
    for name in _PLACE_FIELDS:
        set_plain(message, name, getattr(place, name))
    message.events = list(place.events)
    if isinstance(segment, PlanarSegment):
        message.dimensions = len(segment.start_mm)
        for name in ("start_mm", "tangent", "normal", "rise"):
            setattr(message, name, doubles(getattr(segment, name)))
        set_plain(message, "curvature_start_per_mm", segment.curvature_start_per_mm)
        set_plain(message, "sharpness_per_mm2", segment.sharpness_per_mm2)
        return message
    curve, arc_length_map = segment.curve, segment.arc_length_map
    message.dimensions = curve.control_points_mm.shape[1]
    set_plain(message, "degree", curve.degree)
    message.knots = doubles(curve.knots)
    message.control_points_mm = doubles(curve.control_points_mm)
    message.weights = doubles(curve.weights)
    message.map_s_mm = doubles(arc_length_map.s_mm)
    message.map_u = doubles(arc_length_map.coefficients)
    set_plain(message, "map_error_mm", arc_length_map.error_mm)
    return message


def segment_from_message(message: ToolpathSegment) -> Segment:
    """Segment of a program.

    Raises:
        ToolpathError: the parameters do not describe a curve.
    """
    place = SegmentPlace(**{name: getattr(message, name) for name in _PLACE_FIELDS}, events=tuple(message.events))
    kind = SegmentKind(message.kind)
    if kind is not SegmentKind.NURBS:
        return PlanarSegment(
            kind=kind,
            place=place,
            length_mm=message.length_mm,
            start_mm=floats(message.start_mm),
            tangent=floats(message.tangent),
            normal=floats(message.normal),
            rise=floats(message.rise),
            curvature_start_per_mm=message.curvature_start_per_mm,
            sharpness_per_mm2=message.sharpness_per_mm2,
        )
    curve = NurbsCurve.from_control_net(
        message.degree,
        floats(message.knots),
        floats(message.control_points_mm).reshape(-1, message.dimensions),
        floats(message.weights),
    )
    arc_length_map = ArcLengthMap(
        floats(message.map_s_mm), floats(message.map_u).reshape(-1, ORDER), message.map_error_mm
    )
    return NurbsSegment(place, curve, arc_length_map)


def chunk_to_message(chunk: Chunk, program_id: int) -> FeedProfileChunk:
    """Feed-profile chunk of a program as a message; the publisher sets the stamp."""
    message = FeedProfileChunk(program_id=program_id)
    for name in _CHUNK_FIELDS:
        set_plain(message, name, getattr(chunk, name))
    message.kind = array("B", chunk.profile.kind.astype(np.uint8).tobytes())
    for name in _PROFILE_FIELDS:
        setattr(message, name, doubles(getattr(chunk.profile, name)))
    for name in _CERTIFICATE_ROWS:
        setattr(message, name, array("d", getattr(chunk.certificate, name)))
    for name in _CERTIFICATE_FIELDS:
        set_plain(message, name, getattr(chunk.certificate, name))
    for name in _FIGURES:
        set_plain(message, name, getattr(chunk.figures, name))
    return message


def chunk_from_message(message: FeedProfileChunk) -> Chunk:
    """Feed-profile chunk of a program.

    Raises:
        SolverError: its elements do not describe a motion.
    """
    profile = FeedProfile(
        np.frombuffer(bytes(message.kind), dtype=np.uint8).astype(np.int64),
        *(floats(getattr(message, name)) for name in _PROFILE_FIELDS),
    )
    extremes: dict[str, Any] = {name: tuple(getattr(message, name)) for name in _CERTIFICATE_ROWS}
    certificate = Certificate(**extremes, **{name: getattr(message, name) for name in _CERTIFICATE_FIELDS})
    figures = SolverFigures(**{name: getattr(message, name) for name in _FIGURES})
    scalars = {name: getattr(message, name) for name in _CHUNK_FIELDS}
    return Chunk(**scalars, profile=profile, certificate=certificate, figures=figures)


def machine_to_message(machine: Machine) -> MachineMessage:
    """Machine, with NaN for values missing in its file; the publisher sets the stamp."""
    axes = len(machine.axis_names)
    unknown = (math.nan,) * axes
    message = MachineMessage(
        name=machine.name,
        yaml=machine.yaml_text,
        axis_names=list(machine.axis_names),
        axis_map=doubles(machine.axis_matrix()),
        feed_limit_mm_s=machine.feed_limit_mm_s,
        period_s=machine.period_s,
    )
    for name in _KINEMATIC_LIMITS:
        setattr(message, name, array("d", [math.nan if math.isinf(x) else x for x in getattr(machine, name)]))
    message.control_limit_volts = array("d", machine.control_limit_volts or unknown)
    message.tracking_error_limit_mm = array("d", machine.tracking_error_limit_mm or unknown)
    message.tracking_error_reserve_mm = array("d", machine.tracking_error_reserve_mm or unknown)
    for name in _DRIVE_FIELDS:
        setattr(message, name, array("d", getattr(machine.drive, name) if machine.drive else unknown))
    for name in _TRACKING_FIELDS:
        setattr(message, name, array("d", getattr(machine.tracking, name) if machine.tracking else unknown))
    return message


def machine_from_message(message: MachineMessage) -> Machine:
    """Machine of a message; NaN becomes infinity for a kinematic limit and None for all other values."""
    limits = {
        name: tuple(math.inf if math.isnan(x) else float(x) for x in getattr(message, name))
        for name in _KINEMATIC_LIMITS
    }
    drive = _model(DriveModel, _DRIVE_FIELDS, message)
    tracking = _model(TrackingModel, _TRACKING_FIELDS, message)
    return Machine(
        name=message.name,
        yaml_text=message.yaml,
        axis_names=tuple(message.axis_names),
        axis_map=tuple(tuple(row) for row in floats(message.axis_map).reshape(len(message.axis_names), -1).tolist()),
        feed_limit_mm_s=message.feed_limit_mm_s,
        **limits,
        control_limit_volts=_known(message.control_limit_volts),
        drive=drive,
        tracking_error_limit_mm=_known(message.tracking_error_limit_mm),
        tracking_error_reserve_mm=_known(message.tracking_error_reserve_mm),
        tracking=tracking,
        period_s=message.period_s,
    )


def _model(kind: type[_Model], names: Sequence[str], message: MachineMessage) -> _Model | None:
    """A model of the machine; None if one of its rows is NaN."""
    rows = {name: _known(getattr(message, name)) for name in names}
    return kind(**{name: row for name, row in rows.items() if row is not None}) if None not in rows.values() else None


def _known(field: Sequence[float]) -> tuple[float, ...] | None:
    row = tuple(field)
    return None if not row or any(math.isnan(value) for value in row) else row
