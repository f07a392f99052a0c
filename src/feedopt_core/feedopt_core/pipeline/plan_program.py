"""The whole pipeline without ROS: program to audited set points."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.audit.deviation import DeviationReport, measure_deviation
from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.audit.setpoints import audit_setpoints
from feedopt_core.errors import SolverError
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.certificate import AuditReport, merge
from feedopt_core.motion.chunk import Chunk
from feedopt_core.motion.setpoints import InterpolatorParameters, SetpointStream
from feedopt_core.pipeline.read_program import ProgramKind, open_program, read_moves, read_program
from feedopt_core.pipeline.warm_up import warm_up
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner
from feedopt_core.programs.layers.transitions import LayerTransitions
from feedopt_core.smoothing.cubic_spline import DEFAULT_TOLERANCE_MM

_BLOCK_TICKS = 1000


@dataclass(frozen=True)
class Setpoints:
    """Set points of a whole program, from standstill at t = 0 to standstill at the end.

    ``position_mm`` has shape (n, n_axes), ``tool_mm`` (n, 3) with z = 0 on plane machines, the others (n,).
    """

    tick: IntArray
    t_s: FloatArray
    s_mm: FloatArray
    v_mm_s: FloatArray
    position_mm: FloatArray
    tool_mm: FloatArray


@dataclass(frozen=True)
class Plan:
    """A planned program.

    Attributes:
        toolpath: the whole path.
        chunks: chunks as the planner node would publish them.
        setpoints: at the interpolator's period.
        audit: worst ratios on the fine grid and at the set points.
        deviation: of the smoothed from the programmed path; None for points, which are passed through.
        motion_time_s: from standstill to standstill.
        compute_time_s: reading, smoothing and planning.
        first_chunk_s: part of ``compute_time_s`` until the first chunk.
    """

    toolpath: Toolpath
    chunks: tuple[Chunk, ...]
    setpoints: Setpoints
    audit: AuditReport
    deviation: DeviationReport | None
    motion_time_s: float
    compute_time_s: float
    first_chunk_s: float


def plan_program(
    path: Path,
    machine: Machine,
    parameters: PlannerParameters,
    tolerance_mm: float = DEFAULT_TOLERANCE_MM,
    transitions: LayerTransitions | None = None,
) -> Plan:
    """Plan a program file as the nodes do: one segment and one chunk after another.

    Args:
        path: program file.
        machine: machine with its limits.
        parameters: parameters of the planner.
        tolerance_mm: largest distance of the smoothed from the programmed path, above zero.
        transitions: replace the moves between layers of closed contours; None: keep all as programmed.

    Raises:
        ToolpathError: see :func:`read_program`.
        ConfigError, InfeasibleLimitsError, SolverError: see :class:`StreamPlanner`.
    """
    # Compiled code is loaded before the clock starts, because loading is not part of planning.
    warm_up()
    began = time.perf_counter()
    planner = StreamPlanner(machine, parameters)
    toolpath, chunks, first_chunk_s = Toolpath(), list[Chunk](), 0.0
    program = open_program(path)
    for segment in read_program(program, str(path), machine.dimensions, tolerance_mm, transitions):
        toolpath.append(segment)
        planner.add_segment(segment)
        while (chunk := planner.next_chunk()) is not None:
            first_chunk_s = first_chunk_s or time.perf_counter() - began
            chunks.append(chunk)
            planner.discard_before(chunk.s_start_mm)
    compute_time_s = time.perf_counter() - began
    if not planner.finished:
        raise SolverError(f"planning ended at s = {planner.committed_s_mm:g} of {toolpath.end_mm:g} mm")
    setpoints = interpolate(toolpath, chunks, machine)
    fine = [audit_profile(toolpath, chunk.profile, machine, chunk.t_start_s) for chunk in chunks]
    sampled = audit_setpoints(setpoints.position_mm, setpoints.s_mm, machine.period_s, machine)
    audit = merge([*fine, sampled])
    deviation = None
    if program.kind is not ProgramKind.POINTS:
        moves = read_moves(program, str(path), transitions)
        deviation = measure_deviation(moves, toolpath.segments, tolerance_mm)
    times_s = planner.committed_t_s, compute_time_s, first_chunk_s
    return Plan(toolpath, tuple(chunks), setpoints, audit, deviation, *times_s)


def interpolate(toolpath: Toolpath, chunks: list[Chunk], machine: Machine) -> Setpoints:
    """Set points of all chunks of a program, from tick 0 to the first tick at standstill after the motion."""
    stream = SetpointStream(machine, InterpolatorParameters(rest_before_ticks=0, rest_after_ticks=0))
    for segment in toolpath.segments:
        stream.add_segment(segment)
    for chunk in chunks:
        stream.add_chunk(chunk)
    blocks = []
    while (block := stream.next_block(_BLOCK_TICKS)) is not None:
        blocks.append(block)
    s_mm = np.concatenate([block.s_mm for block in blocks])
    tool_mm = toolpath.evaluate(s_mm).r_mm
    return Setpoints(
        tick=(ticks := np.concatenate([block.tick for block in blocks])),
        t_s=ticks * machine.period_s,
        s_mm=s_mm,
        v_mm_s=np.concatenate([block.v_mm_s for block in blocks]),
        position_mm=np.concatenate([block.position_mm for block in blocks]),
        tool_mm=np.pad(tool_mm, ((0, 0), (0, 3 - tool_mm.shape[1]))),
    )
