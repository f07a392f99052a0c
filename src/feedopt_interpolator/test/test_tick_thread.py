"""The thread of the ticks: every set point is published once and in order, whatever it meets."""

from __future__ import annotations

import copy
import gc
import threading
import time
from typing import Any

import numpy as np
import pytest
from planned_motion import machine, planned

from feedopt_core.errors import ToolpathError
from feedopt_core.motion.setpoints import InterpolatorParameters
from feedopt_interpolator.conversions import SetpointRows
from feedopt_interpolator.program_motion import ProgramMotion
from feedopt_interpolator.real_time import sleep_until
from feedopt_interpolator.tick_thread import Lateness, TickEvents, TickThread
from feedopt_node.conversions import nanoseconds

PARAMETERS = InterpolatorParameters(rest_before_ticks=3, rest_after_ticks=5)
PERIOD_S = 0.001


class Publisher:
    """Keeps what is published; holds up one tick for a while where told to."""

    def __init__(self, slow_sequence: int = 0, slow_s: float = 0.0) -> None:
        self.messages: list[Any] = []
        self.acknowledged = False
        self._slow = (slow_sequence, slow_s)

    def publish(self, message: Any) -> None:
        self.messages.append(copy.deepcopy(message))
        if message.sequence == self._slow[0]:
            time.sleep(self._slow[1])

    def wait_for_all_acked(self, timeout: Any) -> bool:
        self.acknowledged = True
        return True


class Player:
    """A tick thread with its events."""

    def __init__(self, publisher: Publisher) -> None:
        self.publisher = publisher
        self.over = threading.Event()
        self.lateness: Lateness | None = None
        self.error: Exception | None = None
        self.starved: list[int] = []
        events = TickEvents(self._ended, self._failed, self._starved)
        self.thread = TickThread(publisher, PERIOD_S, 10, events)
        self.thread.start()

    def play(self, motion: ProgramMotion) -> None:
        self.over.clear()
        self.thread.play(motion)
        assert self.over.wait(60.0)

    def _ended(self, motion: ProgramMotion, lateness: Lateness) -> None:
        self.lateness = lateness
        self.over.set()

    def _starved(self, motion: ProgramMotion) -> None:
        self.starved.append(motion.starved_chunk_sequence)

    def _failed(self, motion: ProgramMotion, error: Exception) -> None:
        self.error = error
        self.over.set()


def whole_motion(program_id: int = 1) -> ProgramMotion:
    segments, chunks = planned()
    motion = ProgramMotion(program_id, machine(), PARAMETERS, 0.0)
    for segment in segments:
        motion.add_segment(segment)
    for chunk in chunks:
        motion.add_chunk(chunk)
    return motion


def assert_whole(messages: list[Any], program_id: int = 1) -> None:
    assert [message.sequence for message in messages] == list(range(1, len(messages) + 1))
    assert [message.tick for message in messages] == list(range(-3, len(messages) - 3))
    assert {message.program_id for message in messages} == {program_id}
    assert [message.last for message in messages] == [False] * (len(messages) - 1) + [True]
    stamps = np.array([nanoseconds(message.stamp) for message in messages])
    assert np.all(np.diff(stamps) == 1_000_000)
    assert np.all(np.array([message.lateness_s for message in messages]) >= 0.0)


def test_every_tick_is_published_and_the_thread_plays_again() -> None:
    player = Player(Publisher())
    player.play(whole_motion(1))
    assert player.error is None
    assert player.publisher.acknowledged
    assert_whole(player.publisher.messages, 1)
    first = [message.position_mm.tolist() for message in player.publisher.messages]
    player.publisher.messages.clear()
    player.play(whole_motion(2))
    player.thread.close()
    assert_whole(player.publisher.messages, 2)
    assert [message.position_mm.tolist() for message in player.publisher.messages] == first
    assert gc.isenabled()


def test_a_tick_that_is_held_up_delays_none_of_the_others_away() -> None:
    player = Player(Publisher(slow_sequence=50, slow_s=0.03))
    player.play(whole_motion())
    player.thread.close()
    assert_whole(player.publisher.messages)
    assert player.lateness is not None
    assert len(player.lateness.values_s) == len(player.publisher.messages)
    late = [message.sequence for message in player.publisher.messages if message.lateness_s >= PERIOD_S]
    assert set(range(51, 75)) <= set(late)
    assert player.lateness.missed_ticks == player.thread.missed_ticks == len(late)
    assert int(player.lateness.figures()["missed_ticks"]) == len(late)


def test_what_cannot_be_computed_fails_the_program_and_not_the_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    player = Player(Publisher())
    broken = whole_motion()

    def fail(count: int) -> None:
        raise ToolpathError("no path here")

    monkeypatch.setattr(broken, "next_block", fail)
    player.play(broken)
    assert isinstance(player.error, ToolpathError)
    assert player.publisher.messages == []
    player.play(whole_motion())
    player.thread.close()
    assert_whole(player.publisher.messages)


def test_starvation_is_reported_once_with_its_chunk() -> None:
    segments, chunks = planned(commitment_mm=15.0)
    motion = ProgramMotion(1, machine(), PARAMETERS, 0.0)
    for segment in segments:
        motion.add_segment(segment)
    motion.add_chunk(chunks[0])
    motion.abandon()
    player = Player(Publisher())
    player.play(motion)
    player.thread.close()
    assert player.starved == [chunks[0].sequence]
    assert_whole(player.publisher.messages)


def test_closing_cuts_a_motion_off() -> None:
    player = Player(Publisher())
    player.thread.play(ProgramMotion(1, machine(), PARAMETERS, 0.0))
    player.thread.close()
    assert player.publisher.messages == []


def test_rows_carry_the_block_into_messages() -> None:
    motion = whole_motion()
    from feedopt_msgs.msg import AxisSetpoint

    block = motion.next_block(30)
    assert block is not None
    rows, message = SetpointRows(block), AxisSetpoint()
    assert len(rows) == 30
    for row in range(30):
        rows.fill(row, message)
        assert message.tick == block.tick[row]
        assert message.chunk_sequence == block.chunk_sequence[row]
        assert (message.s_mm, message.feedrate_mm_s) == (block.s_mm[row], block.v_mm_s[row])
        for name in ("position_mm", "velocity_mm_s", "acceleration_mm_s2"):
            assert getattr(message, name).tolist() == getattr(block, name)[row].tolist()


def test_a_sleep_never_ends_before_its_deadline() -> None:
    for ahead_ns in (-1_000_000, 0, 300_000, 2_000_000):
        deadline_ns = time.monotonic_ns() + ahead_ns
        sleep_until(deadline_ns)
        assert time.monotonic_ns() >= deadline_ns
