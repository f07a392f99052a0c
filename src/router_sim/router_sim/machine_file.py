"""The section of a machine file that describes its simulated drives and servos."""

from __future__ import annotations

import yaml

from feedopt_core.errors import ConfigError
from feedopt_core.machine.machine_file import machine_path
from router_sim.parameters import RouterSimParameters

SECTION = "router_sim"


def load_router_parameters(name_or_path: str) -> RouterSimParameters:
    """Drives and servos of a machine given by file or by its name in ``config/machines``.

    Raises:
        ConfigError: no such file or section, or an unknown, missing or impossible key; names file and key.
    """
    path = machine_path(name_or_path)
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    try:
        section = document[SECTION]["ros__parameters"]
    except (TypeError, KeyError) as error:
        raise ConfigError(
            f"{path}: has no section '{SECTION}: ros__parameters:' with the drives to simulate; "
            "add one, or run without the simulated router"
        ) from error
    try:
        return RouterSimParameters.from_mapping(section)
    except ConfigError as error:
        raise ConfigError(f"{path}: section {SECTION}: {error}") from error
