"""Parameter files of the nodes against the dataclasses, in which the defaults stand."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any

import pytest
import yaml

from feedopt_core.config_files import config_directory
from feedopt_core.schema import rule_of
from feedopt_interpolator.interpolator_node import InterpolatorNodeParameters
from feedopt_node.graph import load_graph
from feedopt_node.parameters import MachineNodeParameters
from feedopt_planner.planner_node import PlannerNodeParameters
from feedopt_planner.toolpath_node import ToolpathNodeParameters
from feedopt_recorder.parameters import RecorderParameters
from router_sim.router_sim_node import RouterSimNodeParameters

NODES: dict[str, type[Any]] = {
    "toolpath": ToolpathNodeParameters,
    "planner": PlannerNodeParameters,
    "interpolator": InterpolatorNodeParameters,
    "router_sim": RouterSimNodeParameters,
    "recorder": RecorderParameters,
}
FROM_THE_GRAPH = {entry.name for entry in fields(MachineNodeParameters)}


def test_every_node_of_the_graph_is_tested() -> None:
    assert set(NODES) == set(load_graph().nodes)


@pytest.mark.parametrize("node", NODES)
def test_the_file_gives_every_parameter_its_default(node: str) -> None:
    path = config_directory() / load_graph().nodes[node].parameters
    given = yaml.safe_load(path.read_text(encoding="utf-8"))["/**"]["ros__parameters"]
    defaults = {entry.name: entry.default for entry in fields(NODES[node]) if entry.name not in FROM_THE_GRAPH}
    assert given == defaults


@pytest.mark.parametrize("node", NODES)
def test_every_parameter_is_documented(node: str) -> None:
    for entry in fields(NODES[node]):
        rule = rule_of(entry)
        assert rule.doc.endswith("."), entry.name
        assert entry.default is not MISSING or entry.name == "machine", entry.name
        assert bool(rule.unit) == (entry.type == "float"), entry.name
