"""Plans a path segment by segment and measures motion, computing time, ratios by two audits, windows and memory."""

from __future__ import annotations

import resource
import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.audit.setpoints import audit_setpoints
from feedopt_core.geometry.segments import Segment
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.certificate import merge
from feedopt_core.motion.chunk import Chunk
from feedopt_core.pipeline.plan_program import interpolate
from feedopt_core.pipeline.warm_up import warm_up_planning
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner

PERIOD_S = 0.001
_REST_TICKS = 10


@dataclass(frozen=True)
class Measured:
    """One plan of one path.

    Attributes:
        compute_s: CPU time of planning and audits, from segments to chunks; median of the runs.
        first_chunk_s: CPU time until the first chunk.
        window_share: largest ratio of the CPU time of a window to its committed motion time; median of the runs.
        ratio_1khz, ratio_fine: worst ratio to a limit by feedopt_core.audit, with its quantity and axis.
        ratio_check: worst ratio by the differences below, which share no code with the core.
        solvers: number of plans found by each solver.
    """

    case: str
    method: str
    setting: str
    length_mm: float
    motion_s: float
    compute_s: float
    first_chunk_s: float
    window_share: float
    windows: int
    fallbacks: int
    control_points: int
    ratio_1khz: float
    ratio_fine: float
    ratio_check: float
    binding: str
    solvers: dict[str, int] = field(default_factory=dict)


def plan_segments(
    segments: Iterable[Segment],
    machine: Machine,
    parameters: PlannerParameters,
    on_chunk: Callable[[Chunk, float], None],
) -> tuple[float, float]:
    """Plan segment by segment; returns the CPU time in total and until the first chunk, s, without making segments.

    Every chunk is passed on with the CPU time of its window.
    """
    warm_up_planning()
    planner = StreamPlanner(machine, parameters)
    spent_s = first_s = 0.0
    for segment in segments:
        began = time.process_time()
        planner.add_segment(segment)
        while (chunk := planner.next_chunk()) is not None:
            now = time.process_time()
            on_chunk(chunk, now - began)
            spent_s, began = spent_s + now - began, now
            first_s = first_s or spent_s
            planner.discard_before(chunk.s_start_mm)
        spent_s += time.process_time() - began
    return spent_s, first_s


def measure(
    case: str,
    setting: str,
    segments: list[Segment],
    machine: Machine,
    parameters: PlannerParameters,
    *,
    runs: int = 1,
) -> Measured:
    """Plan a path ``runs`` times and audit the plan. Raises what the planner raises."""
    chunks: list[Chunk] = []
    shares: list[float] = []

    def take(chunk: Chunk, spent_s: float) -> None:
        chunks.append(chunk)
        shares.append(window_share(chunk, spent_s))

    times = []
    for _ in range(runs):
        chunks.clear()
        shares.clear()
        times.append((*plan_segments(segments, machine, parameters, take), max(shares)))
    toolpath = Toolpath()
    for segment in segments:
        toolpath.append(segment)
    setpoints = interpolate(toolpath, chunks, machine)
    sampled = audit_setpoints(setpoints.position_mm, setpoints.s_mm, PERIOD_S, machine)
    fine = merge(audit_profile(toolpath, chunk.profile, machine, chunk.t_start_s) for chunk in chunks)
    worst = max((sampled.worst, fine.worst), key=lambda row: row.ratio)
    return Measured(
        case=case,
        method=parameters.method,
        setting=setting,
        length_mm=toolpath.end_mm,
        motion_s=chunks[-1].t_commit_s,
        compute_s=statistics.median(spent for spent, _, _ in times),
        first_chunk_s=statistics.median(first for _, first, _ in times),
        window_share=statistics.median(share for _, _, share in times),
        windows=len(chunks),
        fallbacks=sum(chunk.figures.fallback for chunk in chunks),
        control_points=sum(chunk.figures.variables for chunk in chunks),
        ratio_1khz=sampled.worst.ratio,
        ratio_fine=fine.worst.ratio,
        ratio_check=worst_difference(setpoints.position_mm, machine),
        binding=f"{worst.quantity} {worst.axis}".strip(),
        solvers=dict(Counter(chunk.figures.solver for chunk in chunks)),
    )


def window_share(chunk: Chunk, spent_s: float) -> float:
    """Ratio of the CPU time of a window to its committed motion time."""
    return spent_s / (chunk.t_commit_s - chunk.t_start_s)


def worst_difference(position_mm: FloatArray, machine: Machine) -> float:
    """Largest ratio of any axis to its limits, by repeated subtraction of set points, with standstill at both ends."""
    rest = _REST_TICKS
    x = np.concatenate([np.repeat(position_mm[:1], rest, 0), position_mm, np.repeat(position_mm[-1:], rest, 0)])
    v1 = (x[1:] - x[:-1]) / PERIOD_S
    a1 = (v1[1:] - v1[:-1]) / PERIOD_S
    j1 = (a1[1:] - a1[:-1]) / PERIOD_S
    ratios = [
        np.max(np.abs(values) / np.array(limits))
        for values, limits in (
            (v1, machine.velocity_limit_mm_s),
            (a1, machine.acceleration_limit_mm_s2),
            (j1, machine.jerk_limit_mm_s3),
        )
    ]
    # All at the same instants: a at set point i, v and j as the mean of their two neighbours.
    v, a, j = 0.5 * (v1[1:-2] + v1[2:-1]), a1[1:-1], 0.5 * (j1[:-1] + j1[1:])
    if machine.drive is not None and machine.control_limit_volts is not None:
        m, b, c, d = (np.array(row) for row in vars(machine.drive).values())
        ratios.append(np.max(np.abs(m * a + b * v + c + d * np.sign(v)) / np.array(machine.control_limit_volts)))
    if machine.tracking is not None and machine.planned_tracking_error_mm is not None:
        kv, ka, kj = (np.array(row) for row in vars(machine.tracking).values())
        ratios.append(np.max(np.abs(kv * v + ka * a + kj * j) / np.array(machine.planned_tracking_error_mm)))
    return float(max(ratios))


def resident_mb() -> float:
    """Resident memory of this process now, MB."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * resource.getpagesize() / 1e6
