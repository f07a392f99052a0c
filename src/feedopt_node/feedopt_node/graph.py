"""The graph of nodes and topics from ``config/graph.yaml``, for launch file, command and nodes. Free of ROS."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from feedopt_core.config_files import config_directory, parse_yaml, read_text, ros_parameters
from feedopt_core.errors import ConfigError
from feedopt_core.schema import build, parameter

ParameterValue: TypeAlias = bool | int | float | str | tuple[str, ...]

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of every node: linear algebra in one thread, for reproducible results and free cores."""


@dataclass(frozen=True)
class Qos:
    """Quality of service of a topic, with the names of ``graph.yaml``."""

    name: str = parameter("Name of the quality of service.", entry_name=True)
    reliability: str = parameter("Whether lost messages are sent again.", choices=("reliable", "best_effort"))
    durability: str = parameter(
        "Whether a node that starts later receives earlier messages.", choices=("volatile", "transient_local")
    )
    depth: int = parameter("Messages kept for a slow subscriber.", at_least=1)


@dataclass(frozen=True)
class Topic:
    """One topic: its message type such as ``feedopt_msgs/msg/AxisState``, its publishers and its subscribers."""

    name: str
    type: str
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]
    qos: Qos


@dataclass(frozen=True)
class Action:
    """One action and the node that serves it."""

    name: str = parameter("Name of the action.", entry_name=True)
    type: str = parameter("Action type, such as feedopt_msgs/action/ExecuteProgram.")
    server: str = parameter("Node that serves it.")


@dataclass(frozen=True)
class NodeEntry:
    """One node: its executable, its parameter file below ``config/``, and whether it needs a machine file."""

    name: str = parameter("Name of the node.", entry_name=True)
    package: str = parameter("Package with its executable.")
    executable: str = parameter("Executable of the node.")
    parameters: str = parameter("Parameter file below config/.")
    machine: bool = parameter("Whether it needs a machine file.", default=False)


