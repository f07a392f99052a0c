"""Planning beside the executor: pace, hunger, starvation, faults."""

from __future__ import annotations

import queue
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from feedopt_core.errors import ConfigError, ToolpathError
from feedopt_core.geometry.segments import Segment
from feedopt_core.machine.machine_file import load_machine
from feedopt_core.motion.chunk import Chunk
from feedopt_core.planner.stream_planner import PlannerParameters
from feedopt_core.smoothing.cubic_spline import interpolate_points
from feedopt_planner.planning_thread import PlanningEvents, PlanningThread

PARAMETERS = PlannerParameters(knot_spacing_mm=1.0, commitment_mm=15.0)
PATIENCE_S = 60.0


def segments() -> list[Segment]:
    x_mm = np.linspace(0.0, 300.0, 40)
    points_mm = np.column_stack([x_mm, 4.0 * np.sin(x_mm / 12.0)])
    return list(interpolate_points(points_mm, list(range(1, 41))))


class Planning:
    """A planning thread whose events come out of a queue."""

    def __init__(self, seconds_ahead: float) -> None:
        self.events: queue.Queue[tuple[Any, ...]] = queue.Queue()
        self.thread = PlanningThread(
            load_machine("router_simulation"),
            PARAMETERS,
            seconds_ahead,
            PlanningEvents(
                planned=lambda program_id, chunk: self.events.put(("planned", program_id, chunk)),
                path_needed=lambda: self.events.put(("path_needed",)),
                finished=lambda program_id: self.events.put(("finished", program_id)),
                failed=lambda program_id, error: self.events.put(("failed", program_id, error)),
            ),
        )
        self.thread.start()

    def until(self, kind: str) -> list[tuple[Any, ...]]:
        """Events up to the first of a kind."""
        seen = [self.events.get(timeout=PATIENCE_S)]
        while seen[-1][0] != kind:
            seen.append(self.events.get(timeout=PATIENCE_S))
        return seen

    def chunks(self, events: list[tuple[Any, ...]]) -> list[Chunk]:
        return [event[2] for event in events if event[0] == "planned"]


@pytest.fixture
def far() -> Iterator[Planning]:
    """Plans as far as the path goes."""
    planning = Planning(1e6)
    yield planning
    planning.thread.close()


@pytest.fixture
def near() -> Iterator[Planning]:
    """Keeps half a second ahead of the motion."""
    planning = Planning(0.5)
    yield planning
    planning.thread.close()


def test_a_whole_program_is_planned_in_order(far: Planning) -> None:
    far.thread.open(7)
    for segment in segments():
        far.thread.add_segment(segment)
    events = far.until("finished")
    chunks = far.chunks(events)
    assert events[-1] == ("finished", 7)
    assert [chunk.sequence for chunk in chunks] == list(range(1, len(chunks) + 1))
    assert chunks[-1].last
    assert far.thread.last_segment_sequence == len(segments())
    assert far.thread.committed == (chunks[-1].s_commit_mm, chunks[-1].t_commit_s)


def test_needed_path_is_reported_once_until_the_next_segment(far: Planning) -> None:
    far.thread.open(1)
    far.until("path_needed")
    for segment in segments():
        far.thread.add_segment(segment)
    assert far.until("finished")[-1] == ("finished", 1)


def test_no_more_is_committed_than_the_motion_asks_for(near: Planning) -> None:
    near.thread.open(1)
    every = segments()
    for segment in every:
        near.thread.add_segment(segment)
    reached_s, chunks = 0.0, list[Chunk]()
    while not (chunks and chunks[-1].last):
        chunks += near.chunks(near.until("planned"))
        # A chunk is only begun while less than half a second is committed beyond the motion.
        assert chunks[-1].t_start_s - reached_s < 0.5
        reached_s = max(reached_s, chunks[-1].t_commit_s - 0.4)
        near.thread.motion_reached(1, motion_time_s=reached_s, s_mm=0.0, starved_chunk_sequence=0)
    assert len(chunks) > 3


def test_after_starvation_planning_goes_on_from_the_stop(near: Planning) -> None:
    near.thread.open(1)
    for segment in segments():
        near.thread.add_segment(segment)
    first = near.chunks(near.until("planned"))[-1]
    near.thread.motion_reached(1, motion_time_s=first.t_start_s + 10.0, s_mm=0.0, starved_chunk_sequence=first.sequence)
    chunks = near.chunks(near.until("finished"))
    resumed = [chunk for chunk in chunks if chunk.s_start_mm == pytest.approx(first.s_stop_mm)]
    assert resumed
    assert resumed[0].t_start_s == pytest.approx(first.t_start_s + first.profile.duration_s)
    assert chunks[-1].last


def test_an_error_ends_the_program_and_not_the_thread(far: Planning) -> None:
    every = segments()
    far.thread.open(1)
    far.thread.add_segment(every[1])
    event = far.until("failed")[-1]
    assert event[1] == 1
    assert isinstance(event[2], ToolpathError)
    assert not far.thread.abandon(1)
    far.thread.open(2)
    for segment in every:
        far.thread.add_segment(segment)
    assert far.until("finished")[-1] == ("finished", 2)


def test_an_abandoned_program_says_nothing_more(near: Planning) -> None:
    near.thread.open(1)
    for segment in segments():
        near.thread.add_segment(segment)
    near.until("planned")
    assert near.thread.abandon(1)
    while not near.events.empty():
        near.events.get()
    near.thread.motion_reached(1, motion_time_s=1e3, s_mm=0.0, starved_chunk_sequence=0)
    near.thread.open(2)
    events = near.until("path_needed")
    assert all(event[0] == "path_needed" or event[1] == 2 for event in events)


def test_an_unknown_method_is_refused_before_any_program() -> None:
    events = PlanningEvents(*[lambda *arguments: None] * 4)
    with pytest.raises(ConfigError, match="method 'none' is unknown"):
        PlanningThread(load_machine("router_simulation"), PlannerParameters(method="none"), 1.0, events)
