"""Planning and sampling as the core's tests need it, with an own check of limits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from core_paths import toolpath_of

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.geometry.segments import Segment
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.certificate import AuditReport, merge
from feedopt_core.motion.chunk import Chunk
from feedopt_core.pipeline.plan_program import Setpoints, interpolate
from feedopt_core.planner.method import PlanningMethod
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner

PERIOD_S = 0.001
ONE_WINDOW = PlannerParameters(commitment_mm=1e5)


@dataclass(frozen=True)
class PlannedPath:
    """A planned path with everything that can be asked about it."""

    machine: Machine
    toolpath: Toolpath
    chunks: list[Chunk]

    @property
    def motion_time_s(self) -> float:
        """Time from rest to rest."""
        return self.chunks[-1].t_commit_s

    def setpoints(self) -> Setpoints:
        """Set points at 1 kHz."""
        return interpolate(self.toolpath, self.chunks, self.machine)

    def fine_audit(self) -> AuditReport:
        """Fine-grid audit of every chunk, its stop included."""
        return merge(
            audit_profile(self.toolpath, chunk.profile, self.machine, chunk.t_start_s) for chunk in self.chunks
        )


def plan_path(
    machine: Machine,
    segments: Iterable[Segment],
    parameters: PlannerParameters = ONE_WINDOW,
    method: PlanningMethod | None = None,
) -> PlannedPath:
    """Plan a complete path, segment by segment as it would arrive."""
    segments = list(segments)
    planner = StreamPlanner(machine, parameters, method)
    chunks = list[Chunk]()
    for segment in segments:
        planner.add_segment(segment)
        while (chunk := planner.next_chunk()) is not None:
            chunks.append(chunk)
    assert planner.finished
    return PlannedPath(machine, toolpath_of(segments), chunks)


def difference_ratios(position_mm: FloatArray, machine: Machine) -> dict[str, float]:
    """Largest finite difference of set points over its limit; rest before and after; position of shape (n, n_axes)."""
    rest = np.repeat(position_mm[:1], 4, axis=0), np.repeat(position_mm[-1:], 4, axis=0)
    differences = np.concatenate([rest[0], position_mm, rest[1]])
    ratios = dict[str, float]()
    for name, limits in _kinematic_limits(machine):
        differences = (differences[1:] - differences[:-1]) / PERIOD_S
        ratios[name] = float(np.max(np.abs(differences) / np.asarray(limits)))
    return ratios


def _kinematic_limits(machine: Machine) -> tuple[tuple[str, Sequence[float]], ...]:
    return (
        ("velocity", machine.velocity_limit_mm_s),
        ("acceleration", machine.acceleration_limit_mm_s2),
        ("jerk", machine.jerk_limit_mm_s3),
    )
