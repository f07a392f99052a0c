"""One program from its file to an audited plan, with the figures of every step."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.audit.setpoints import audit_setpoints
from feedopt_core.errors import FeedoptError
from feedopt_core.geometry.segments import Segment
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.certificate import merge
from feedopt_core.pipeline.plan_program import interpolate
from feedopt_core.pipeline.survey import Survey, survey_program
from feedopt_core.pipeline.warm_up import warm_up_planning
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner


@dataclass(frozen=True)
class Motion:
    """A plan for a path.

    Attributes:
        time_s: motion time from standstill to standstill.
        planning_s: wall time of the planner alone.
        windows, fallbacks: number of windows, and of those without a plan, which end in the stop of the previous one.
        worst_ratio: largest ratio to a limit, on the fine grid and at the set points.
        holds: whether the audit found no violation.
    """

    time_s: float
    planning_s: float
    windows: int
    fallbacks: int
    worst_ratio: float
    holds: bool


@dataclass(frozen=True)
class ProgramRun:
    """Results of a program up to a failure; ``failure`` is its cause, or empty."""

    name: str
    survey: Survey | None = None
    motion: Motion | None = None
    failure: str = ""


def run_program(
    name: str, path: Path, machines: dict[int, Machine], parameters: PlannerParameters, tolerance_mm: float
) -> ProgramRun:
    """Read, smooth and plan a program on the machine for its number of coordinates."""
    survey = None
    try:
        survey = survey_program(path, tolerance_mm=tolerance_mm)
        machine = machines[survey.dimensions]
        return ProgramRun(name, survey, plan_segments(survey.segments, machine, parameters))
    except FeedoptError as error:
        return ProgramRun(name, survey, failure=f"{type(error).__name__}: {error}")


def plan_segments(segments: Sequence[Segment], machine: Machine, parameters: PlannerParameters) -> Motion:
    """Plan and audit a whole path. Raises what the planner raises."""
    warm_up_planning()
    planner, toolpath, chunks = StreamPlanner(machine, parameters), Toolpath(), []
    planning_s = 0.0
    for segment in segments:
        toolpath.append(segment)
        began_s = time.perf_counter()
        planner.add_segment(segment)
        while (chunk := planner.next_chunk()) is not None:
            chunks.append(chunk)
            planner.discard_before(chunk.s_start_mm)
        planning_s += time.perf_counter() - began_s
    setpoints = interpolate(toolpath, chunks, machine)
    fine = [audit_profile(toolpath, chunk.profile, machine, chunk.t_start_s) for chunk in chunks]
    period_s = machine.period_s
    audit = merge([*fine, audit_setpoints(setpoints.position_mm, setpoints.s_mm, period_s, machine)])
    fallbacks = sum(chunk.figures.fallback for chunk in chunks)
    return Motion(planner.committed_t_s, planning_s, len(chunks), fallbacks, audit.worst.ratio, audit.holds)
