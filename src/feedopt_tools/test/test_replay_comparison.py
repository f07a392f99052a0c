"""Whatever is changed in a recorded message is found, at its place; what only tells of the clock is not."""

from __future__ import annotations

import copy
from array import array
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from feedopt_tools.replay.columns import Columns, columns_of, columns_of_arrays
from feedopt_tools.replay.comparison import Tolerances, TopicComparison, compare_topic

COUNT = 30
TOPIC = "/axis_setpoint"


@dataclass
class Stamp:
    sec: int = 0
    nanosec: int = 0


@dataclass
class Sample:
    sequence: int
    tick: int
    s_mm: float
    position_mm: Any
    last: bool = False
    method: str = "lp"
    lateness_s: float = 0.0
    stamp: Stamp = field(default_factory=Stamp)
    parts: list[Stamp] = field(default_factory=list)


def samples() -> list[Sample]:
    return [
        Sample(i + 1, i, 0.25 * i, np.array([10.0 * np.sin(i), 7.0]), parts=[Stamp(i, 1), Stamp(i, 2)])
        for i in range(COUNT)
    ]


def compared(now: list[Sample], tolerances: Tolerances | None = None) -> TopicComparison:
    return compare_topic(TOPIC, columns_of(samples()), columns_of(now), tolerances or Tolerances())


def test_equal_messages_agree() -> None:
    result = compared(samples())
    assert result.agrees
    assert result.differences == ()


@given(
    index=st.integers(0, COUNT - 1),
    axis=st.integers(0, 1),
    ratio=st.floats(1e-12, 1e-3),
    times=st.sampled_from([0.9, 1.1]),
)
def test_tolerance_is_relative_to_the_largest_value(index: int, axis: int, ratio: float, times: float) -> None:
    now = samples()
    largest = max(float(np.max(np.abs(sample.position_mm))) for sample in now)
    now[index].position_mm[axis] += times * ratio * largest + np.sign(times - 1.0) * 1e-14
    result = compared(now, Tolerances({f"{TOPIC}.position_mm": ratio}))
    assert result.agrees == (times < 1.0)
    if times > 1.0:
        (difference,) = result.differences
        assert (difference.field, difference.index, difference.element) == ("position_mm", index, axis)
        assert difference.place == f"message {index + 1}, tick {index}, s_mm {0.25 * index:.6g}"


@pytest.mark.parametrize(
    ("name", "value"), [("sequence", 99), ("tick", -5), ("last", True), ("method", "nlp"), ("s_mm", float("nan"))]
)
def test_every_other_field_must_agree(name: str, value: Any) -> None:
    now = samples()
    setattr(now[7], name, value)
    result = compared(now, Tolerances({TOPIC: 1e-3}))
    assert dict(result.differing) == {name: 1}
    assert result.differences[0].index == 7


def test_clock_is_ignored_wherever_it_stands() -> None:
    now = samples()
    for sample in now:
        sample.stamp.sec, sample.lateness_s = 5, 0.1
    assert compared(now).agrees
    assert not compare_topic(TOPIC, columns_of(samples()), columns_of(now), Tolerances(), ignored=("stamp",)).agrees


def test_parts_of_a_message_are_compared() -> None:
    now = samples()
    now[3].parts[1].nanosec = 9
    assert dict(compared(now).differing) == {"parts[].nanosec": 1}
    now = samples()
    now[3].parts.pop()
    assert "parts[]" in compared(now).differing


@pytest.mark.parametrize("lost", [0, 12, COUNT - 1])
def test_lost_message_is_found(lost: int) -> None:
    now = samples()
    del now[lost]
    result = compared(now)
    assert not result.agrees
    assert (result.recorded, result.replayed) == (COUNT, COUNT - 1)
    # Behind the gap every message is another one.
    assert result.differing.get("sequence", 0) == COUNT - 1 - lost


def test_swapped_messages_are_found() -> None:
    now = samples()
    now[4], now[5] = now[5], now[4]
    assert compared(now).differing["sequence"] == 2


def test_array_of_another_length_is_told_by_length() -> None:
    now = samples()
    now[2].position_mm = np.array([1.0, 2.0, 3.0])
    (difference,) = compared(now).differences
    assert (difference.recorded, difference.replayed, difference.element) == ("2 values", "3 values", -1)


def test_first_and_largest_are_told() -> None:
    now = samples()
    now[3].s_mm += 1e-3
    now[20].s_mm += 1.0
    now[25].s_mm += 0.1
    result = compared(now)
    assert [difference.index for difference in result.differences] == [3, 20]
    assert result.largest is not None and result.largest.index == 20


def test_infinity_and_nan_agree_with_themselves() -> None:
    was, now = samples(), samples()
    for sample in (was[0], now[0]):
        sample.s_mm = float("inf")
        sample.position_mm = np.array([np.nan, 1.0])
    assert compare_topic(TOPIC, columns_of(was), columns_of(now), Tolerances()).agrees


def test_field_that_was_not_recorded_is_named_and_not_compared() -> None:
    old = columns_of(samples())
    del old.values["method"]
    result = compare_topic(TOPIC, old, columns_of(samples()), Tolerances())
    assert result.agrees and result.unrecorded == ("method",)


def test_columns_of_arrays_agree_with_columns_of_messages() -> None:
    rows = samples()
    arrays = {
        "sequence": np.array([row.sequence for row in rows], np.uint64),
        "position_mm": np.array([row.position_mm for row in rows]),
    }
    recorded = columns_of_arrays(arrays, COUNT)
    assert compare_topic(TOPIC, recorded, columns_of(rows), Tolerances()).agrees


def test_columns_do_not_follow_a_message_that_is_used_again() -> None:
    columns, message = Columns(), Sample(1, 0, 0.0, array("d", [1.0]))
    columns.add(message)
    message.sequence, message.position_mm[0] = 2, 5.0
    columns.add(copy.copy(message))
    assert columns.values["sequence"] == [1, 2]
    assert [float(row[0]) for row in columns.values["position_mm"]] == [1.0, 5.0]