@dataclass(frozen=True)
class NodeProcess:
    """Start of one node of a chosen graph, for the launch file and for the command."""

    name: str
    package: str
    executable: str
    parameter_file: Path
    parameters: Mapping[str, ParameterValue]

    def ros_parameters(self) -> dict[str, Any]:
        """Parameters with tuples as lists, as ROS expects them."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in self.parameters.items()}

    def parameters_yaml(self) -> str:
        """All parameters of the node as one parameter file: those of its own file, overridden by ``parameters``.

        Raises:
            ConfigError: the parameter file cannot be read.
        """
        source = str(self.parameter_file)
        values = ros_parameters(parse_yaml(read_text(self.parameter_file), source), self.name, source)
        values.update(self.ros_parameters())
        return yaml.safe_dump({self.name: {"ros__parameters": values}}, sort_keys=False)

    def ros_arguments(self) -> list[str]:
        """Arguments of the executable: name, parameter file and parameters."""
        arguments = ["--ros-args", "-r", f"__node:={self.name}", "--params-file", str(self.parameter_file)]
        for key, value in self.ros_parameters().items():
            arguments += ["-p", f"{key}:={yaml_flow(value)}"]
        return arguments


@dataclass(frozen=True)
class Graph:
    """Nodes, topics and actions by name, in the order of the file."""

    topics: Mapping[str, Topic]
    actions: Mapping[str, Action]
    nodes: Mapping[str, NodeEntry]

    def publications(self, node: str) -> tuple[Topic, ...]:
        """Topics a node publishes."""
        return tuple(topic for topic in self.topics.values() if node in topic.publishers)

    def subscriptions(self, node: str) -> tuple[Topic, ...]:
        """Topics a node subscribes to."""
        return tuple(topic for topic in self.topics.values() if node in topic.subscribers)

    def required_subscriptions(self, node: str, present: Iterable[str]) -> dict[str, int]:
        """Number of subscriptions that each publisher of a node waits for; counts only the present nodes."""
        names = self._checked(present)
        return {topic.name: sum(name in names for name in topic.subscribers) for topic in self.publications(node)}

    def required_publishers(self, node: str, present: Iterable[str]) -> dict[str, int]:
        """Number of publishers that each subscription of a node waits for; counts only the present nodes."""
        names = self._checked(present)
        return {topic.name: sum(name in names for name in topic.publishers) for topic in self.subscriptions(node)}

    def chosen_nodes(self, *, record: bool = True, sim: bool = True) -> tuple[str, ...]:
        """Nodes of the graph, with or without the recorder and the simulated router."""
        left_out = {name for name, wanted in (("recorder", record), ("router_sim", sim)) if not wanted}
        return tuple(name for name in self.nodes if name not in left_out)

    def processes(
        self, present: Iterable[str], machine: str, extra: Mapping[str, Mapping[str, ParameterValue]] | None = None
    ) -> tuple[NodeProcess, ...]:
        """Start of each present node.

        Args:
            present: names of the nodes to start.
            machine: machine file (or its name) for the nodes that need one.
            extra: further parameters by node; they override the parameter file.

        Raises:
            ConfigError: a name is not a node of the graph.
        """
        names = self._checked(present)
        extra = extra or {}
        self._checked(extra)
        processes = []
        for name in names:
            entry = self.nodes[name]
            parameters: dict[str, ParameterValue] = {"present_nodes": names}
            if entry.machine:
                parameters["machine"] = machine
            parameters.update(extra.get(name, {}))
            file = config_directory() / entry.parameters
            processes.append(NodeProcess(name, entry.package, entry.executable, file, parameters))
        return tuple(processes)

    def _checked(self, names: Iterable[str]) -> tuple[str, ...]:
        checked = tuple(names)
        for name in checked:
            if name not in self.nodes:
                raise ConfigError(f"{name} is not a node of the graph; known are {', '.join(self.nodes)}")
        return checked


def yaml_flow(value: Any) -> str:
    """A parameter value as one line of YAML, as ROS reads it on a command line."""
    text = yaml.safe_dump(value, default_flow_style=True, width=float("inf"), allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...")


def load_graph(path: Path | None = None) -> Graph:
    """Read a graph file; without a path, the installed ``graph.yaml``.

    Raises:
        ConfigError: the file cannot be read, a key is unknown, missing or invalid, or an entry names an unknown node or
            quality of service.
    """
    path = path or config_directory() / "graph.yaml"
    source = str(path)
    file = build(_GraphFile, parse_yaml(read_text(path), source), source)
    topics = {
        name: Topic(name, entry.type, entry.publishers, entry.subscribers, file.qos[entry.qos])
        for name, entry in file.topics.items()
    }
    return Graph(topics, file.actions, file.nodes)


@dataclass(frozen=True)
class _TopicEntry:
    """A topic of the file, with the name of its quality of service."""

    type: str = parameter("Message type, such as feedopt_msgs/msg/AxisState.")
    publishers: tuple[str, ...] = parameter("Nodes that publish it.", key="from")
    subscribers: tuple[str, ...] = parameter("Nodes that subscribe to it.", key="to")
    qos: str = parameter("Name of its quality of service.")


@dataclass(frozen=True)
class _GraphFile:
    """Content of ``graph.yaml``."""

    qos: Mapping[str, Qos] = parameter("Qualities of service by name.")
    topics: Mapping[str, _TopicEntry] = parameter("Topics by name.")
    actions: Mapping[str, Action] = parameter("Actions by name.")
    nodes: Mapping[str, NodeEntry] = parameter("Nodes by name.")

    def __post_init__(self) -> None:
        for name, topic in self.topics.items():
            if topic.qos not in self.qos:
                raise ConfigError(f"topic {name} names the unknown qos {topic.qos}; known are {', '.join(self.qos)}")
            for node in (*topic.publishers, *topic.subscribers):
                self._refuse_unknown_node(f"topic {name}", node)
        for action in self.actions.values():
            self._refuse_unknown_node(f"action {action.name}", action.server)

    def _refuse_unknown_node(self, place: str, node: str) -> None:
        if node not in self.nodes:
            raise ConfigError(f"{place} names the unknown node {node}; known are {', '.join(self.nodes)}")
