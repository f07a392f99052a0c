"""Replays each stage of the pipeline: recorded inputs through the conversions and the core that the node uses.

What depends on the clock in a running graph is read from the recording: at which tick the interpolator knew which
chunk, and after which stop the planner started again. Everything else follows from the inputs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from sensor_msgs.msg import JointState

from feedopt_core.motion.chunk import Chunk
from feedopt_core.motion.setpoints import InterpolatorParameters, SetpointStream
from feedopt_core.pipeline.read_program import SUFFIXES, Program, read_program
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner
from feedopt_core.programs.layers.transitions import LayerTransitions
from feedopt_interpolator.conversions import SetpointRows
from feedopt_interpolator.setpoint_buffer import BLOCK_TICKS
from feedopt_msgs.msg import AxisSetpoint, AxisState
from feedopt_node.conversions import (
    chunk_from_message,
    chunk_to_message,
    machine_to_message,
    segment_from_message,
    segment_to_message,
)
from feedopt_planner.conversions import DisplayPath
from feedopt_tools.replay.columns import Columns
from feedopt_tools.replay.recorded_program import ProgramText, RecordedProgram
from router_sim.conversions import fill_joint_state, fill_state, setpoint_rows
from router_sim.machine_file import parse_router_parameters
from router_sim.router import SimulatedRouter

_JOIN_MM = 1e-6
# A changed core may never end the motion. Stop so many ticks after the recorded end.
_OVERRUN_TICKS = 1000

Outputs: TypeAlias = Mapping[str, Columns]


@dataclass(frozen=True)
class Stage:
    """One stage: its node, its input and output topics, and the function that fills the outputs."""

    node: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    run: Callable[[RecordedProgram, Outputs], None]


def run_toolpath(recorded: RecordedProgram, outputs: Outputs) -> None:
    """Program text to segments, and the path for display."""
    program = recorded.program()
    tolerance_mm = program.tolerance_mm or recorded.number("toolpath", "tolerance_mm")
    display = DisplayPath(recorded.number("toolpath", "display_spacing_mm"))
    transitions = LayerTransitions.requested(program.transition_reach_mm, program.transition_side)
    dimensions = recorded.machine().dimensions
    for segment in read_program(_opened(program), program.name, dimensions, tolerance_mm, transitions):
        outputs["/toolpath"].add(segment_to_message(segment, recorded.program_id))
        display.add(segment)
    outputs["/toolpath_display"].add(display.to_message(0))


def _opened(program: ProgramText) -> Program:
    """The program as the node opened it. The suffix gives its kind; without a suffix, the content does."""
    kind = SUFFIXES.get(Path(program.name).suffix.lower())
    if kind is None:
        return Program.from_text(program.text)
    return Program(kind, program.text.splitlines(keepends=True))


def run_planner(recorded: RecordedProgram, outputs: Outputs) -> None:
    """Segments to chunks. As in the node, a segment is added only when nothing can be planned without it."""
    machine = recorded.machine()
    outputs["/machine"].add(machine_to_message(machine))
    planner = StreamPlanner(machine, recorded.parameters("planner", PlannerParameters))
    segments = deque(segment_from_message(message) for message in recorded.messages("/toolpath"))
    restarts = restarts_of([chunk_from_message(message) for message in recorded.messages("/feed_profile")])
    made = outputs["/feed_profile"]
    while True:
        stopped = restarts.pop(made.count, 0)
        if stopped:
            planner.restart_after_stop(stopped)
        chunk = planner.next_chunk()
        if chunk is not None:
            made.add(chunk_to_message(chunk, recorded.program_id))
        elif segments:
            planner.add_segment(segments.popleft())
        elif made.count not in restarts:
            return


def restarts_of(chunks: list[Chunk]) -> dict[int, int]:
    """Chunks that start where an earlier chunk stops: there the machine had come to a stop for want of a chunk.

    Returns:
        Index of the chunk that starts from standstill: sequence of the chunk whose stop the machine took.
    """
    found = {}
    for index in range(1, len(chunks)):
        start_mm = chunks[index].s_start_mm
        if abs(start_mm - chunks[index - 1].s_commit_mm) <= _JOIN_MM:
            continue
        stops = [chunk.sequence for chunk in chunks[:index] if abs(chunk.s_stop_mm - start_mm) <= _JOIN_MM]
        if stops:
            found[index] = stops[-1]
    return found


def run_interpolator(recorded: RecordedProgram, outputs: Outputs) -> None:
    """Segments and chunks to set points, in the blocks of the node. A chunk arrives when it was first used."""
    stream = SetpointStream(recorded.machine(), recorded.parameters("interpolator", InterpolatorParameters))
    for message in recorded.messages("/toolpath"):
        stream.add_segment(segment_from_message(message))
    chunks = deque(chunk_from_message(message) for message in recorded.messages("/feed_profile"))
    used = np.maximum.accumulate(
        np.array(recorded.columns("/axis_setpoint").values.get("chunk_sequence", [0]), dtype=np.int64)
    )
    # An aborted program has no last chunk: it ended in a stop, as the recording shows.
    aborted = not any(chunk.last for chunk in chunks)
    made, message = outputs["/axis_setpoint"], AxisSetpoint(program_id=recorded.program_id)
    finished = False
    while not finished and made.count < len(used) + _OVERRUN_TICKS:
        latest = int(used[min(made.count + BLOCK_TICKS, len(used)) - 1])
        # The standstill before the motion needs the first chunk.
        while chunks and chunks[0].sequence <= max(latest, 1):
            stream.add_chunk(chunks.popleft())
        block = stream.next_block(BLOCK_TICKS)
        if block is None:
            return
        ended = aborted and made.count + len(block.tick) >= len(used)
        rows = SetpointRows(replace(block, finished=True) if ended else block)
        for row in range(len(rows)):
            rows.fill(row, message)
            message.sequence = made.count + 1
            made.add(message)
        finished = rows.finished


def run_router_sim(recorded: RecordedProgram, outputs: Outputs) -> None:
    """Set points to axis states and joint states."""
    drives = parse_router_parameters(recorded.machine_yaml, f"{recorded.path}: recorded machine")
    router, every = SimulatedRouter(drives), int(recorded.number("router_sim", "joint_state_ticks"))
    state, joints = AxisState(), JointState(name=list(drives.axis_names))
    made = outputs["/axis_state"]
    for setpoint in recorded.messages("/axis_setpoint"):
        position_mm, velocity_mm_s, acceleration_mm_s2 = setpoint_rows(setpoint)
        if setpoint.sequence == 1:
            router.reset(position_mm)
        fill_state(state, setpoint, made.count + 1, router.step(position_mm, velocity_mm_s, acceleration_mm_s2))
        if made.count % every == 0:
            fill_joint_state(joints, state)
            outputs["/joint_states"].add(joints)
        made.add(state)


STAGES = (
    Stage("toolpath", (), ("/toolpath", "/toolpath_display"), run_toolpath),
    Stage("planner", ("/toolpath",), ("/machine", "/feed_profile"), run_planner),
    Stage("interpolator", ("/toolpath", "/feed_profile"), ("/axis_setpoint",), run_interpolator),
    Stage("router_sim", ("/axis_setpoint",), ("/axis_state", "/joint_states"), run_router_sim),
)
"""In the order of the pipeline: look at the first stage that differs."""
