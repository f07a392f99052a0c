"""Base class of every node of the graph: parameters, and publishers and subscriptions as defined in ``graph.yaml``."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Generic, TypeVar

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from feedopt_core.errors import ConfigError
from feedopt_node.graph import Topic, load_graph
from feedopt_node.parameters import GraphParameters, declare_parameters
from feedopt_node.qos import qos_profile
from feedopt_node.status import NodeLife

P = TypeVar("P", bound=GraphParameters)


def interface_class(type_name: str) -> Any:
    """Python class of a message or action type such as ``feedopt_msgs/msg/AxisState``.

    Raises:
        ConfigError: its package is not built or not sourced.
    """
    package, folder, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{folder}"), name)
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"type {type_name} cannot be loaded ({error}): build the workspace and source its setup"
        ) from error


class GraphNode(Node, Generic[P]):
    """A node with the topics of ``graph.yaml`` and one frozen dataclass of parameters.

    Args:
        name: name of the node in the graph.
        parameters: its parameter dataclass.
        polled: the node itself calls ``life.poll``, many times a second.

    Raises:
        ConfigError: a parameter is invalid, or the graph has no node of that name.
    """

    def __init__(self, name: str, parameters: type[P], *, polled: bool = False) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self.parameters: P = declare_parameters(self, parameters)
        self.graph = load_graph()
        if self.get_name() not in self.graph.nodes:
            raise ConfigError(f"{self.get_name()} is not a node of the graph; known are {', '.join(self.graph.nodes)}")
        present = self.parameters.present_nodes or tuple(self.graph.nodes)
        self.life = NodeLife(self, self.graph, present, polled=polled)

    def publish_topic(self, topic: str) -> Publisher:
        """Publisher with the type and quality of service of the graph; readiness waits for its subscriptions."""
        entry = self._topic(topic, self.graph.publications(self.get_name()))
        publisher = self.create_publisher(interface_class(entry.type), topic, qos_profile(entry.qos))
        self.life.watch_publisher(topic, publisher)
        return publisher

    def subscribe_topic(
        self,
        topic: str,
        callback: Callable[[Any], None],
        *,
        raw: bool = False,
        group: CallbackGroup | None = None,
        depth: int = 0,
    ) -> Subscription:
        """Subscription to a topic of the graph; readiness waits for its publishers.

        ``raw`` gives the CDR bytes. ``depth`` keeps more messages than the graph defines, if they are taken late.
        """
        entry = self._topic(topic, self.graph.subscriptions(self.get_name()))
        profile = qos_profile(replace(entry.qos, depth=max(depth, entry.qos.depth)))
        subscription = self.create_subscription(
            interface_class(entry.type), topic, callback, profile, raw=raw, callback_group=group
        )
        self.life.watch_subscription(topic, subscription)
        return subscription

    def close(self) -> None:
        """Called once when the process ends; a node with own threads ends them here."""

    def _topic(self, name: str, topics: tuple[Topic, ...]) -> Topic:
        for topic in topics:
            if topic.name == name:
                return topic
        raise ConfigError(f"graph.yaml does not list the topic {name} for node {self.get_name()}")
