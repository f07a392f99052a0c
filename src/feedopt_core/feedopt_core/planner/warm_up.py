"""Loads the compiled code before a machine waits for a plan."""

from __future__ import annotations

from functools import cache

import numpy as np

from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.geometry.segments import PlanarSegment, SegmentKind, SegmentPlace
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.limits import MotionLimits
from feedopt_core.machine.machine_file import DriveModel, Machine, TrackingModel
from feedopt_core.planner.method import Window
from feedopt_core.planner.time_optimal.method import TimeOptimalMethod


@cache
def warm_up() -> None:
    """Plan a millimetre, once a process: what is compiled is then loaded from disk, or compiled and written there."""
    two = (1.0, 1.0)
    machine = Machine(
        name="warm_up",
        yaml_text="",
        axis_names=("X", "Y"),
        axis_map=((1.0, 0.0), (0.0, 1.0)),
        feed_limit_mm_s=100.0,
        velocity_limit_mm_s=(100.0, 100.0),
        acceleration_limit_mm_s2=(500.0, 500.0),
        jerk_limit_mm_s3=(25000.0, 25000.0),
        control_limit_volts=(1e3, 1e3),
        drive=DriveModel(two, two, two, two),
        tracking_error_limit_mm=(1e3, 1e3),
        tracking=TrackingModel((1e-3, 1e-3), (1e-3, 1e-3), (1e-3, 1e-3)),
    )
    toolpath, east, north = Toolpath(), np.array([1.0, 0.0]), np.array([0.0, 1.0])
    place = SegmentPlace(1, 1, 0.0, last=True)
    toolpath.append(PlanarSegment(SegmentKind.LINE, place, 1.0, np.zeros(2), east, north, np.zeros(2), 0.0, 0.0))
    plan = TimeOptimalMethod("warm_up", "nlp", MotionLimits.of(machine), knot_spacing_mm=0.25).plan(
        toolpath, Window(0.0, 1.0)
    )
    audit_profile(toolpath, plan.profile, machine)
