"""The one place of this package where recorded messages become domain types. Round-trip tested against the writer."""

from __future__ import annotations

from typing import Any

from feedopt_core.units import NS_PER_S
from feedopt_node.failure_conversions import failure_of_status
from feedopt_recorder.bags.messages import TopicMessages
from feedopt_recorder.bags.run_data import SetpointArrays, StateArrays, StatusRow


def setpoints_from_topic(topic: TopicMessages, period_s: float) -> SetpointArrays:
    """Set points of ``/axis_setpoint``. Raises BagForeignError where the messages do not share one layout."""
    columns = topic.columns()
    stamp_ns = columns.pop("stamp.sec").astype("i8") * NS_PER_S + columns.pop("stamp.nanosec")
    return SetpointArrays(stamp_ns=stamp_ns, received_ns=topic.log_ns, period_s=period_s, **columns)


def states_from_topic(topic: TopicMessages, period_s: float) -> StateArrays:
    """States of ``/axis_state``. Raises BagForeignError where the messages do not share one layout."""
    columns = topic.columns()
    stamp_ns = columns.pop("stamp.sec").astype("i8") * NS_PER_S + columns.pop("stamp.nanosec")
    return StateArrays(stamp_ns=stamp_ns, received_ns=topic.log_ns, period_s=period_s, **columns)


def status_from_message(message: Any, received_ns: int) -> StatusRow:
    """Row of ``/status``."""
    return StatusRow(
        received_ns=received_ns,
        node=str(message.node),
        state=int(message.state),
        program_id=int(message.program_id),
        last_input_sequence=int(message.last_input_sequence),
        last_output_sequence=int(message.last_output_sequence),
        s_mm=float(message.s_mm),
        motion_time_s=float(message.motion_time_s),
        missed_ticks=int(message.missed_ticks),
        starved_chunk_sequence=int(message.starved_chunk_sequence),
        text=str(message.text),
        failure=failure_of_status(message),
    )
