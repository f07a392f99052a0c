"""The checks of ``feedopt doctor``, each with its remedy."""

from __future__ import annotations

import ctypes.util
import importlib.util
import os
import platform
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from feedopt_core.errors import FeedoptError
from feedopt_node.graph import load_graph
from feedopt_tools.command.extras import missing_extra
from feedopt_tools.command.workspace import workspace_root
from feedopt_tools.execute.domain_lock import DomainLock, domain_id
from feedopt_tools.execute.processes import executable_path

_GIBIBYTE = 2**30
_LEAST_FREE_GIBIBYTES = 1.0
_HIGHEST_LOCAL_DOMAIN = 101


@dataclass(frozen=True)
class Check:
    """One finding. ``missing``: the graph cannot run. ``hint``: it runs with a disadvantage."""

    name: str
    verdict: Literal["ok", "hint", "missing"]
    found: str
    way_out: str = ""


def all_checks() -> tuple[Check, ...]:
    """Every check, in the order in which problems should be solved."""
    return (
        check_python(sys.version_info[:2]),
        check_ros(),
        check_build(),
        check_cores(),
        check_real_time(),
        check_pictures(),
        check_display(),
        check_disk(workspace_root()),
        check_domain(os.environ.get("ROS_DOMAIN_ID", "")),
    )


def check_python(version: tuple[int, int]) -> Check:
    """Check for Python 3.11 or 3.12."""
    found = f"{version[0]}.{version[1]} ({sys.executable})"
    if version in ((3, 11), (3, 12)):
        return Check("Python", "ok", found)
    return Check("Python", "missing", found, "set FEEDOPT_PYTHON=python3.12 and run ./feedopt again")


def check_ros() -> Check:
    """Check that rclpy can be imported."""
    spec = importlib.util.find_spec("rclpy")
    if spec is None or spec.origin is None:
        way_out = "run ./feedopt, which installs it from PyPI, or source ROS 2 Jazzy"
        return Check("ROS 2", "missing", "rclpy cannot be found", way_out)
    return Check("ROS 2", "ok", f"rclpy in {Path(spec.origin).parent}")


def check_build() -> Check:
    """Check that the messages and the executables of every node are installed."""
    try:
        for node in load_graph().nodes.values():
            executable_path(node.package, node.executable)
    except FeedoptError as error:
        return Check("build", "missing", str(error), "run ./feedopt, which builds all changed packages")
    if importlib.util.find_spec("feedopt_msgs") is None:
        return Check("build", "missing", "feedopt_msgs cannot be found", "run ./feedopt, which builds it")
    return Check("build", "ok", f"{len(load_graph().nodes)} nodes are installed")


def check_cores() -> Check:
    """Check for two processor cores."""
    cores = len(os.sched_getaffinity(0))
    found = f"{cores} cores, {platform.machine()}"
    if cores >= 2:
        return Check("processor", "ok", found)
    return Check("processor", "hint", found, "planning and the 1 kHz set points share one core: expect late ticks")


def check_real_time() -> Check:
    """Check that Linux grants SCHED_FIFO."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        way_out = "add '@realtime - rtprio 99' to /etc/security/limits.conf and yourself to the group realtime"
        return Check("real time", "hint", "SCHED_FIFO is refused", way_out)
    os.sched_setscheduler(0, policy, parameters)
    return Check("real time", "ok", "SCHED_FIFO is granted")


def check_pictures() -> Check:
    """Check that Rerun can draw pictures: Rerun, the Vulkan loader and a Vulkan driver are installed."""
    if importlib.util.find_spec("rerun") is None:
        return Check("pictures", "hint", "the extra view is not installed", missing_extra("rerun") or "")
    drivers = [*Path("/usr/share/vulkan/icd.d").glob("*.json"), *Path("/etc/vulkan/icd.d").glob("*.json")]
    if ctypes.util.find_library("vulkan") and drivers:
        return Check("pictures", "ok", f"Vulkan with {len(drivers)} drivers")
    way_out = "sudo apt-get install mesa-vulkan-drivers libvulkan1; until then matplotlib draws the pictures"
    return Check("pictures", "hint", "no Vulkan driver", way_out)


def check_display() -> Check:
    """Check that a window can be opened."""
    if any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")):
        return Check("display", "ok", "available")
    return Check("display", "hint", "none", "feedopt view writes a recording; open it on another computer")


def check_disk(folder: Path) -> Check:
    """Check the free disk space for recordings."""
    free = shutil.disk_usage(folder).free / _GIBIBYTE
    found = f"{free:.1f} GiB free in {folder}"
    if free >= _LEAST_FREE_GIBIBYTES:
        return Check("disk", "ok", found)
    return Check("disk", "missing", found, "free some space: a minute of recording needs about 10 MB, the build 400 MB")


def check_domain(domain: str) -> Check:
    """Check that the ROS domain has a valid number and no graph runs on it."""
    if domain and not (domain.isdigit() and int(domain) <= _HIGHEST_LOCAL_DOMAIN):
        return Check("ROS domain", "missing", f"ROS_DOMAIN_ID is {domain!r}", f"set it to 0 to {_HIGHEST_LOCAL_DOMAIN}")
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    try:
        with DomainLock(domain_id()):
            return Check("ROS domain", "ok", f"{domain_id()}, discovery {reach}")
    except FeedoptError as error:
        return Check("ROS domain", "hint", str(error))
