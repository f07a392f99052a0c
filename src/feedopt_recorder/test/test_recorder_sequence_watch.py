"""Gaps are found from the bytes alone, whatever the middleware hands over."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_run import messages, schemas

from feedopt_recorder.sequence_watch import GAPS_KEPT, Gap, RecorderSummary, SequenceWatch, has_identity


def payload(program_id: int, sequence: int) -> bytes:
    return struct.pack("<4sIIIIQ", b"\0\1\0\0", 1, 2, program_id, 0, sequence)


def watched(numbers: list[tuple[int, int]]) -> SequenceWatch:
    watch = SequenceWatch("/axis_setpoint", identified=True)
    for program_id, sequence in numbers:
        watch.add(payload(program_id, sequence))
    return watch


def test_the_offsets_are_those_of_the_real_messages() -> None:
    watches = {
        topic: SequenceWatch(topic, identified=True)
        for topic in ("/toolpath", "/feed_profile", "/axis_setpoint", "/axis_state")
    }
    counts = dict.fromkeys(watches, 0)
    for message in messages(0.2):
        if message.topic in watches:
            watches[message.topic].add(message.payload)
            counts[message.topic] += 1
    for topic, watch in watches.items():
        assert watch.gaps == []
        assert watch.count.programs == {1: counts[topic]}
        assert counts[topic] > 0


@pytest.mark.parametrize(
    ("name", "identified"),
    [
        ("AxisSetpoint", True),
        ("AxisState", True),
        ("FeedProfileChunk", True),
        ("ToolpathSegment", True),
        ("NodeStatus", False),
        ("Machine", False),
    ],
)
def test_which_messages_carry_an_identity(tmp_path: Path, name: str, identified: bool) -> None:
    assert has_identity(schemas(tmp_path).schema(f"feedopt_msgs/msg/{name}")) is identified


def test_first_message_missing_is_a_gap() -> None:
    assert watched([(1, 2), (1, 3)]).gaps == [Gap("/axis_setpoint", 1, 1, 1)]


def test_sequence_numbers_are_64_bits_wide() -> None:
    assert watched([(1, 1), (1, 2**32 + 1)]).count.missing == 2**32 - 1


def test_second_program_starts_at_one_again() -> None:
    watch = watched([(1, 1), (1, 2), (2, 1), (2, 2)])
    assert watch.gaps == []
    assert watch.count.programs == {1: 2, 2: 2}
    assert watched([(1, 1), (2, 2)]).gaps == [Gap("/axis_setpoint", 2, 1, 1)]


def test_repeated_number_is_told_apart_from_a_missing_one() -> None:
    watch = watched([(1, 1), (1, 2), (1, 2), (1, 3)])
    assert (watch.count.missing, watch.count.repeated) == (0, 1)


@given(st.sets(st.integers(1, 60)))
def test_missing_counts_exactly_what_was_dropped(dropped: set[int]) -> None:
    kept = [n for n in range(1, 62) if n not in dropped]
    watch = watched([(1, n) for n in kept])
    assert watch.count.missing == len(dropped)
    found = {n for gap in watch.gaps for n in range(gap.first, gap.last + 1)}
    assert found == dropped


def test_broken_stream_keeps_a_bounded_list() -> None:
    watch = watched([(1, 2 * n) for n in range(1, 3 * GAPS_KEPT)])
    assert len(watch.gaps) == GAPS_KEPT
    assert watch.count.missing == 3 * GAPS_KEPT - 1


def test_summary_is_complete_only_without_loss_and_failure() -> None:
    whole, broken = watched([(1, 1)]), watched([(1, 2)])

    def summary(watch: SequenceWatch, failure: str = "") -> RecorderSummary:
        return RecorderSummary({"/axis_setpoint": watch.count}, tuple(watch.gaps), 1.0, 0.1, failure)

    assert summary(whole).complete
    assert not summary(broken).complete
    assert not summary(whole, "disk full").complete
    assert summary(broken).as_document()["gaps"] == (
        {"topic": "/axis_setpoint", "program_id": 1, "first": 1, "last": 1},
    )


def test_gap_of_a_topic_without_identity_is_seen_in_the_numbers_of_the_middleware() -> None:
    watch = SequenceWatch("/joint_states", identified=False, numbered=True)
    for number in (1, 2, 5, 6):
        watch.add(b"\0\1\0\0", number)
    assert watch.gaps == [Gap("/joint_states", 0, 3, 4)]
    assert (watch.count.messages, watch.count.missing) == (4, 2)


def test_numbers_of_several_publishers_tell_nothing() -> None:
    watch = SequenceWatch("/status", identified=False)
    for number in (1, 1, 7, 2):
        watch.add(b"\0\1\0\0", number)
    assert watch.gaps == []
