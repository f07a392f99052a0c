"""Checks that a recorded run is whole: evidence with gaps is none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from feedopt_core.arrays import IntArray
from feedopt_recorder.bags.read_bag import SETPOINTS, STATES, read_bag
from feedopt_recorder.bags.run_data import RunData, SampleArrays

_LISTED = 5


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a bag.

    Attributes:
        kind: ``cut_off``, ``gap``, ``repeated``, ``first_missing``, ``end_missing``, ``tick``, ``no_state``,
            ``no_setpoint``, ``chunk`` or ``fault``.
        place: topic or node, with the program.
        text: what exactly.
    """

    kind: str
    place: str
    text: str


def check_bag(path: Path) -> tuple[Finding, ...]:
    """Everything that is missing in a bag; empty when it is whole.

    Raises:
        BagMissingError, BagEmptyError, BagForeignError: there is nothing to check.
    """
    run = read_bag(path, allow_truncated=True)
    findings = []
    if not run.complete:
        findings.append(Finding("cut_off", str(path), "the file ends without its footer: the recorder was killed"))
    for program_id in run.program_ids:
        program = run if program_id == run.program_id else read_bag(path, program_id, allow_truncated=True)
        findings += check_run(program)
    return tuple(findings)


def check_run(run: RunData) -> tuple[Finding, ...]:
    """Everything that is missing in one program."""
    return tuple(_findings(run))


def _findings(run: RunData) -> Iterator[Finding]:
    where = f"program {run.program_id}"
    streams = {
        "/toolpath": np.array([segment.place.sequence for segment in run.segments], dtype=np.int64),
        "/feed_profile": np.array([chunk.sequence for chunk in run.chunks], dtype=np.int64),
        SETPOINTS: run.setpoints.sequence,
        STATES: run.states.sequence,
    }
    for topic, sequence in streams.items():
        yield from _sequence(f"{topic} {where}", sequence)
    ends = {
        "/toolpath": bool(run.segments) and run.segments[-1].place.last,
        "/feed_profile": bool(run.chunks) and run.chunks[-1].last,
        SETPOINTS: bool(run.setpoints.last.any()),
        STATES: bool(run.states.last.any()),
    }
    for topic, ended in ends.items():
        if len(streams[topic]) and not ended:
            yield Finding("end_missing", f"{topic} {where}", "the message marked last is missing")
    yield from _ticks(f"{SETPOINTS} {where}", run.setpoints)
    if len(run.states):
        yield from _answers(where, run)
    used = np.unique(run.setpoints.chunk_sequence)
    for number in np.setdiff1d(used[used > 0], streams["/feed_profile"]):
        yield Finding("chunk", f"/feed_profile {where}", f"set points were taken from chunk {number}, which is missing")
    for status in run.statuses:
        if status.program_id == run.program_id and status.failure is not None:
            yield Finding("fault", f"{status.node} {where}", status.said)
            return


def _sequence(place: str, sequence: IntArray) -> Iterator[Finding]:
    if not len(sequence):
        return
    if sequence[0] != 1:
        yield Finding("first_missing", place, f"begins with sequence {sequence[0]}, not 1")
    steps = np.diff(sequence)
    gaps, repeats = np.flatnonzero(steps > 1), np.flatnonzero(steps < 1)
    if len(gaps):
        lost = int(np.sum(steps[gaps] - 1))
        listed = ", ".join(_span(int(sequence[i]) + 1, int(sequence[i + 1]) - 1) for i in gaps[:_LISTED])
        yield Finding("gap", place, f"{lost} messages are missing: {listed}{', ...' if len(gaps) > _LISTED else ''}")
    if len(repeats):
        yield Finding("repeated", place, f"{len(repeats)} messages out of order, first {sequence[repeats[0] + 1]}")


def _ticks(place: str, samples: SampleArrays) -> Iterator[Finding]:
    steps = np.diff(samples.tick)
    wrong = np.flatnonzero(steps != np.diff(samples.sequence))
    if len(wrong):
        i = int(wrong[0])
        yield Finding(
            "tick", place, f"tick {samples.tick[i]} is followed by {samples.tick[i + 1]}, {len(wrong)} times so"
        )
    if len(samples) and samples.tick[0] > 0:
        yield Finding("tick", place, f"begins with tick {samples.tick[0]}, after the start of motion")


def _answers(where: str, run: RunData) -> Iterator[Finding]:
    unanswered = np.setdiff1d(run.setpoints.sequence, run.states.setpoint_sequence)
    if len(unanswered):
        text = f"{len(unanswered)} set points have no state, first {unanswered[0]}"
        yield Finding("no_state", f"{STATES} {where}", text)
    unasked = np.setdiff1d(run.states.setpoint_sequence, run.setpoints.sequence)
    if len(unasked):
        text = f"{len(unasked)} states answer set points that are missing, first {unasked[0]}"
        yield Finding("no_setpoint", f"{SETPOINTS} {where}", text)


def _span(first: int, last: int) -> str:
    return str(first) if first == last else f"{first} to {last}"
