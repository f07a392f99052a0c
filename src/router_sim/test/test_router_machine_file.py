"""The section of a machine file that describes the simulated drives."""

from __future__ import annotations

from pathlib import Path

import pytest

from feedopt_core.errors import ConfigError
from feedopt_core.machine.machine_file import load_machine, machine_path
from router_sim.machine_file import load_router_parameters

MACHINES = sorted(path.stem for path in machine_path("router_simulation").parent.glob("*.yaml"))


@pytest.mark.parametrize("name", MACHINES)
def test_simulated_axes_are_those_of_the_machine(name: str) -> None:
    assert load_router_parameters(name).axis_names == load_machine(name).axis_names


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("/**: {}\n", "has no section 'router_sim"),
        (
            "router_sim: {ros__parameters: {axis_names: [X]}}\n",
            "section router_sim: servo_period_s, .* are missing",
        ),
        ("router_sim: [\n", "not valid YAML"),
    ],
)
def test_a_bad_file_is_named_with_the_reason(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "machine.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        load_router_parameters(str(path))
    assert str(path) in str(caught.value)
