"""Reads a recorded run of feedopt."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from feedopt_core.machine.machine_file import DEFAULT_PERIOD_S
from feedopt_node.conversions import chunk_from_message, machine_from_message, segment_from_message
from feedopt_recorder.bags.conversions import (
    setpoints_from_topic,
    states_from_topic,
    status_from_message,
)
from feedopt_recorder.bags.definitions import migrated, migration
from feedopt_recorder.bags.messages import BagContents, read_messages
from feedopt_recorder.bags.run_data import RunData, SampleArrays, SetpointArrays, StateArrays
from feedopt_recorder.errors import BagEmptyError, BagForeignError

SETPOINTS, STATES = "/axis_setpoint", "/axis_state"
_TYPES = {
    "/machine": "feedopt_msgs/msg/Machine",
    "/toolpath": "feedopt_msgs/msg/ToolpathSegment",
    "/feed_profile": "feedopt_msgs/msg/FeedProfileChunk",
    SETPOINTS: "feedopt_msgs/msg/AxisSetpoint",
    STATES: "feedopt_msgs/msg/AxisState",
    "/status": "feedopt_msgs/msg/NodeStatus",
}

T = TypeVar("T", bound=SampleArrays)


def read_bag(path: Path, program_id: int | None = None, *, allow_truncated: bool = False) -> RunData:
    """Read one program of a bag.

    Args:
        path: the bag's folder, or its MCAP file.
        program_id: which program; None: the last one.
        allow_truncated: take what is there of a file that was cut off.

    Raises:
        BagMissingError, BagEmptyError, BagForeignError, BagTruncatedError: see :mod:`feedopt_recorder.errors`.
        BagDefinitionError: its messages are not those of this version.
        ToolpathError, SolverError: a segment or a chunk that is none.
    """
    contents = read_messages(path, tuple(_TYPES), allow_truncated=allow_truncated)
    _check_types(contents)
    machines = _objects(contents, "/machine")
    machine = machine_from_message(machines[-1]) if machines else None
    period_s = DEFAULT_PERIOD_S if machine is None else machine.period_s
    setpoints = _samples(contents, SETPOINTS, period_s, setpoints_from_topic, _no_setpoints)
    states = _samples(contents, STATES, period_s, states_from_topic, _no_states)
    segments, chunks = _objects(contents, "/toolpath"), _objects(contents, "/feed_profile")
    program_ids = sorted(
        {*np.unique(setpoints.program_id).tolist(), *(int(message.program_id) for message in (*segments, *chunks))}
    )
    if not program_ids:
        raise BagEmptyError(f"{path}: no program was run while this bag was recorded")
    chosen = program_ids[-1] if program_id is None else program_id
    if chosen not in program_ids:
        raise BagEmptyError(f"{path}: holds no program {chosen}; it holds {', '.join(map(str, program_ids))}")
    return RunData(
        path=path,
        program_id=chosen,
        program_ids=tuple(program_ids),
        machine=machine,
        setpoints=setpoints.of_program(chosen),
        states=states.of_program(chosen),
        chunks=tuple(chunk_from_message(message) for message in chunks if message.program_id == chosen),
        segments=tuple(segment_from_message(message) for message in segments if message.program_id == chosen),
        statuses=_statuses(contents),
        provenance=contents.metadata,
        complete=contents.complete,
    )


def _check_types(contents: BagContents) -> None:
    if not contents.topics:
        raise BagForeignError(f"{contents.path}: none of the topics of feedopt: {', '.join(_TYPES)}")
    for topic in contents.topics.values():
        if topic.type_name != _TYPES[topic.name]:
            raise BagForeignError(f"{contents.path}: {topic.name} is {topic.type_name}, not {_TYPES[topic.name]}")


def _samples(contents: BagContents, name: str, period_s: float, convert: Any, none: Any) -> Any:
    topic = contents.topics.get(name)
    if topic is None or not len(topic):
        return none(period_s)
    migration(topic.definitions, topic.type_name)
    return convert(topic, period_s)


def _objects(contents: BagContents, name: str) -> list[Any]:
    topic = contents.topics.get(name)
    return [] if topic is None else list(migrated(topic.definitions, topic.type_name, topic.objects()))


def _statuses(contents: BagContents) -> tuple[Any, ...]:
    topic = contents.topics.get("/status")
    if topic is None:
        return ()
    times = topic.log_ns.tolist()
    messages = migrated(topic.definitions, topic.type_name, topic.objects())
    return tuple(status_from_message(message, time_ns) for message, time_ns in zip(messages, times, strict=True))


def _no_rows(period_s: float) -> dict[str, Any]:
    whole = np.empty(0, dtype=np.int64)
    names = ("stamp_ns", "received_ns", "program_id", "sequence", "tick")
    return {**dict.fromkeys(names, whole), "last": np.empty(0, dtype=bool), "period_s": period_s}


def _no_setpoints(period_s: float) -> SetpointArrays:
    scalar, rows = np.empty(0), np.empty((0, 0))
    return SetpointArrays(
        **_no_rows(period_s),
        chunk_sequence=np.empty(0, dtype=np.int64),
        s_mm=scalar,
        feedrate_mm_s=scalar,
        position_mm=rows,
        velocity_mm_s=rows,
        acceleration_mm_s2=rows,
        lateness_s=scalar,
    )


def _no_states(period_s: float) -> StateArrays:
    rows = np.empty((0, 0))
    return StateArrays(
        **_no_rows(period_s),
        setpoint_sequence=np.empty(0, dtype=np.int64),
        reference_mm=rows,
        position_mm=rows,
        velocity_mm_s=rows,
        tracking_error_mm=rows,
        control_signal_volts=rows,
        saturated=np.empty((0, 0), dtype=bool),
    )
