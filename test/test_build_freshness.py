"""What starts the build of the workspace again, and what does not: the functions of ./feedopt on a small copy."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

WORKSPACE = Path(__file__).resolve().parents[1]
SOURCES = {
    "config/package.xml": "<package><name>feedopt_config</name></package>\n",
    "config/machines/small.yaml": "axes: [x]\n",
    "src/first/package.xml": "<package><name>first</name></package>\n",
    "src/first/launch/first.launch.py": "SPEED = 1\n",
    "src/first/first/module.py": "VALUE = 1\n",
    "src/first/test/test_first.py": "assert True\n",
    "src/second/package.xml": "<package><name>second</name></package>\n",
    "src/second/msg/State.msg": "float64 position_mm\n",
}


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """A small workspace that counts as built."""
    for name in ("feedopt", "setup", "requirements"):
        copy = shutil.copytree if (WORKSPACE / name).is_dir() else shutil.copy2
        copy(WORKSPACE / name, tmp_path / name)
    for name, text in SOURCES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (tmp_path / "install").mkdir()
    call(tmp_path, 'build_recipe >"$built_stamp"; built_sources >"$built_manifest"')
    return tmp_path


def call(workspace: Path, script: str) -> str:
    """Standard output of a script that has the functions of ./feedopt."""
    sourced = f'. "{workspace}/feedopt"; . "{workspace}/setup/prepare.bash"; find_ros; {script}'
    return subprocess.run(["bash", "-c", sourced], check=True, capture_output=True, text=True).stdout


def is_fresh(workspace: Path) -> bool:
    return call(workspace, "if build_is_fresh; then echo fresh; fi") == "fresh\n"


def changed_packages(workspace: Path) -> list[str]:
    return call(workspace, "built_sources | changed_packages").split()


def test_what_was_built_is_fresh_and_has_no_changed_package(workspace):
    assert is_fresh(workspace)
    assert changed_packages(workspace) == []


def test_byte_code_beside_a_launch_file_builds_nothing(workspace):
    launch = workspace / "src/first/launch/first.launch.py"
    subprocess.run(["python3", "-m", "compileall", "-q", str(launch.parent)], check=True)
    assert list((launch.parent / "__pycache__").glob("*.pyc"))
    assert is_fresh(workspace)


def test_times_alone_build_nothing(workspace):
    for name in SOURCES:
        os.utime(workspace / name)
    for folder in (workspace / "src").rglob("*/"):
        os.utime(folder)
    assert is_fresh(workspace)


def test_linked_modules_and_tests_build_nothing(workspace):
    (workspace / "src/first/first/module.py").write_text("VALUE = 2\n")
    (workspace / "src/first/test/test_second.py").write_text("assert 1\n")
    assert is_fresh(workspace)


@pytest.mark.parametrize(
    ("name", "package"),
    [("config/machines/small.yaml", "feedopt_config"), ("src/second/msg/State.msg", "second")],
)
def test_another_content_builds_its_package(workspace, name, package):
    before = (workspace / name).stat()
    (workspace / name).write_text(SOURCES[name].upper())
    os.utime(workspace / name, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert not is_fresh(workspace)
    assert changed_packages(workspace) == [package]
    (workspace / name).write_text(SOURCES[name])
    assert is_fresh(workspace)


def test_a_new_file_and_one_that_is_gone_build_their_packages(workspace):
    (workspace / "config/machines/large.yaml").write_text("axes: [x, y]\n")
    (workspace / "src/second/msg/State.msg").unlink()
    assert not is_fresh(workspace)
    assert changed_packages(workspace) == ["feedopt_config", "second"]


def test_before_the_first_build_every_package_has_changed(workspace):
    (workspace / "install/feedopt-sources").unlink()
    assert changed_packages(workspace) == ["feedopt_config", "first", "second"]


def test_a_changed_lock_of_the_build_tool_starts_from_nothing(workspace):
    with (workspace / "requirements/colcon.txt").open("a") as lock:
        lock.write("# another\n")
    assert not is_fresh(workspace)
