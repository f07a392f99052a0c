"""The motion that is exported: of a recorded run, or of a program that is planned for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.geometry.segments import Segment
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine
from feedopt_core.pipeline.plan_program import Plan
from feedopt_recorder.bags.run_data import RunData
from feedopt_tools.errors import ExportError

_LEAST_STEP_MM = 1e-9


@dataclass(frozen=True)
class Motion:
    """A motion from rest to rest at the period of the interpolator.

    Attributes:
        name: of the program.
        machine: it was planned for.
        segments: the path; none where a bag does not hold it.
        tick: 0 at the start of motion, shape (n,).
        t_s, s_mm, feedrate_mm_s: shape (n,).
        position_mm, velocity_mm_s, acceleration_mm_s2: of the axes, shape (n, axes).
    """

    name: str
    machine: Machine
    segments: tuple[Segment, ...]
    tick: IntArray
    t_s: FloatArray
    s_mm: FloatArray
    feedrate_mm_s: FloatArray
    position_mm: FloatArray
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray

    @cached_property
    def toolpath(self) -> Toolpath:
        """The path by arc length.

        Raises:
            ExportError: it is not known.
            ToolpathError: its segments do not join.
        """
        if not self.segments:
            raise ExportError(f"{self.name}: the bag holds no /toolpath, so the path between the set points is unknown")
        toolpath = Toolpath()
        for segment in self.segments:
            toolpath.append(segment)
        return toolpath

    @property
    def tool_mm(self) -> FloatArray:
        """Tool position, shape (n, 3)."""
        tool = np.zeros((len(self.tick), 3))
        tool[:, : self.machine.dimensions] = self.position_mm @ self.machine.tool_matrix().T
        return tool

    def times_at(self, s_mm: FloatArray) -> FloatArray:
        """When arc lengths are passed, waiting there not included, shape (n,)."""
        moving = np.concatenate([[True], np.diff(self.s_mm) > _LEAST_STEP_MM])
        # What is spent at rest belongs to no stretch of the path.
        steps_s = np.where(moving[1:], np.diff(self.t_s), 0.0)
        moving_s = np.concatenate([[0.0], np.cumsum(steps_s)])
        return np.asarray(np.interp(s_mm, self.s_mm[moving], moving_s[moving]))


def motion_of_run(run: RunData) -> Motion:
    """Motion of a recorded run, without the rest before and after it.

    Raises:
        ExportError: machine or moving set points are not in the bag.
    """
    if run.machine is None:
        raise ExportError(f"{run.path}: holds no /machine: limits and axes are unknown")
    setpoints = run.setpoints
    moving = np.flatnonzero(setpoints.feedrate_mm_s > 0.0)
    if not len(moving):
        raise ExportError(f"{run.path}: no set point of program {run.program_id} moves: there is no motion to export")
    rows = slice(max(0, int(moving[0]) - 1), int(moving[-1]) + 2)
    return Motion(
        name=run.title,
        machine=run.machine,
        segments=run.segments,
        tick=setpoints.tick[rows] - setpoints.tick[rows][0],
        t_s=setpoints.t_s[rows] - setpoints.t_s[rows][0],
        s_mm=setpoints.s_mm[rows],
        feedrate_mm_s=setpoints.feedrate_mm_s[rows],
        position_mm=setpoints.position_mm[rows],
        velocity_mm_s=setpoints.velocity_mm_s[rows],
        acceleration_mm_s2=setpoints.acceleration_mm_s2[rows],
    )


def motion_of_plan(plan: Plan, machine: Machine, path: Path) -> Motion:
    """Motion of a planned program; velocities and accelerations of the axes are central differences."""
    setpoints, period_s = plan.setpoints, machine.period_s
    padded = np.pad(setpoints.position_mm, ((1, 1), (0, 0)), mode="edge")
    return Motion(
        name=path.name,
        machine=machine,
        segments=plan.toolpath.segments,
        tick=setpoints.tick,
        t_s=setpoints.t_s,
        s_mm=setpoints.s_mm,
        feedrate_mm_s=setpoints.v_mm_s,
        position_mm=setpoints.position_mm,
        velocity_mm_s=(padded[2:] - padded[:-2]) / (2.0 * period_s),
        acceleration_mm_s2=np.diff(padded, n=2, axis=0) / period_s**2,
    )
