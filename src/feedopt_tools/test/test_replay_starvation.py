"""Runs in which chunks came late are replayed with the same stops, waits and restarts, to the last digit."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("feedopt_msgs.msg")

from feedopt_core.geometry.segments import Segment
from feedopt_core.machine.machine_file import Machine, load_machine
from feedopt_core.motion.chunk import Chunk
from feedopt_core.motion.setpoints import InterpolatorParameters, SetpointStream
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner
from feedopt_core.smoothing.cubic_spline import interpolate_points
from feedopt_interpolator.conversions import SetpointRows
from feedopt_interpolator.setpoint_buffer import BLOCK_TICKS
from feedopt_msgs.msg import AxisSetpoint
from feedopt_node.conversions import chunk_to_message, machine_to_message, segment_to_message
from feedopt_tools.replay.columns import Columns, columns_of
from feedopt_tools.replay.comparison import Tolerances, compare_topic
from feedopt_tools.replay.recorded_program import RecordedProgram
from feedopt_tools.replay.stages import restarts_of, run_interpolator, run_planner

MACHINE = load_machine("case_a")
PLANNER = PlannerParameters(method="lp", knot_spacing_mm=0.5, look_ahead_mm=20.0, commitment_mm=12.0)
INTERPOLATOR = InterpolatorParameters(rest_before_ticks=5, rest_after_ticks=7)
POINTS_MM = np.array([(6.0 * k, 5.0 * np.sin(0.9 * k)) for k in range(14)])


@dataclass
class Run:
    """What a bag would give the stages."""

    segments: list[Segment]
    chunks: list[Chunk] = field(default_factory=list)
    setpoints: Columns = field(default_factory=Columns)
    program_id: int = 1
    starved: list[int] = field(default_factory=list)

    def machine(self) -> Machine:
        return MACHINE

    def parameters(self, node: str, kind: type) -> Any:
        return {"planner": PLANNER, "interpolator": INTERPOLATOR}[node]

    def messages(self, topic: str) -> list[Any]:
        if topic == "/toolpath":
            return [segment_to_message(segment, 1) for segment in self.segments]
        return [chunk_to_message(chunk, 1) for chunk in self.chunks]

    def columns(self, topic: str) -> Columns:
        assert topic == "/axis_setpoint"
        return self.setpoints


def executed(delay_ticks: Callable[[int], int], on_the_way: int = 2) -> Run:
    """Planner and interpolator with a slow line between them; chunk n takes ``delay_ticks(n)``."""
    run = Run(list(interpolate_points(POINTS_MM, list(range(1, len(POINTS_MM) + 1)))))
    planner, stream = StreamPlanner(MACHINE, PLANNER), SetpointStream(MACHINE, INTERPOLATOR)
    for segment in run.segments:
        stream.add_segment(segment)
    waiting, line, now = deque(run.segments), deque[tuple[int, Chunk]](), 0
    message = AxisSetpoint(program_id=1)
    while True:
        while len(line) < on_the_way:
            chunk = planner.next_chunk()
            if chunk is not None:
                run.chunks.append(chunk)
                line.append((now + delay_ticks(chunk.sequence), chunk))
            elif waiting:
                planner.add_segment(waiting.popleft())
            else:
                break
        while line and line[0][0] <= now:
            stream.add_chunk(line.popleft()[1])
        block = stream.next_block(BLOCK_TICKS)
        now += BLOCK_TICKS
        if block is None:
            continue
        rows = SetpointRows(block)
        for row in range(len(rows)):
            rows.fill(row, message)
            message.sequence = run.setpoints.count + 1
            run.setpoints.add(message)
        if block.finished:
            return run
        if (sequence := stream.starved_chunk_sequence) and sequence not in run.starved:
            run.starved.append(sequence)
            planner.restart_after_stop(sequence)


def assert_replayed(run: Run) -> None:
    recorded = cast(RecordedProgram, run)
    outputs = {topic: Columns() for topic in ("/machine", "/feed_profile", "/axis_setpoint")}
    run_planner(recorded, outputs)
    run_interpolator(recorded, outputs)
    exact = Tolerances({"/feed_profile": 0.0, "/axis_setpoint": 0.0})
    chunks = compare_topic("/feed_profile", columns_of(run.messages("/feed_profile")), outputs["/feed_profile"], exact)
    assert chunks.agrees, chunks
    setpoints = compare_topic("/axis_setpoint", run.setpoints, outputs["/axis_setpoint"], exact)
    assert setpoints.agrees, setpoints
    machine = compare_topic("/machine", columns_of([machine_to_message(MACHINE)]), outputs["/machine"], exact)
    assert machine.agrees


def test_run_in_time() -> None:
    run = executed(lambda _: 0)
    assert run.starved == [] and restarts_of(run.chunks) == {}
    assert_replayed(run)


@pytest.mark.parametrize("late", [2, 3, 4])
def test_one_late_chunk(late: int) -> None:
    run = executed(lambda number: 3000 if number == late else 0)
    assert run.starved == [late - 1]
    assert list(restarts_of(run.chunks).values()) == [late - 1]
    assert_replayed(run)


@settings(max_examples=8, deadline=None)
@given(delays=st.lists(st.integers(0, 1500), min_size=1, max_size=6), on_the_way=st.integers(1, 3))
def test_any_delays(delays: list[int], on_the_way: int) -> None:
    assert_replayed(executed(lambda number: delays[number % len(delays)], on_the_way))


def test_program_that_was_given_up_ends_where_it_did() -> None:
    run = executed(lambda number: 3000 if number == 3 else 0)
    # The planner died after chunk 2: the interpolator took that stop and was told to end there.
    kept = run.setpoints.values["chunk_sequence"].index(2)
    at_rest = next(row for row in range(kept, run.setpoints.count) if run.setpoints.values["feedrate_mm_s"][row] == 0.0)
    count = -(-(at_rest + BLOCK_TICKS) // BLOCK_TICKS) * BLOCK_TICKS
    run.chunks = run.chunks[:2]
    run.setpoints = Columns(count, {name: values[:count] for name, values in run.setpoints.values.items()})
    run.setpoints.values["last"][-1] = True
    outputs = {"/axis_setpoint": Columns()}
    run_interpolator(cast(RecordedProgram, run), outputs)
    result = compare_topic("/axis_setpoint", run.setpoints, outputs["/axis_setpoint"], Tolerances())
    assert result.agrees, result
