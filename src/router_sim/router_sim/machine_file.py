"""The section of a machine file that describes its simulated drives and servos."""

from __future__ import annotations

from feedopt_core.config_files import find_section, parse_yaml, read_text
from feedopt_core.machine.machine_file import machine_path
from feedopt_core.schema import build
from router_sim.parameters import RouterSimParameters

_SECTION = ("router_sim", "ros__parameters")
_REMARK = " with the drives to simulate; add one, or run without the simulated router"


def load_router_parameters(name_or_path: str) -> RouterSimParameters:
    """Drives and servos of a machine given by file or by its name in ``config/machines``.

    Raises:
        ConfigError: no such file or section, or an unknown, missing or impossible key; names file, key and axis.
    """
    path = machine_path(name_or_path)
    return parse_router_parameters(read_text(path), str(path))


def parse_router_parameters(text: str, source: str) -> RouterSimParameters:
    """Drives and servos from the text of a machine file; ``source`` names it in errors. Raises ConfigError."""
    section = find_section(parse_yaml(text, source), _SECTION, source, _REMARK)
    return build(RouterSimParameters, section, f"{source}: section {_SECTION[0]}")
