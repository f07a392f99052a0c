"""Load the compiled code before a program needs it, and compile what has changed: run it by ``python -m``.

The programs here are small but call every kernel; a test checks this.
"""

from __future__ import annotations

import math
from collections import deque
from functools import cache

import numpy as np

from feedopt_core.audit.deviation import measure_deviation
from feedopt_core.audit.setpoints import audit_setpoints
from feedopt_core.geometry.segments import Segment
from feedopt_core.machine.machine_file import DriveModel, Machine, TrackingModel
from feedopt_core.motion.setpoints import InterpolatorParameters, SetpointStream
from feedopt_core.pipeline.read_program import Program, ProgramKind, read_moves, read_program
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner

_NAME = "warm_up.ngc"
_TOLERANCE_MM = 0.01
_LINE = ("G21 G90 F3000\n", "G1 X1\n", "M2\n")


@cache
def warm_up_reading() -> None:
    """Read and smooth a corner and a run of short moves, once in each process."""
    deque(read_program(_short_moves(), _NAME, 2, _TOLERANCE_MM), maxlen=0)


@cache
def warm_up_planning() -> None:
    """Plan one millimetre with its audit and set points, once in each process."""
    machine, parameters = _machine(), InterpolatorParameters(rest_before_ticks=0, rest_after_ticks=0)
    planner, stream = StreamPlanner(machine, PlannerParameters()), SetpointStream(machine, parameters)
    for segment in _line():
        planner.add_segment(segment)
        stream.add_segment(segment)
    while (chunk := planner.next_chunk()) is not None:
        stream.add_chunk(chunk)
    block = stream.next_block(1000)
    assert block is not None
    audit_setpoints(block.position_mm, block.s_mm, machine.period_s, machine)


@cache
def warm_up() -> None:
    """Load all compiled code, including that for the deviation of the smoothed path from the program."""
    warm_up_planning()
    warm_up_reading()
    segments = tuple(read_program(_short_moves(), _NAME, 2, _TOLERANCE_MM))
    measure_deviation(read_moves(_short_moves(), _NAME), segments, _TOLERANCE_MM)


def _line() -> list[Segment]:
    return list(read_program(Program(ProgramKind.GCODE, _LINE), _NAME, 2, _TOLERANCE_MM))


def _short_moves() -> Program:
    """A corner, a wave of short moves, and an arc."""
    wave = [f"X{20 + 0.2 * k:.3f} Y{2.0 * math.sin(0.1 * k):.3f}\n" for k in range(60)]
    lines = ("G21 G90 F3000\n", "G1 X10 Y5\n", "G1 X20 Y0\n", *wave, "G1 X40 Y0\n", "G3 X40 Y20 J10\n", "M2\n")
    return Program(ProgramKind.GCODE, lines)


def _machine() -> Machine:
    """Two axes with every kind of limit."""
    two = (1.0, 1.0)
    return Machine(
        name="warm_up",
        yaml_text="",
        axis_names=("X", "Y"),
        axis_map=tuple(tuple(row) for row in np.eye(2).tolist()),
        feed_limit_mm_s=100.0,
        velocity_limit_mm_s=(100.0, 100.0),
        acceleration_limit_mm_s2=(500.0, 500.0),
        jerk_limit_mm_s3=(25000.0, 25000.0),
        control_limit_volts=(1e3, 1e3),
        drive=DriveModel(two, two, two, two),
        tracking_error_limit_mm=(1e3, 1e3),
        tracking=TrackingModel((1e-3, 1e-3), (1e-3, 1e-3), (1e-3, 1e-3)),
    )


if __name__ == "__main__":
    warm_up()
