"""Processes of a graph: found, watched, named when they die, ended in order."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from feedopt_core.errors import ConfigError
from feedopt_node.graph import NodeProcess
from feedopt_tools.errors import NodeDiedError
from feedopt_tools.execute import processes as processes_module
from feedopt_tools.execute.processes import GraphProcesses, executable_path

PATIENCE_S = 30.0
# Says what it was given, then behaves as its name tells.
SCRIPT = f"""#!{sys.executable}
import os, signal, sys, time
name = sys.argv[0].rsplit("/", 1)[1]
print(name, os.environ["OMP_NUM_THREADS"], *sys.argv[1:], flush=True)
if name == "broken":
    print("no such axis", file=sys.stderr, flush=True)
    sys.exit(7)
if name == "deaf":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
else:
    signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
print("up", flush=True)
while True:
    time.sleep(60)
"""


@pytest.fixture(autouse=True)
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An ament prefix with executables of its own."""
    folder = tmp_path / "prefix" / "lib" / "fake"
    folder.mkdir(parents=True)
    for name in ("good", "broken", "deaf"):
        (folder / name).write_text(SCRIPT, encoding="utf-8")
        (folder / name).chmod(0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'none'}{os.pathsep}{tmp_path / 'prefix'}")
    return tmp_path / "prefix"


def node(name: str, executable: str = "good") -> NodeProcess:
    return NodeProcess(name, "fake", executable, Path("file.yaml"), {"a": 1})


def wait_for(condition: Callable[[], bool]) -> None:
    until_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.01)


def up(graph: GraphProcesses, *names: str) -> bool:
    return all("up\n" in graph.log_path(name).read_text(encoding="utf-8") for name in names)


def test_executables_are_found_as_ros_would(prefix: Path) -> None:
    assert executable_path("fake", "good") == prefix / "lib" / "fake" / "good"
    with pytest.raises(ConfigError, match="executable none of package fake is not installed"):
        executable_path("fake", "none")


def test_nodes_get_their_arguments_and_end_with_exit_code_0(tmp_path: Path) -> None:
    graph = GraphProcesses([node("a"), node("recorder")], tmp_path / "logs")
    graph.start()
    wait_for(lambda: up(graph, "a", "recorder"))
    graph.check()
    assert graph.stop() == {"a": 0, "recorder": 0}
    assert graph.remarks == []
    first = graph.log_path("a").read_text(encoding="utf-8").splitlines()[0]
    assert first == "good 1 --ros-args -r __node:=a --params-file file.yaml -p a:=1"


def test_a_node_that_dies_is_named_with_the_end_of_its_log(tmp_path: Path) -> None:
    graph = GraphProcesses([node("a"), node("planner", "broken")], tmp_path / "logs")
    graph.start()
    os.waitid(os.P_PID, graph.pid("planner"), os.WEXITED | os.WNOWAIT)
    with pytest.raises(NodeDiedError, match=r"planner ended with exit code 7(?s:.)*no such axis") as caught:
        graph.check()
    assert caught.value.exit_code == 7
    wait_for(lambda: up(graph, "a"))
    assert graph.stop() == {"a": 0, "planner": 7}


def test_a_node_that_is_killed_is_named_with_the_signal(tmp_path: Path) -> None:
    graph = GraphProcesses([node("a")], tmp_path / "logs")
    graph.start()
    os.kill(graph.pid("a"), signal.SIGKILL)
    os.waitid(os.P_PID, graph.pid("a"), os.WEXITED | os.WNOWAIT)
    with pytest.raises(NodeDiedError, match="a was killed by SIGKILL"):
        graph.check()
    graph.stop()


def test_force_is_the_last_resort_and_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = ((signal.SIGINT, 0.2), (signal.SIGTERM, 0.2), (signal.SIGKILL, PATIENCE_S))
    monkeypatch.setattr(processes_module, "_STEPS", steps)
    graph = GraphProcesses([node("a", "deaf")], tmp_path / "logs")
    graph.start()
    wait_for(lambda: up(graph, "a"))
    assert graph.stop() == {"a": -signal.SIGKILL}
    assert graph.remarks == ["a did not end; sent SIGTERM", "a did not end; sent SIGKILL"]


def test_nothing_is_started_where_one_executable_is_missing(tmp_path: Path) -> None:
    graph = GraphProcesses([node("a"), node("b", "none")], tmp_path / "logs")
    with pytest.raises(ConfigError, match="executable none"):
        graph.start()
    assert graph.stop() == {}
