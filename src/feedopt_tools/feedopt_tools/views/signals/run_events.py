"""Events of a run in order of time: program words, stops and dwells, states of the nodes, faults."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.units import NS_PER_S
from feedopt_recorder.bags.check_bag import check_run
from feedopt_tools.views.signals.signals import RunSignals

_MANY = 500
_APART_TICKS = 200


@dataclass(frozen=True)
class RunEvent:
    """One event.

    Attributes:
        t_s, s_mm: motion time and arc length.
        source: node, ``program`` or ``recording``.
        level: ``INFO``, ``WARN`` or ``ERROR``.
        text: description.
    """

    t_s: float
    s_mm: float
    source: str
    level: str
    text: str


@dataclass(frozen=True)
class NodeState:
    """State of a node from a motion time on."""

    node: str
    t_s: float
    state: str


def events_of(signals: RunSignals) -> tuple[RunEvent, ...]:
    """Events of a run in order of time. Gaps of the recording come first."""
    found = [*_program_events(signals), *_chunk_events(signals), *_status_events(signals), *_late_ticks(signals)]
    missing = [
        RunEvent(float(signals.t_s[0]), 0.0, "recording", "WARN", f"{finding.place}: {finding.text}")
        for finding in check_run(signals.run)
    ]
    return (*missing, *sorted(found, key=lambda event: event.t_s))


def node_states(signals: RunSignals) -> tuple[NodeState, ...]:
    """Changes of state of every node, in order of time."""
    states, last = list[NodeState](), dict[str, int]()
    for status in signals.run.statuses:
        if last.get(status.node) != status.state:
            last[status.node] = status.state
            states.append(NodeState(status.node, motion_time_of(signals, status.received_ns), status.state_name))
    return tuple(states)


def motion_time_of(signals: RunSignals, received_ns: int) -> float:
    """Motion time at a wall-clock time, limited to the recorded motion."""
    setpoints = signals.run.setpoints
    zero_ns = int(setpoints.stamp_ns[0]) - round(float(setpoints.tick[0]) * setpoints.period_s * NS_PER_S)
    t_s = (received_ns - zero_ns) / NS_PER_S
    return float(np.clip(t_s, signals.t_s[0], signals.t_s[-1]))


def program_lines(signals: RunSignals) -> FloatArray | None:
    """Line of the program at every set point, shape (n,); None without segments."""
    segments = signals.run.segments
    if not segments:
        return None
    starts = np.array([segment.place.s_start_mm for segment in segments])
    lines = np.array([float(segment.place.source_line) for segment in segments])
    owner = np.clip(np.searchsorted(starts, signals.s_mm, side="right") - 1, 0, len(lines) - 1)
    return np.asarray(lines[owner])


def _program_events(signals: RunSignals) -> Iterator[RunEvent]:
    for segment in signals.run.segments:
        place = segment.place
        start_s = _time_at(signals, place.s_start_mm)
        for text in place.events:
            yield RunEvent(start_s, place.s_start_mm, "program", "INFO", f"line {place.source_line}: {text}")
        if place.exact_stop and not place.last:
            end_mm = place.s_start_mm + segment.length_mm
            dwell = f", dwell {place.dwell_s:g} s" if place.dwell_s > 0.0 else ""
            text = f"line {place.source_line}: stop{dwell}"
            yield RunEvent(_time_at(signals, end_mm), end_mm, "program", "INFO", text)


def _chunk_events(signals: RunSignals) -> Iterator[RunEvent]:
    for chunk in signals.run.chunks:
        if chunk.figures.fallback:
            text = f"chunk {chunk.sequence}: the window had no plan, the chunk ends in a stop"
            yield RunEvent(chunk.t_start_s, chunk.s_start_mm, "planner", "WARN", text)


def _status_events(signals: RunSignals) -> Iterator[RunEvent]:
    last = dict[str, tuple[int, str, int]]()
    for status in signals.run.statuses:
        now = (status.state, status.said, status.starved_chunk_sequence)
        if last.get(status.node) == now:
            continue
        last[status.node] = now
        t_s = motion_time_of(signals, status.received_ns)
        s_mm = float(np.interp(t_s, signals.t_s, signals.s_mm))
        text = ": ".join(filter(None, (status.state_name, status.said)))
        level = "INFO" if status.failure is None else "ERROR"
        if status.starved_chunk_sequence:
            level, text = (
                "WARN",
                f"{text}: stopped after chunk {status.starved_chunk_sequence} because no further chunk came",
            )
        yield RunEvent(t_s, s_mm, status.node, level, text)


def _late_ticks(signals: RunSignals) -> Iterator[RunEvent]:
    """Stretches of set points that were late by a period or more. Stretches close together are merged."""
    late = np.flatnonzero(signals.lateness_ms >= 1e3 * signals.run.setpoints.period_s)
    if not len(late):
        return
    for stretch in np.split(late, np.flatnonzero(np.diff(late) > _APART_TICKS) + 1)[:_MANY]:
        worst_ms = float(np.max(signals.lateness_ms[stretch]))
        text = f"{len(stretch)} set points late by up to {worst_ms:.2f} ms"
        yield RunEvent(float(signals.t_s[stretch[0]]), float(signals.s_mm[stretch[0]]), "interpolator", "WARN", text)


def _time_at(signals: RunSignals, s_mm: float) -> float:
    """Motion time at which an arc length is reached."""
    row = min(int(np.searchsorted(signals.s_mm, s_mm)), len(signals.t_s) - 1)
    return float(signals.t_s[row])
