"""Limits of every axis and the geometry they see along the path.

With g1, g2, g3 = K r', K r'', K r''' (K: axis map) and q = feedrate^2, an axis has

    velocity      v = g1 sqrt(q)
    acceleration  a = g2 q + g1 q'/2
    jerk          j = sqrt(q) (g3 q + 3/2 g2 q' + 1/2 g1 q'')
    control       u = inertia a + viscous v + offset + coulomb sign(v)
    tracking      e = kv v + ka a + kj j
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.config.machine import Machine
from feedopt_core.path.toolpath import Toolpath

ONE_SIDED_MM = 1e-9


@dataclass(frozen=True)
class KinematicLimits:
    """Limits of velocity, acceleration and jerk of each axis, shape (n_axes,), and of the feedrate; mm and s."""

    axis_matrix: FloatArray
    feed_mm_s: float
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    jerk_mm_s3: FloatArray

    @classmethod
    def of(cls, machine: Machine) -> KinematicLimits:
        """The limits written in the machine file."""
        return cls(
            machine.axis_matrix(),
            machine.feed_limit_mm_s,
            np.array(machine.velocity_limit_mm_s),
            np.array(machine.acceleration_limit_mm_s2),
            np.array(machine.jerk_limit_mm_s3),
        )


@dataclass(frozen=True)
class ControlLimits:
    """Drive model (thesis section 3.6.1) and largest control signal of each axis, shape (n_axes,); V, mm and s."""

    inertia_volts_s2_mm: FloatArray
    viscous_volts_s_mm: FloatArray
    offset_volts: FloatArray
    coulomb_volts: FloatArray
    limit_volts: FloatArray


@dataclass(frozen=True)
class TrackingLimits:
    """Tracking model (thesis section 3.6.1) and largest error that a plan may use, shape (n_axes,); mm and s."""

    kv_s: FloatArray
    ka_s2: FloatArray
    kj_s3: FloatArray
    limit_mm: FloatArray


@dataclass(frozen=True)
class MotionLimits:
    """All limits that a plan obeys; control and tracking are None where they do not count."""

    axis_names: tuple[str, ...]
    kinematic: KinematicLimits
    control: ControlLimits | None = None
    tracking: TrackingLimits | None = None

    @classmethod
    def of(cls, machine: Machine) -> MotionLimits:
        """The limits written in the machine file, those of drive and tracking model included."""
        control = tracking = None
        if machine.drive is not None and machine.control_limit_volts is not None:
            drive = machine.drive
            control = ControlLimits(
                np.array(drive.inertia_volts_s2_mm),
                np.array(drive.viscous_volts_s_mm),
                np.array(drive.offset_volts),
                np.array(drive.coulomb_volts),
                np.array(machine.control_limit_volts),
            )
        if machine.tracking is not None and machine.planned_tracking_error_mm is not None:
            model = machine.tracking
            tracking = TrackingLimits(
                np.array(model.tracking_kv_s),
                np.array(model.tracking_ka_s2),
                np.array(model.tracking_kj_s3),
                np.array(machine.planned_tracking_error_mm),
            )
        return cls(machine.axis_names, KinematicLimits.of(machine), control, tracking)


@dataclass(frozen=True)
class AxisGeometry:
    """K r', K r'' and K r''' at points of the path; shape (n_axes, ...) each, and the programmed feed, shape (...)."""

    g1: FloatArray
    g2: FloatArray
    g3: FloatArray
    feed_limit_mm_s: FloatArray


def axis_geometry(toolpath: Toolpath, axis_matrix: FloatArray, s_mm: FloatArray) -> AxisGeometry:
    """Geometry of the axes at arc lengths of any shape. Raises ToolpathError outside the path held."""
    g1, g2, g3 = toolpath.axis_derivatives(s_mm.ravel(), axis_matrix).reshape(3, len(axis_matrix), *s_mm.shape)
    return AxisGeometry(g1, g2, g3, toolpath.feed_limits_mm_s(s_mm.ravel()).reshape(s_mm.shape))


def span_points(knots_mm: FloatArray, z: FloatArray) -> FloatArray:
    """Arc lengths at z in [0, 1] of every span, shape (len(z), m), a hair inside: derivatives may jump at a knot."""
    widths = np.diff(knots_mm)
    inset = np.minimum(ONE_SIDED_MM, 1e-3 * widths)
    return np.asarray(knots_mm[:-1] + inset + z[:, None] * (widths - 2.0 * inset))


def q_limit(geometry: AxisGeometry, limits: KinematicLimits) -> FloatArray:
    """Largest q the feed and the axis velocities allow, shape of the points, mm^2/s^2."""
    feed = np.minimum(geometry.feed_limit_mm_s, limits.feed_mm_s)
    shape = (-1,) + (1,) * feed.ndim
    with np.errstate(divide="ignore"):
        axis = np.min(limits.velocity_mm_s.reshape(shape) / np.abs(geometry.g1), axis=0)
    return np.asarray(np.minimum(feed, axis) ** 2)


def steady_q_limit(geometry: AxisGeometry, limits: KinematicLimits) -> FloatArray:
    """Largest q at a steady feed, shape of the points, mm^2/s^2: acceleration and jerk of the bends count as well."""
    shape = (-1,) + (1,) * geometry.feed_limit_mm_s.ndim
    with np.errstate(divide="ignore", over="ignore"):
        bend = limits.acceleration_mm_s2.reshape(shape) / np.abs(geometry.g2)
        twist = (limits.jerk_mm_s3.reshape(shape) / np.abs(geometry.g3)) ** (2.0 / 3.0)
    return np.asarray(np.minimum(q_limit(geometry, limits), np.min(np.minimum(bend, twist), axis=0)))
