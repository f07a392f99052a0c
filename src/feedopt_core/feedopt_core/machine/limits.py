"""The limits of a machine as arrays: kinematic limits, control signals and tracking errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.machine.machine_file import Machine


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
    """Drive model (thesis section 3.6.1) and largest control signal of each axis, shape (n_axes,); in V, mm and s."""

    inertia_volts_s2_mm: FloatArray
    viscous_volts_s_mm: FloatArray
    offset_volts: FloatArray
    coulomb_volts: FloatArray
    limit_volts: FloatArray


@dataclass(frozen=True)
class TrackingLimits:
    """Tracking model (thesis section 3.6.1) and largest error that a plan may use, shape (n_axes,); in mm and s."""

    kv_s: FloatArray
    ka_s2: FloatArray
    kj_s3: FloatArray
    limit_mm: FloatArray


@dataclass(frozen=True)
class MotionLimits:
    """All limits that a plan keeps; ``control`` and ``tracking`` are None where they are not limited."""

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
