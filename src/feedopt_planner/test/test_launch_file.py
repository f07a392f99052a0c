"""The launch file against stand-ins for ``launch``, which is not on PyPI: it starts what the graph says."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from feedopt_node.graph import ONE_THREAD, load_graph

LAUNCH_FILE = Path(__file__).resolve().parents[1] / "launch" / "feedopt.launch.py"


class LaunchConfiguration:
    """Reads an argument from the context."""

    def __init__(self, name: str) -> None:
        self.name = name

    def perform(self, context: dict[str, str]) -> str:
        return context[self.name]


def record(kind: str) -> Any:
    """A stand-in that keeps what it was made with."""
    return lambda *arguments, **options: SimpleNamespace(kind=kind, arguments=arguments, **options)


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    contents = {
        "launch": {"LaunchDescription": list, "LaunchContext": dict},
        "launch.actions": {
            name: record(name)
            for name in ("DeclareLaunchArgument", "OpaqueFunction", "SetEnvironmentVariable", "Shutdown")
        },
        "launch.substitutions": {"LaunchConfiguration": LaunchConfiguration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": record("Node")},
    }
    for name, attributes in contents.items():
        module = ModuleType(name)
        vars(module).update(attributes)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("feedopt_launch_file", LAUNCH_FILE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def nodes(launch_file: ModuleType, **chosen: str) -> dict[str, Any]:
    """Nodes by name, started with the defaults and these arguments."""
    entities = launch_file.generate_launch_description()
    defaults = {e.arguments[0]: e.default_value for e in entities if e.kind == "DeclareLaunchArgument"}
    assert set(chosen) <= set(defaults)
    opaque = next(e for e in entities if e.kind == "OpaqueFunction")
    return {node.name: node for node in opaque.function(defaults | chosen)}


def test_every_node_of_the_graph_is_started_as_the_graph_says(launch_file: ModuleType) -> None:
    graph = load_graph()
    started = nodes(launch_file)
    assert list(started) == list(graph.nodes)
    for process in graph.processes(graph.nodes, "router_simulation"):
        node = started[process.name]
        assert (node.package, node.executable) == (process.package, process.executable)
        assert node.parameters == [str(process.parameter_file), process.ros_parameters()]
        assert node.on_exit.kind == "Shutdown"


def test_arguments_choose_nodes_machine_and_method(launch_file: ModuleType) -> None:
    started = nodes(launch_file, record="false", sim="false", machine="m.yaml", method="lp")
    assert list(started) == ["toolpath", "planner", "interpolator"]
    given = started["planner"].parameters[1]
    assert given == {"present_nodes": ["toolpath", "planner", "interpolator"], "machine": "m.yaml", "method": "lp"}


def test_linear_algebra_runs_in_one_thread(launch_file: ModuleType) -> None:
    entities = launch_file.generate_launch_description()
    assert dict(e.arguments for e in entities if e.kind == "SetEnvironmentVariable") == ONE_THREAD
