"""Where a recorded run comes from: versions, source, machine, parameters and program, as MCAP metadata records."""

from __future__ import annotations

import hashlib
import json
import platform
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from feedopt_core.errors import ConfigError
from feedopt_recorder.bags.metadata_yaml import package_version

_PACKAGES = ("numpy", "scipy", "numba", "mcap", "zstandard", "ros-jazzy-rclpy")

Provenance = dict[str, dict[str, str]]


def collect_provenance(
    *,
    machine_yaml: str,
    parameters: Mapping[str, str],
    program_name: str,
    program_text: str,
    tolerance_mm: float = 0.0,
    transition_reach_mm: float = 0.0,
    transition_side: str = "",
    method: str = "",
) -> Provenance:
    """Records of one run, by name.

    Args:
        machine_yaml: the machine file as loaded.
        parameters: parameter file of each node with what the command line changed, as YAML text by node name.
        program_name: what the program is called.
        program_text: the program itself.
        tolerance_mm: smoothing tolerance that was asked for; 0: the toolpath node's parameter decides.
        transition_reach_mm, transition_side: layer transitions that were asked for; 0: none.
        method: planning method, empty where the node's parameter decides.
    """
    return {
        "feedopt/versions": versions(),
        "feedopt/machine": {"yaml": machine_yaml},
        "feedopt/parameters": dict(parameters),
        "feedopt/program": {
            "name": program_name,
            "sha256": hashlib.sha256(program_text.encode()).hexdigest(),
            "tolerance_mm": repr(float(tolerance_mm)),
            "transition_reach_mm": repr(float(transition_reach_mm)),
            "transition_side": transition_side,
            "method": method,
            "text": program_text,
        },
    }


def write_provenance(path: Path, provenance: Provenance) -> None:
    """Write the records for a recorder to pick up. Raises OSError."""
    path.write_text(json.dumps(provenance, indent=1), encoding="utf-8")


def read_provenance(path: Path) -> Provenance:
    """Records written by :func:`write_provenance`.

    Raises:
        ConfigError: the file is missing or holds something else.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"provenance_file {path}: cannot be read: {error}") from error
    if not isinstance(document, dict) or not all(isinstance(values, dict) for values in document.values()):
        raise ConfigError(f"provenance_file {path}: must map record names to keys and values")
    return {str(name): {str(key): str(value) for key, value in values.items()} for name, values in document.items()}


def versions() -> dict[str, str]:
    """Versions of feedopt, its source, the system and the packages that results depend on."""
    found = {
        "feedopt": package_version(),
        "commit": _commit(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
    }
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _commit() -> str:
    """Commit of the source tree these files stand in, marked where it was changed; empty outside of one."""
    command = ["git", "-C", str(Path(__file__).resolve().parent), "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        result = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return result.stdout.strip() if result.returncode == 0 else ""
