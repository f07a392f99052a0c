"""State of this node on ``/status``, and the latest state of every other node."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.task import Future

from feedopt_core.errors import Failure
from feedopt_msgs.msg import Failure as FailureMessage
from feedopt_msgs.msg import NodeStatus
from feedopt_node.errors import SecondGraphError
from feedopt_node.failure_conversions import failure_to_message
from feedopt_node.graph import Graph
from feedopt_node.private_rclpy import PolledGroup, RCLError, call_if_due, take_all
from feedopt_node.qos import qos_profile

STATUS_TOPIC = "/status"
STATUS_PERIOD_S = 0.1
MATCH_PERIOD_S = 0.02
# Silence is counted in reports of this node, not in time: a pause of the whole computer then makes no node silent.
SILENCE_BEATS = 50

READY_STATES = (NodeStatus.READY, NodeStatus.RUNNING, NodeStatus.DONE, NodeStatus.FAULT)


class PeerStatuses:
    """The latest status of each node, by name; independent of ROS, so that its rules can be tested.

    If two instances of one name report, the older one counts until it is silent.
    """

    def __init__(self, own_name: str, own_instance: int) -> None:
        self.own_name = own_name
        self.own_instance = own_instance
        self._heard: dict[str, tuple[int, NodeStatus]] = {}
        self._beats = 0

    def beat(self) -> None:
        """Count one status period in which this node could receive statuses."""
        self._beats += 1

    def take(self, status: NodeStatus) -> bool:
        """Store a status; False if it is ignored: from this node, or from a newer instance beside a living older one.

        Raises:
            SecondGraphError: an older instance of this node is alive, so this node belongs to a second graph.
        """
        if status.node == self.own_name:
            if status.instance < self.own_instance:
                raise SecondGraphError(
                    f"another {self.own_name} already runs on this ROS domain: stop that graph, "
                    "or choose another domain with ROS_DOMAIN_ID"
                )
            return False
        held = self._heard.get(status.node)
        if held and status.instance > held[1].instance and self._beats - held[0] < SILENCE_BEATS:
            return False
        self._heard[status.node] = (self._beats, status)
        return True

    def get(self, name: str) -> NodeStatus | None:
        """Latest status of a node; None before the first."""
        held = self._heard.get(name)
        return held[1] if held else None

    def silent(self, names: Sequence[str]) -> str | None:
        """First of these nodes that has stopped reporting for ``SILENCE_BEATS`` periods; None if all are alive."""
        for name in names:
            held = self._heard.get(name)
            if held and self._beats - held[0] > SILENCE_BEATS:
                return name
        return None


class NodeLife:
    """Publishes the state of one node on every change and at 10 Hz, and receives the states of the other nodes.

    The node is READY as soon as every publisher has its subscriptions and every subscription has its publishers.
    :func:`feedopt_node.run.run_node` waits for ``ended``, which is set with the error that ends the process.
    Reports are allowed from any thread. A node that reads its subscriptions itself sets ``polled`` and calls
    :meth:`poll`; the executor then sleeps.
    """

    def __init__(self, node: Node, graph: Graph, present: Sequence[str], *, polled: bool = False) -> None:
        name = node.get_name()
        self._node = node
        self._present = tuple(present)
        self._required_subscriptions = graph.required_subscriptions(name, present)
        self._required_publishers = graph.required_publishers(name, present)
        self._publishers: dict[str, Publisher] = {}
        self._subscriptions: dict[str, Subscription] = {}
        self._listeners: list[Callable[[NodeStatus], None]] = []
        self._progress: Callable[[], dict[str, Any]] = dict
        self._lock = threading.Lock()
        self._status = NodeStatus(node=name, instance=time.time_ns(), state=NodeStatus.STARTING)
        self.peers = PeerStatuses(name, self._status.instance)
        self.ended = Future()
        qos = qos_profile(graph.topics[STATUS_TOPIC].qos)
        self._publisher = node.create_publisher(NodeStatus, STATUS_TOPIC, qos)
        self.watch_publisher(STATUS_TOPIC, self._publisher)
        group = PolledGroup() if polled else None
        self._statuses = node.create_subscription(NodeStatus, STATUS_TOPIC, self._take, qos, callback_group=group)
        self.watch_subscription(STATUS_TOPIC, self._statuses)
        self._report_timer = node.create_timer(STATUS_PERIOD_S, self._repeat, callback_group=group)
        self._match_timer = node.create_timer(MATCH_PERIOD_S, self._check_matches, callback_group=group)

    @property
    def state(self) -> int:
        """State of this node, one of the constants of NodeStatus."""
        return int(self._status.state)

    @property
    def program_id(self) -> int:
        """Program of the state; 0: no program yet."""
        return int(self._status.program_id)

    @property
    def present(self) -> tuple[str, ...]:
        """Names of the nodes that were started."""
        return self._present

    def watch_publisher(self, topic: str, publisher: Publisher) -> None:
        """Become READY only after this publisher has its subscriptions."""
        self._publishers[topic] = publisher

    def watch_subscription(self, topic: str, subscription: Subscription) -> None:
        """Become READY only after this subscription has its publishers."""
        self._subscriptions[topic] = subscription

    def on_peer(self, listener: Callable[[NodeStatus], None]) -> None:
        """Call ``listener`` with every status of another node."""
        self._listeners.append(listener)

    def progress_from(self, source: Callable[[], dict[str, Any]]) -> None:
        """Call ``source`` before every report for the fields that change continuously."""
        self._progress = source

    def report(self, **fields: Any) -> None:
        """Set fields of the status and publish it now; after the shutdown of ROS, nothing is published or raised."""
        fields = self._progress() | fields
        with self._lock:
            for name, value in fields.items():
                setattr(self._status, name, value)
            self._status.stamp = self._node.get_clock().now().to_msg()
            try:
                self._publisher.publish(self._status)
            except RCLError:
                # A signal can shut ROS down while a thread of the node is publishing here.
                if self._node.context.ok():
                    raise

    def begin_program(self, program_id: int) -> None:
        """Report RUNNING for a new program, with all counters at zero."""
        self.report(
            state=NodeStatus.RUNNING,
            program_id=program_id,
            last_input_sequence=0,
            last_output_sequence=0,
            s_mm=0.0,
            motion_time_s=0.0,
            missed_ticks=0,
            starved_chunk_sequence=0,
            text="",
            failure=FailureMessage(),
        )

    def fail(self, failure: Failure, **fields: Any) -> None:
        """Report FAULT with its cause now; other fields as in :meth:`report`."""
        self.report(state=NodeStatus.FAULT, text="", failure=failure_to_message(failure), **fields)

    def peers_ready(self) -> str | None:
        """Name of the first present node, including this one, that has not reported READY; None if all have."""
        for name in self._present:
            status = self._status if name == self.peers.own_name else self.peers.get(name)
            if status is None or status.state not in READY_STATES:
                return name
        return None

    def silent_peer(self) -> str | None:
        """Name of a present node that has become silent; None if all are alive."""
        return self.peers.silent(self._present)

    def poll(self) -> None:
        """Receive the statuses and call the timers that are due; for a node that is not spun for them."""
        for status, _ in take_all(self._statuses):
            self._take(status)
        for timer in (self._report_timer, self._match_timer):
            call_if_due(timer)

    def _repeat(self) -> None:
        self.peers.beat()
        self.report()

    def _take(self, status: NodeStatus) -> None:
        try:
            if not self.peers.take(status):
                return
        except SecondGraphError as error:
            if not self.ended.done():
                self.ended.set_exception(error)
            return
        for listener in self._listeners:
            listener(status)

    def _check_matches(self) -> None:
        publishers = (
            (self._publishers[topic].get_subscription_count(), need)
            for topic, need in self._required_subscriptions.items()
        )
        subscriptions = (
            (self._subscriptions[topic].get_publisher_count(), need)
            for topic, need in self._required_publishers.items()
        )
        # More publishers than nodes: a second graph is on this domain. Its nodes end when they receive our statuses;
        # this node waits until then.
        alone = self._subscriptions[STATUS_TOPIC].get_publisher_count() <= len(self._present)
        if alone and all(count >= need for count, need in (*publishers, *subscriptions)):
            self._match_timer.cancel()
            self.report(state=NodeStatus.READY)
