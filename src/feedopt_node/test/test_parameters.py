"""Parameters from YAML and from ROS by the same rules."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.parameter import Parameter

from feedopt_core.errors import ConfigError
from feedopt_core.schema import build, parameter
from feedopt_node.parameters import (
    GraphParameters,
    MachineNodeParameters,
    declare_parameters,
    load_parameters,
)


@dataclass(frozen=True, kw_only=True)
class Sample(MachineNodeParameters):
    """A node's parameters."""

    window_mm: float = parameter("Length.", default=2.0, unit="mm", at_least=0.5, at_most=10.0)
    count: int = parameter("Count.", default=3, at_least=1)
    method: str = parameter("Method.", default="lp", choices=("lp", "nlp"))
    verbose: bool = parameter("Talk.", default=False)
    tags: tuple[str, ...] = parameter("Tags.", default=())


GIVEN = {"machine": "m", "window_mm": 4.0, "count": 7, "method": "nlp", "verbose": True, "tags": ["a", "b"]}
BAD = [
    ({"machine": "m", "speed": 1.0}, "unknown key speed; known are present_nodes, machine"),
    ({}, "machine is missing: Machine file, or its name"),
    ({"machine": "m", "window_mm": 0.1}, "window_mm is 0.1 mm, must be at least 0.5 mm"),
    ({"machine": "m", "window_mm": 11.0}, "must be at most 10 mm"),
    ({"machine": "m", "window_mm": "1e-3"}, "write 1.0e-3"),
    ({"machine": "m", "count": 0}, "count is 0, must be at least 1"),
    ({"machine": "m", "count": 1.5}, "count is 1.5, must be a whole number"),
    ({"machine": "m", "count": True}, "count is True, must be a whole number"),
    ({"machine": "m", "method": "magic"}, "must be one of lp, nlp"),
    ({"machine": "m", "verbose": 1}, "verbose is 1, must be true or false"),
    ({"machine": "m", "tags": "a"}, "must be a list"),
    ({"machine": 3}, "machine is 3, must be text"),
]


def test_values_and_defaults() -> None:
    assert build(Sample, GIVEN, "x") == Sample(
        machine="m", window_mm=4.0, count=7, method="nlp", verbose=True, tags=("a", "b")
    )
    assert build(Sample, {"machine": "m"}, "x") == Sample(machine="m")


def test_a_whole_number_is_a_float_too() -> None:
    assert build(Sample, {"machine": "m", "window_mm": 3}, "x").window_mm == 3.0


@pytest.mark.parametrize(("values", "message"), BAD)
def test_bad_values_are_refused_by_name(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        build(Sample, values, "here")


def test_not_finite_is_refused() -> None:
    with pytest.raises(ConfigError, match="finite"):
        build(Sample, {"machine": "m", "window_mm": float("nan")}, "x")


def test_the_node_section_wins_over_the_common_one(tmp_path: Path) -> None:
    path = tmp_path / "node.yaml"
    path.write_text(
        "/**:\n  ros__parameters: {machine: all, count: 2, other: 1}\nnode:\n  ros__parameters: {count: 5}\n",
        encoding="utf-8",
    )
    assert load_parameters(Sample, path, "node", beside=("other",)) == Sample(machine="all", count=5)
    with pytest.raises(ConfigError, match="unknown key other"):
        load_parameters(Sample, path, "node")


@pytest.mark.parametrize("text", ["- 1\n", "node: 3\n", "node: {ros__parameters: 3}\n", ": :"])
def test_a_file_of_another_form_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "node.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"node\.yaml"):
        load_parameters(Sample, path, "node")


@pytest.fixture
def context() -> Iterator[rclpy.Context]:
    context = rclpy.Context()
    rclpy.init(context=context)
    yield context
    rclpy.try_shutdown(context=context)


def declared(context: rclpy.Context, cls: type[Any], values: dict[str, Any]) -> tuple[Any, Any]:
    node = rclpy.create_node(
        "sample",
        context=context,
        parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
        automatically_declare_parameters_from_overrides=True,
    )
    return declare_parameters(node, cls), node


def test_ros_gives_the_same_parameters(context: rclpy.Context) -> None:
    parameters, node = declared(context, Sample, GIVEN)
    assert parameters == build(Sample, GIVEN, "x")
    assert node.get_parameter("window_mm").value == 4.0
    descriptor = node.describe_parameter("window_mm")
    assert descriptor.description == "Length. [mm]"
    assert (descriptor.floating_point_range[0].from_value, descriptor.floating_point_range[0].to_value) == (0.5, 10.0)
    assert not node.set_parameters([Parameter("count", value=8)])[0].successful


def test_ros_takes_a_whole_number_for_a_float(context: rclpy.Context) -> None:
    parameters, node = declared(context, Sample, {"machine": "m", "window_mm": 3})
    assert parameters.window_mm == 3.0
    assert node.get_parameter("window_mm").type_ is Parameter.Type.DOUBLE


def test_ros_defaults(context: rclpy.Context) -> None:
    parameters, _ = declared(context, GraphParameters, {})
    assert parameters == GraphParameters(present_nodes=())


@pytest.mark.parametrize(("values", "message"), [row for row in BAD if row[0] != {}])
def test_ros_refuses_the_same(context: rclpy.Context, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        declared(context, Sample, values)
