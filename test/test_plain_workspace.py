"""The sources as any ROS 2 workspace: a plain ``colcon build`` in an empty folder, then nodes and command from there.

./feedopt has no part in it. The ROS 2 beneath is the one this test runs on: sourced, or the wheels from PyPI.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

WORKSPACE = Path(__file__).resolve().parents[1]
FEEDOPT = "install/feedopt_tools/lib/feedopt_tools/feedopt"
PROGRAM = "x_mm,y_mm\n0,0\n4,1\n8,0\n10,3\n"

pytestmark = pytest.mark.graph


def underlay(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment without this workspace: what a shell has where only ROS 2 is sourced."""
    bare = {key: value for key, value in environment.items() if key not in ("FEEDOPT_ROOT", "COLCON_PREFIX_PATH")}
    ours = tuple(f"{WORKSPACE / folder}{os.sep}" for folder in ("src", "build", "install"))
    for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH"):
        folders = [folder for folder in bare.get(name, "").split(os.pathsep) if folder]
        bare[name] = os.pathsep.join(folder for folder in folders if not f"{folder}{os.sep}".startswith(ours))
    bare["CMAKE_PREFIX_PATH"] = bare["CMAKE_PREFIX_PATH"] or bare["AMENT_PREFIX_PATH"]
    return bare


def run(folder: Path, *command: str) -> str:
    """Output of a program that must succeed."""
    done = subprocess.run(
        command, cwd=folder, env=underlay(os.environ), capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def sourced(folder: Path, command: str) -> str:
    return run(folder, "bash", "-c", f". install/setup.bash && {command}")


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plain")
    for name in ("src", "config", "test"):
        shutil.copytree(WORKSPACE / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    cmake = [f"-DPython3_EXECUTABLE={sys.executable}", "-DBUILD_TESTING=OFF"]
    if (Path(sys.prefix) / "share/ament_index").is_dir():
        # The wheels' CMake files name folders of the machine that made them; this mends them from outside.
        cmake.append(f"-DCMAKE_PROJECT_INCLUDE={WORKSPACE / 'setup/ros_wheels.cmake'}")
    run(folder, sys.executable, "-m", "colcon", "build", "--cmake-args", *cmake)
    (folder / "tiny.csv").write_text(PROGRAM, encoding="utf-8")
    return folder


def test_modules_and_configuration_are_the_installed_ones(workspace):
    code = "import feedopt_core, feedopt_core.config_files as c; print(feedopt_core.__file__, c.config_directory())"
    module, configuration = sourced(workspace, f"{sys.executable} -c '{code}'").split()
    assert Path(module).is_relative_to(workspace / "install/feedopt_core")
    assert Path(configuration).is_relative_to(workspace / "install/feedopt_config")


def test_program_is_planned_and_run_by_the_installed_nodes(workspace):
    said = sourced(workspace, f"{FEEDOPT} plan tiny.csv --setpoints tiny_1khz.csv && {FEEDOPT} run tiny.csv --out run")
    assert "tiny.csv: 12.5 mm" in said
    assert (workspace / "tiny_1khz.csv").stat().st_size > 0
    assert "result       done" in said
    logs = sorted(path.stem for path in (workspace / "run").rglob("*.log"))
    assert {"interpolator", "planner", "recorder", "router_sim", "toolpath"} <= set(logs)
    assert "complete" in sourced(workspace, f"{FEEDOPT} bag check run")
