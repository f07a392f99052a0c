"""The command with a graph of its own: whole runs, exit codes, signals."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from graph_run import TINY, RunningGraph, feedopt, running_graph, wait_for

from feedopt_node.status import SILENCE_BEATS, STATUS_PERIOD_S
from feedopt_recorder.bags.check_bag import check_run
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_tools.execute.domain_lock import DomainLock, domain_id
from feedopt_tools.execute.judgement import judge_run

pytestmark = pytest.mark.graph


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.csv"
    path.write_text(TINY, encoding="utf-8")
    return path


def test_a_run_is_complete_and_within_its_limits(tiny: Path, tmp_path: Path) -> None:
    done = feedopt("run", str(tiny), "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stdout + done.stderr
    run = read_bag(tmp_path / "out" / "recording")
    assert run.title == "tiny.csv"
    judgement = judge_run(run)
    assert judgement.findings == ()
    assert judgement.punctuality.missing_ticks == 0
    assert judgement.audit.holds, judgement.audit.worst
    assert len(run.states) == len(run.setpoints)
    np.testing.assert_allclose(run.setpoints.position_mm[[0, -1]], [[0.0, 0.0], [10.0, 3.0]], atol=1e-9)


def test_without_the_router_the_interpolator_ends_the_program(tiny: Path, tmp_path: Path) -> None:
    done = feedopt("run", str(tiny), "--no-sim", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stdout + done.stderr
    run = read_bag(tmp_path / "out" / "recording")
    assert run.setpoints.last[-1]
    assert len(run.states) == 0
    assert {finding.kind for finding in check_run(run)} <= {"no_state"}


def test_a_bad_program_ends_the_command_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text("0,0\n1,one\n", encoding="utf-8")
    done = feedopt("run", str(path), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert "bad.csv:2:3: 'one' is not a number" in done.stdout.replace("\n", "")
    assert "Traceback" not in done.stdout + done.stderr


def test_a_second_command_on_the_domain_is_refused(tiny: Path, tmp_path: Path) -> None:
    with DomainLock(domain_id()):
        done = feedopt("run", str(tiny), "--out", str(tmp_path / "out"))
    assert done.returncode == 3
    assert f"a graph already runs on ROS domain {domain_id()} (process {os.getpid()})" in done.stderr


def test_nodes_end_cleanly_on_sigterm(tmp_path: Path) -> None:
    with running_graph(tmp_path) as graph:
        graph.signal_all(signal.SIGTERM)
        wait_for(lambda: not alive(graph), "the nodes end")
        assert graph.processes.stop() == dict.fromkeys(graph.names, 0)


def alive(graph: RunningGraph) -> bool:
    options = os.WEXITED | os.WNOHANG | os.WNOWAIT
    return any(os.waitid(os.P_PID, graph.processes.pid(name), options) is None for name in graph.names)


def test_a_node_that_dies_ends_the_run_and_is_named(tmp_path: Path) -> None:
    path, out = tmp_path / "long.csv", tmp_path / "out"
    path.write_text(long_program(), encoding="utf-8")
    with start("run", str(path), "--out", str(out)) as process:
        wait_for((out / "recording").is_dir, "the recorder starts")
        os.kill(child(process.pid, "planner"), signal.SIGKILL)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "planner was killed by SIGKILL" in errors
    assert "Traceback" not in errors


def test_a_node_that_falls_silent_ends_the_program_and_is_named(tmp_path: Path) -> None:
    with started_run(tmp_path) as process:
        interpolator = child(process.pid, "interpolator")
        os.kill(interpolator, signal.SIGSTOP)
        assert process.stdout is not None
        while "ending the nodes" not in process.stdout.readline():
            assert process.poll() is None, "the command ended too early"
        os.kill(interpolator, signal.SIGCONT)
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 1, errors
    assert "interpolator: no longer publishes its status" in output


def test_a_computer_that_stands_still_for_a_while_ends_no_program(tmp_path: Path) -> None:
    with started_run(tmp_path) as process:
        nodes = [child(process.pid, name) for name in ("toolpath", "planner", "interpolator", "recorder")]
        for node in nodes:
            os.kill(node, signal.SIGSTOP)
        goes_on_s = time.monotonic() + 1.2 * SILENCE_BEATS * STATUS_PERIOD_S
        wait_for(lambda: time.monotonic() > goes_on_s, "the nodes stand still")
        for node in nodes:
            os.kill(node, signal.SIGCONT)
        output, errors = process.communicate(timeout=60)
    assert "done" in output, output + errors


def test_an_interrupted_run_stops_on_the_path_and_ends_cleanly(tmp_path: Path) -> None:
    with started_run(tmp_path) as process:
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 1, errors
    assert "stopping on the path" in output
    assert "canceled by the client" in output
    assert "exit code" not in output
    assert "Traceback" not in output + errors


def long_program(points: int = 200) -> str:
    return "x_mm,y_mm\n" + "".join(f"{10 * i},{i % 2}\n" for i in range(points))


@contextmanager
def started_run(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A command without the router, as soon as its program executes."""
    path = tmp_path / "long.csv"
    path.write_text(long_program(points=30), encoding="utf-8")
    with start("run", str(path), "--no-sim", "--out", str(tmp_path / "out")) as process:
        assert process.stdout is not None
        while "executing" not in (line := process.stdout.readline()):
            assert line, "the command ended before the program began"
        yield process


def start(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-u", "-m", "feedopt_tools.command.main", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def child(parent: int, node: str) -> int | None:
    """Process of a node below a command."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            owner = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            arguments = (entry / "cmdline").read_bytes().split(b"\0")
        except (OSError, IndexError):
            continue
        if owner == parent and f"__node:={node}".encode() in arguments:
            return int(entry.name)
    return None
