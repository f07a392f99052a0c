"""The graph file: what it says, and what it refuses."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
import yaml

from feedopt_core.errors import ConfigError
from feedopt_node.graph import Graph, load_graph, yaml_flow

NODES = ("toolpath", "planner", "interpolator", "router_sim", "recorder")


@pytest.fixture
def graph() -> Graph:
    return load_graph()


def test_publishers_wait_for_the_nodes_that_are_there(graph: Graph) -> None:
    assert graph.required_subscriptions("interpolator", NODES)["/axis_setpoint"] == 2
    assert graph.required_subscriptions("interpolator", graph.chosen_nodes(sim=False))["/axis_setpoint"] == 1
    alone = graph.chosen_nodes(record=False, sim=False)
    assert graph.required_subscriptions("interpolator", alone)["/axis_setpoint"] == 0
    assert graph.required_subscriptions("toolpath", NODES)["/toolpath"] == 3


def test_subscriptions_wait_for_the_nodes_that_are_there(graph: Graph) -> None:
    assert graph.required_publishers("recorder", NODES)["/axis_state"] == 1
    assert graph.required_publishers("recorder", graph.chosen_nodes(sim=False))["/axis_state"] == 0
    assert graph.required_publishers("planner", NODES) == {"/toolpath": 1, "/status": 5}


def test_every_topic_is_published_and_recorded(graph: Graph) -> None:
    for topic in graph.topics.values():
        # Lines of a streamed program come from outside of the graph.
        assert topic.publishers or topic.name == "/program_lines"
        assert "recorder" in topic.subscribers


def test_processes_carry_machine_and_parameters(graph: Graph) -> None:
    processes = {node.name: node for node in graph.processes(NODES, "m.yaml", {"planner": {"method": "lp"}})}
    assert tuple(processes) == NODES
    assert processes["planner"].parameters["machine"] == "m.yaml"
    assert processes["planner"].parameters["method"] == "lp"
    assert "machine" not in processes["recorder"].parameters
    assert all(node.parameter_file.is_file() for node in processes.values())
    arguments = processes["planner"].ros_arguments()
    assert arguments[:3] == ["--ros-args", "-r", "__node:=planner"]
    given = dict(item.split(":=", 1) for flag, item in pairwise(arguments) if flag == "-p")
    assert yaml.safe_load(given["present_nodes"]) == list(NODES)
    assert given["method"] == "lp"


@pytest.mark.parametrize("value", ["a b", "yes", "1.0", "", "C:\\x", "ünïcode", True, 3, 2.5, ["a", "b: c"]])
def test_parameter_values_survive_the_command_line(value: object) -> None:
    text = yaml_flow(value)
    assert "\n" not in text
    assert yaml.safe_load(text) == value


def test_unknown_names_are_refused(graph: Graph) -> None:
    with pytest.raises(ConfigError, match="spindle is not a node"):
        graph.required_subscriptions("planner", ["planner", "spindle"])
    with pytest.raises(ConfigError, match="spindle is not a node"):
        graph.processes(NODES, "m", {"spindle": {}})


GOOD = {
    "qos": {"q": {"reliability": "reliable", "durability": "volatile", "depth": 1}},
    "topics": {"/t": {"type": "p/msg/T", "from": ["a"], "to": ["a"], "qos": "q"}},
    "actions": {},
    "nodes": {"a": {"package": "p", "executable": "e", "parameters": "a.yaml"}},
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"topics": {"/t": {**GOOD["topics"]["/t"], "qos": "none"}}}, "unknown qos none"),
        ({"topics": {"/t": {**GOOD["topics"]["/t"], "to": ["b"]}}}, "unknown node b"),
        ({"actions": {"/x": {"type": "p/action/X", "server": "b"}}}, "unknown node b"),
        (
            {"qos": {"q": {"reliability": "sure", "durability": "volatile", "depth": 1}}},
            "qos.q.reliability is 'sure'",
        ),
        (
            {"qos": {"q": {"reliability": "reliable", "durability": "volatile", "depth": 0}}},
            "q.depth is 0, must be at least 1",
        ),
        ({"nodes": {"a": {"package": "p"}}}, "nodes.a.executable, nodes.a.parameters are missing"),
        ({"nodes": {"a": {**GOOD["nodes"]["a"], "machin": True}}}, "unknown key nodes.a.machin; did you mean machine"),
        ({"topics": {"/t": {**GOOD["topics"]["/t"], "from": "a"}}}, "topics./t.from is 'a', must be a list"),
        ({"topics": {"/t": {**GOOD["topics"]["/t"], "from": [1]}}}, r"topics./t.from\[0\] is 1, must be text"),
        ({"actions": None}, "actions is None, must be a mapping"),
    ],
)
def test_a_bad_file_is_refused_with_the_reason(tmp_path: Path, change: dict[str, object], message: str) -> None:
    path = tmp_path / "graph.yaml"
    path.write_text(yaml.safe_dump(GOOD), encoding="utf-8")
    assert load_graph(path).nodes["a"].machine is False
    path.write_text(yaml.safe_dump({**GOOD, **change}), encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        load_graph(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.yaml"):
        load_graph(tmp_path / "none.yaml")
