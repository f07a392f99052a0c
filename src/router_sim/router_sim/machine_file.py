"""The section of a machine file for its simulated drives and servos."""

from __future__ import annotations

from feedopt_core.config_files import find_section, parse_yaml, read_text
from feedopt_core.errors import ConfigError
from feedopt_core.machine.machine_file import load_machine, machine_path
from feedopt_core.schema import build
from router_sim.parameters import RouterSimParameters

_SECTION = ("router_sim", "ros__parameters")
_REMARK = " with the drives to simulate; add one, or run without the simulated router"


def load_router_parameters(name_or_path: str) -> RouterSimParameters:
    """Drives and servos of a machine, given by its file or by its name in ``config/machines``.

    Raises:
        ConfigError: the file or the section is missing, or a key is unknown, missing or invalid; names file, key, axis.
    """
    path = machine_path(name_or_path)
    return parse_router_parameters(read_text(path), str(path))


def load_matching_router(name_or_path: str) -> RouterSimParameters:
    """Drives and servos, checked against the machine of the same file: equal axes, one servo step per set point.

    Raises:
        ConfigError: as :func:`load_router_parameters`; or axes or period differ, the message has both values.
    """
    machine, drives = load_machine(name_or_path), load_router_parameters(name_or_path)
    if drives.axis_names != machine.axis_names:
        raise ConfigError(
            f"{name_or_path}: section router_sim has the axes {', '.join(drives.axis_names)}, "
            f"the machine {', '.join(machine.axis_names)}"
        )
    if drives.servo_period_s != machine.period_s:
        raise ConfigError(
            f"{name_or_path}: servo_period_s of section router_sim is {drives.servo_period_s:g} s, "
            f"period_s of the machine {machine.period_s:g} s; the servo takes one step a set point: make them equal"
        )
    return drives


def parse_router_parameters(text: str, source: str) -> RouterSimParameters:
    """Drives and servos from the text of a machine file; error messages name ``source``. Raises ConfigError."""
    section = find_section(parse_yaml(text, source), _SECTION, source, _REMARK)
    return build(RouterSimParameters, section, f"{source}: section {_SECTION[0]}")
