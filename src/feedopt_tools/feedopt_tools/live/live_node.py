"""A node that draws a running graph. It only listens: no other node waits for it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import rerun as rr
from rclpy.node import Node
from rclpy.subscription import Subscription
from rosbags.typesys import get_types_from_msg

from feedopt_node.conversions import chunk_from_message, machine_from_message
from feedopt_node.graph import load_graph
from feedopt_node.graph_node import interface_class
from feedopt_node.private_rclpy import PolledGroup, take_all
from feedopt_node.qos import qos_profile
from feedopt_recorder.bags.conversions import setpoints_from_topic, states_from_topic, status_from_message
from feedopt_recorder.bags.messages import TopicMessages
from feedopt_recorder.message_schemas import MessageSchemas, ament_share_directories
from feedopt_tools.live.live_drawing import LiveDrawing

NODE_NAME = "live_view"
_SETPOINTS, _STATES = "/axis_setpoint", "/axis_state"
_PATH_EVERY_S = 1.0

T = TypeVar("T")


class LiveNode(Node):
    """Subscribes to the drawn topics. :meth:`draw` empties the subscriptions; call it many times a second."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        super().__init__(NODE_NAME)
        self._recording = recording
        self._drawing: LiveDrawing | None = None
        self._group = PolledGroup()
        self._schemas = MessageSchemas(ament_share_directories())
        self._graph = load_graph()
        self._raw = {name: self._subscription(name, raw=True) for name in (_SETPOINTS, _STATES)}
        self._machine = self._subscription("/machine")
        self._chunks = self._subscription("/feed_profile")
        self._statuses = self._subscription("/status")
        self._definitions = {name: self._definition(name) for name in self._raw}
        self._path_due_s = 0.0
        self.drawn_setpoints = 0

    def draw(self) -> None:
        """Draw all messages since the last call."""
        for message, _ in take_all(self._machine):
            self._begin(LiveDrawing(self._recording, machine_from_message(message)))
        batches = {
            name: [payload for payload, _ in take_all(subscription, raw=True)]
            for name, subscription in self._raw.items()
        }
        drawing = self._drawing
        if drawing is None:
            # The axes are unknown until /machine arrives. It is latched.
            return
        if batches[_SETPOINTS]:
            topic = self._topic(_SETPOINTS, batches[_SETPOINTS])
            setpoints = setpoints_from_topic(topic, drawing.machine.period_s)
            drawing.add_setpoints(setpoints)
            self.drawn_setpoints += len(setpoints)
        if batches[_STATES]:
            topic = self._topic(_STATES, batches[_STATES])
            drawing.add_states(states_from_topic(topic, drawing.machine.period_s))
        for message, _ in take_all(self._chunks):
            drawing.add_chunk(chunk_from_message(message))
        for message, _ in take_all(self._statuses):
            drawing.add_status(status_from_message(message, self.get_clock().now().nanoseconds))
        if time.monotonic() >= self._path_due_s:
            self._path_due_s = time.monotonic() + _PATH_EVERY_S
            drawing.draw_path()

    def finish(self) -> None:
        """Draw the rest, and the whole path."""
        self.draw()
        if self._drawing is not None:
            self._drawing.draw_path()
        self._recording.flush()

    def _begin(self, drawing: LiveDrawing) -> None:
        if self._drawing is None or self._drawing.machine != drawing.machine:
            self._drawing = drawing
            self._recording.send_blueprint(drawing.layout())

    def _subscription(self, name: str, *, raw: bool = False) -> Subscription:
        topic = self._graph.topics[name]
        return self.create_subscription(
            interface_class(topic.type),
            name,
            lambda _: None,
            qos_profile(topic.qos),
            raw=raw,
            callback_group=self._group,
        )

    def _definition(self, name: str) -> dict[str, Any]:
        type_name = self._graph.topics[name].type
        return dict(get_types_from_msg(self._schemas.schema(type_name), type_name))

    def _topic(self, name: str, payloads: Sequence[bytes]) -> TopicMessages:
        """Payloads of one layout, in the form that the bag reader expects."""
        now_ns = np.full(len(payloads), self.get_clock().now().nanoseconds, dtype=np.int64)
        block = np.frombuffer(b"".join(payloads), dtype=np.uint8).reshape(len(payloads), -1)
        return TopicMessages(name, self._graph.topics[name].type, self._definitions[name], now_ns, now_ns, [block])
