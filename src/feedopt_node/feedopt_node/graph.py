"""The graph of nodes and topics, read from ``config/graph.yaml``, for launch file, command and nodes. Free of ROS."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from feedopt_core.config_files import config_directory
from feedopt_core.errors import ConfigError

ParameterValue: TypeAlias = bool | int | float | str | tuple[str, ...]

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of every node: linear algebra in one thread, for equal results and for the other nodes' sake."""

_RELIABILITIES = ("reliable", "best_effort")
_DURABILITIES = ("volatile", "transient_local")


@dataclass(frozen=True)
class Qos:
    """Quality of service of a topic, by the names ``graph.yaml`` uses."""

    name: str
    reliability: str
    durability: str
    depth: int


@dataclass(frozen=True)
class Topic:
    """One topic: its message type such as ``feedopt_msgs/msg/AxisState``, who publishes and who subscribes."""

    name: str
    type: str
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]
    qos: Qos


@dataclass(frozen=True)
class Action:
    """One action and the node that serves it."""

    name: str
    type: str
    server: str


@dataclass(frozen=True)
class NodeEntry:
    """One node: the executable that starts it, its parameter file below ``config/``, whether it takes a machine."""

    name: str
    package: str
    executable: str
    parameters: str
    machine: bool


@dataclass(frozen=True)
class NodeProcess:
    """How one node of a chosen graph is started: what a launch file and a process starter need alike."""

    name: str
    package: str
    executable: str
    parameter_file: Path
    parameters: Mapping[str, ParameterValue]

    def ros_parameters(self) -> dict[str, Any]:
        """Parameters with lists where ROS wants lists."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in self.parameters.items()}

    def parameters_yaml(self) -> str:
        """What the node is started with, as one parameter file: its own file with the further parameters over it."""
        document = yaml.safe_load(self.parameter_file.read_text(encoding="utf-8")) or {}
        values: dict[str, Any] = {}
        for section in ("/**", self.name):
            values.update((document.get(section) or {}).get("ros__parameters") or {})
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
        """Subscriptions each publisher of a node waits for, counting only the nodes that are present."""
        names = self._checked(present)
        return {topic.name: sum(name in names for name in topic.subscribers) for topic in self.publications(node)}

    def required_publishers(self, node: str, present: Iterable[str]) -> dict[str, int]:
        """Publishers each subscription of a node waits for, counting only the nodes that are present."""
        names = self._checked(present)
        return {topic.name: sum(name in names for name in topic.publishers) for topic in self.subscriptions(node)}

    def chosen_nodes(self, *, record: bool = True, sim: bool = True) -> tuple[str, ...]:
        """Nodes of the graph, with or without the recorder and the simulated router."""
        left_out = {name for name, wanted in (("recorder", record), ("router_sim", sim)) if not wanted}
        return tuple(name for name in self.nodes if name not in left_out)

    def processes(
        self, present: Iterable[str], machine: str, extra: Mapping[str, Mapping[str, ParameterValue]] | None = None
    ) -> tuple[NodeProcess, ...]:
        """How each present node is started.

        Args:
            present: names of the nodes to start.
            machine: machine file (or its name) for the nodes that take one.
            extra: further parameters by node; they win over the parameter file.

        Raises:
            ConfigError: a name that is not a node of the graph.
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
    """A parameter value as one line of YAML, the way ROS reads it on a command line."""
    text = yaml.safe_dump(value, default_flow_style=True, width=float("inf"), allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...")


def load_graph(path: Path | None = None) -> Graph:
    """Read the graph; without a path, the installed ``graph.yaml``.

    Raises:
        ConfigError: not readable, or an entry that names an unknown node or quality of service.
    """
    path = path or config_directory() / "graph.yaml"
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    try:
        return _parse(document, str(path))
    except (KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"{path}: an entry is missing or not a mapping: {error!r}") from error


def _parse(document: Any, source: str) -> Graph:
    nodes = {
        name: NodeEntry(name, entry["package"], entry["executable"], entry["parameters"], entry.get("machine", False))
        for name, entry in document["nodes"].items()
    }
    qualities = {name: _qos(name, entry, source) for name, entry in document["qos"].items()}
    topics = {}
    for name, entry in document["topics"].items():
        if entry["qos"] not in qualities:
            raise ConfigError(f"{source}: topic {name} names the unknown qos {entry['qos']}")
        topics[name] = Topic(name, entry["type"], tuple(entry["from"]), tuple(entry["to"]), qualities[entry["qos"]])
        for node in (*topics[name].publishers, *topics[name].subscribers):
            if node not in nodes:
                raise ConfigError(f"{source}: topic {name} names the unknown node {node}")
    actions = {name: Action(name, entry["type"], entry["server"]) for name, entry in document["actions"].items()}
    for action in actions.values():
        if action.server not in nodes:
            raise ConfigError(f"{source}: action {action.name} names the unknown node {action.server}")
    return Graph(topics, actions, nodes)


def _qos(name: str, entry: Mapping[str, Any], source: str) -> Qos:
    qos = Qos(name, entry["reliability"], entry["durability"], entry["depth"])
    if qos.reliability not in _RELIABILITIES or qos.durability not in _DURABILITIES:
        raise ConfigError(
            f"{source}: qos {name}: reliability must be one of {', '.join(_RELIABILITIES)}, "
            f"durability one of {', '.join(_DURABILITIES)}"
        )
    if not isinstance(qos.depth, int) or qos.depth < 1:
        raise ConfigError(f"{source}: qos {name}: depth is {qos.depth!r}, must be a whole number from 1")
    return qos
