"""The stream when chunks come late: the machine stops on the path, holds every limit and goes on."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from core_motion import PERIOD_S, difference_ratios
from core_paths import kinematic_machine, polyline, spline, toolpath_of
from hypothesis import given, settings
from hypothesis import strategies as st

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.errors import SolverError, ToolpathError
from feedopt_core.geometry.segments import Segment
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.motion.certificate import ALLOWED_RATIO
from feedopt_core.motion.chunk import Chunk
from feedopt_core.motion.setpoints import InterpolatorParameters, SetpointStream
from feedopt_core.planner.method import PlanningMethod, Window, WindowPlan
from feedopt_core.planner.methods import make_method
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner

MACHINE = kinematic_machine(feed=80.0)
SHORT_WINDOWS = PlannerParameters(knot_spacing_mm=0.5, look_ahead_mm=20.0, commitment_mm=12.0)
WAVE = spline([(6.0 * k, 5.0 * np.sin(0.9 * k)) for k in range(14)])


@dataclass(frozen=True)
class Recorded:
    """Set points of a whole program as they came out."""

    tick: IntArray
    s_mm: FloatArray
    v_mm_s: FloatArray
    position_mm: FloatArray
    starved: list[int]
    refused: list[int]


class Stream:
    """Planner and interpolator with a slow line between them.

    ``delay_ticks(n)`` is how long chunk n takes. The planner keeps some chunks on the way and hears of a stop only
    after the next block, as it would over a status topic.
    """

    def __init__(
        self,
        segments: list[Segment],
        delay_ticks: Callable[[int], int],
        block_ticks: int,
        method: PlanningMethod | None = None,
        on_the_way: int = 2,
    ) -> None:
        self.planner = StreamPlanner(MACHINE, SHORT_WINDOWS, method)
        self.stream = SetpointStream(MACHINE, InterpolatorParameters(rest_before_ticks=5, rest_after_ticks=7))
        for segment in segments:
            self.planner.add_segment(segment)
            self.stream.add_segment(segment)
        self.delay_ticks = delay_ticks
        self.block_ticks = block_ticks
        self.on_the_way = on_the_way
        self.line: deque[tuple[int, Chunk]] = deque()
        self.refused = list[int]()

    def run(self) -> Recorded:
        blocks, starved, now = [], list[int](), 0
        while True:
            self._fill(now)
            while self.line and self.line[0][0] <= now:
                chunk = self.line.popleft()[1]
                if not self.stream.add_chunk(chunk):
                    self.refused.append(chunk.sequence)
            block = self.stream.next_block(self.block_ticks)
            now += self.block_ticks
            assert now < 100_000, "the stream never ends"
            if block is None:
                continue
            blocks.append(block)
            if block.finished:
                break
            if (sequence := self.stream.starved_chunk_sequence) and sequence not in starved:
                starved.append(sequence)
                self.planner.restart_after_stop(sequence)
        assert self.stream.next_block(10) is None
        return Recorded(
            np.concatenate([block.tick for block in blocks]),
            np.concatenate([block.s_mm for block in blocks]),
            np.concatenate([block.v_mm_s for block in blocks]),
            np.concatenate([block.position_mm for block in blocks]),
            starved,
            self.refused,
        )

    def _fill(self, now: int) -> None:
        while len(self.line) < self.on_the_way and (chunk := self.planner.next_chunk()) is not None:
            self.line.append((now + self.delay_ticks(chunk.sequence), chunk))


def assert_sound(recorded: Recorded, segments: list[Segment]) -> None:
    """Equidistant ticks, on the path, forwards only, every limit at 1 kHz, to the end."""
    toolpath = toolpath_of(segments)
    assert np.array_equal(recorded.tick, np.arange(-5, len(recorded.tick) - 5))
    assert np.allclose(recorded.position_mm, toolpath.evaluate(recorded.s_mm).r_mm, atol=1e-9)
    assert np.all(np.diff(recorded.s_mm) >= -1e-9)
    ratios = difference_ratios(recorded.position_mm, MACHINE)
    assert max(ratios.values()) <= ALLOWED_RATIO, ratios
    assert recorded.s_mm[0] == 0.0
    assert recorded.s_mm[-1] == pytest.approx(toolpath.end_mm, abs=1e-9)
    assert np.allclose(np.diff(recorded.s_mm) / PERIOD_S, recorded.v_mm_s[:-1], atol=1.0)


def test_chunks_in_time_never_stop_the_machine() -> None:
    recorded = Stream(WAVE, lambda _: 0, 50).run()
    assert recorded.starved == []
    assert_sound(recorded, WAVE)
    moving = recorded.v_mm_s[(recorded.s_mm > 1.0) & (recorded.s_mm < recorded.s_mm[-1] - 1.0)]
    assert np.min(moving) > 5.0


@pytest.mark.parametrize("block_ticks", [2, 10, 137])
def test_late_chunk_stops_the_machine_on_the_path(block_ticks: int) -> None:
    """Chunk 3 comes long after the stop: the machine waits there, then continues from standstill."""
    recorded = Stream(WAVE, lambda n: 3000 if n == 3 else 0, block_ticks).run()
    assert recorded.starved == [2]
    assert recorded.refused[0] == 3
    assert_sound(recorded, WAVE)
    resting = recorded.v_mm_s[(recorded.tick > 100) & (recorded.s_mm < recorded.s_mm[-1] - 1.0)] < 1e-9
    assert np.count_nonzero(resting) > 1000


def test_chunk_that_is_hardly_late_finds_the_stop_under_way() -> None:
    """The stop once begun is taken to its end, whatever arrives meanwhile."""
    plain = Stream(WAVE, lambda _: 0, 5).run()
    recorded = Stream(WAVE, lambda n: 600 if n == 3 else 0, 5).run()
    assert recorded.starved == [2]
    assert len(recorded.tick) < len(plain.tick) + 1000
    assert_sound(recorded, WAVE)


@settings(max_examples=8)
@given(
    delays=st.lists(st.integers(0, 900), min_size=30, max_size=30),
    block_ticks=st.sampled_from([3, 7, 20, 100]),
    on_the_way=st.integers(1, 3),
)
def test_any_delay_is_survived(delays: list[int], block_ticks: int, on_the_way: int) -> None:
    recorded = Stream(WAVE, lambda n: delays[n % 30], block_ticks, on_the_way=on_the_way).run()
    assert_sound(recorded, WAVE)


def test_machine_that_starves_after_every_chunk_still_arrives() -> None:
    recorded = Stream(WAVE, lambda _: 1500, 20, on_the_way=1).run()
    assert len(recorded.starved) >= 2
    assert_sound(recorded, WAVE)


def test_late_chunk_after_an_exact_stop() -> None:
    """The chunk before ends at standstill itself: waiting there is no starvation, and nothing is planned again."""
    segments: list[Segment] = list(polyline([(0, 0), (40, 0), (40, 30)]))
    recorded = Stream(segments, lambda n: 2500 if n == 2 else 0, 20).run()
    assert recorded.refused == []
    assert_sound(recorded, segments)


class FailsOnce:
    """The kinematic method without a plan for its second window."""

    name = "fails_once"
    stopping_mm = 20.0
    whole_path = False

    def __init__(self) -> None:
        self.asked = 0

    def plan(self, toolpath: Toolpath, window: Window) -> WindowPlan:
        self.asked += 1
        if self.asked == 2:
            raise SolverError("no plan in this window")
        return make_method("lp", MACHINE, 0.5).plan(toolpath, window)


def test_fallback_in_time_is_a_stop_and_goes_on() -> None:
    recorded = Stream(WAVE, lambda _: 0, 20, FailsOnce()).run()
    assert recorded.starved == []
    assert_sound(recorded, WAVE)


def test_fallback_that_comes_late_is_a_stop_and_goes_on() -> None:
    """Both faults at once: chunk 2 is the stop of chunk 1, which the machine has taken by itself already."""
    recorded = Stream(WAVE, lambda n: 3000 if n in (2, 3) else 0, 20, FailsOnce(), on_the_way=3).run()
    assert recorded.starved == [1]
    assert_sound(recorded, WAVE)


def test_restart_that_is_asked_for_twice_changes_nothing() -> None:
    """The interpolator repeats its status: the planner may hear of one stop several times."""
    planner = StreamPlanner(MACHINE, SHORT_WINDOWS)
    for segment in WAVE:
        planner.add_segment(segment)
    first = planner.next_chunk()
    assert first is not None
    planner.restart_after_stop(first.sequence)
    second = planner.next_chunk()
    assert second is not None
    planner.restart_after_stop(first.sequence)
    third = planner.next_chunk()
    assert third is not None
    assert third.s_start_mm == second.s_commit_mm


def test_lost_chunk_is_noticed() -> None:
    planner = StreamPlanner(MACHINE, SHORT_WINDOWS)
    stream = SetpointStream(MACHINE, InterpolatorParameters())
    for segment in WAVE:
        planner.add_segment(segment)
        stream.add_segment(segment)
    chunks = [planner.next_chunk() for _ in range(3)]
    first, second, third = chunks
    assert first is not None and second is not None and third is not None
    with pytest.raises(ToolpathError, match="not at 0: a chunk is lost"):
        stream.add_chunk(second)
    assert stream.add_chunk(first)
    with pytest.raises(ToolpathError, match=r"feed-profile chunk 3 starts at s = .* a chunk is lost"):
        stream.add_chunk(third)
    assert stream.add_chunk(second)
