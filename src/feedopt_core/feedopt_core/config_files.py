"""Configuration files: where they stand (installed share folder, or the source tree), and what YAML they hold."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from feedopt_core.errors import ConfigError

PACKAGE = "feedopt_config"


@cache
def config_directory() -> Path:
    """Folder with ``graph.yaml``, ``machines/``, ``nodes/`` and ``programs/``.

    The installed package ``feedopt_config`` comes first; without it, ``config/`` of the source tree this file stands
    in.

    Raises:
        ConfigError: neither is there.
    """
    # The ament index itself, read without ROS: one share folder a package below each prefix.
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        share = Path(prefix) / "share" / PACKAGE
        if prefix and (share / "graph.yaml").is_file():
            return share
    for parent in Path(__file__).resolve().parents:
        if (parent / "config" / "graph.yaml").is_file():
            return parent / "config"
    raise ConfigError(f"package {PACKAGE} is not installed: build the workspace and source its setup, or run ./feedopt")


def find_config(folder: str, name_or_path: str, suffix: str = ".yaml") -> Path:
    """Path of a configuration file given as a path or as the name of a file in one folder of the configuration.

    Args:
        folder: folder below :func:`config_directory`, such as ``machines``.
        name_or_path: an existing file, or a name in that folder with or without its suffix.
        suffix: suffix of the files in that folder.

    Raises:
        ConfigError: no such file; the message lists the names there are.
    """
    path = Path(name_or_path)
    directory = config_directory() / folder
    known = {entry.stem: entry for entry in sorted(directory.glob(f"*{suffix}"))}
    try:
        if path.is_file():
            return path
    except OSError as error:
        raise ConfigError(f"{name_or_path[:40]}...: {error.strerror}") from error
    if (name := name_or_path.removesuffix(suffix)) in known:
        return known[name]
    raise ConfigError(f"{name_or_path}: neither a file nor one of the names in {folder}: {', '.join(known)}")


def read_text(path: Path) -> str:
    """Text of a file. Raises ConfigError."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error


def parse_yaml(text: str, source: str) -> Any:
    """What a YAML document holds; ``source`` names it in errors. Raises ConfigError."""
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        # A date that is none is a ValueError, brackets without end are a RecursionError.
        raise ConfigError(f"{source}: not valid YAML: {error}") from error


def find_section(document: Any, keys: tuple[str, ...], source: str, remark: str = "") -> Any:
    """What stands under nested keys of a YAML document. Raises ConfigError, with a remark on what to do."""
    for key in keys:
        if not isinstance(document, Mapping) or key not in document:
            raise ConfigError(f"{source}: has no section '{': '.join(keys)}:'{remark}")
        document = document[key]
    return document


def ros_parameters(document: Any, node: str, source: str) -> dict[str, Any]:
    """What a ROS parameter file gives a node: section ``/**``, and the node's own over it.

    Raises:
        ConfigError: the document is of another form.
    """
    values: dict[str, Any] = {}
    for section in ("/**", node):
        entry = (document or {}).get(section, {}) if isinstance(document, Mapping | None) else None
        given = entry.get("ros__parameters", {}) if isinstance(entry, Mapping) else None
        if not isinstance(given, Mapping):
            raise ConfigError(f"{source}: must be sections of the form '{section}: ros__parameters: name: value'")
        values.update(given)
    return values
