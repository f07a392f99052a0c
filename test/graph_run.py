"""What the graph tests share: tiny programs, a ROS domain of their own, and a graph that runs while a test looks on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from feedopt_core.machine.machine_file import machine_path
from feedopt_node.graph import load_graph
from feedopt_tools.execute.client import GraphClient, ProgramOutcome, ProgramRequest, Progress
from feedopt_tools.execute.processes import GraphProcesses

PATIENCE_S = 60.0
TINY = "x_mm,y_mm\n0,0\n4,1\n8,0\n10,3\n"
MACHINE = "router_simulation"


def own_domain() -> str:
    """A ROS domain that another test run on this machine is unlikely to use."""
    return str(10 + os.getpid() % 90)


class RunningGraph:
    """A graph of processes with a client."""

    def __init__(self, directory: Path) -> None:
        graph = load_graph()
        self.directory = directory
        self.bag = directory / "recording"
        self.names = graph.chosen_nodes()
        nodes = graph.processes(self.names, str(machine_path(MACHINE)), {"recorder": {"bag_directory": str(self.bag)}})
        self.nodes = {node.name: node for node in nodes}
        self.processes = GraphProcesses(nodes, directory / "logs")
        self.processes.start()
        self.client = GraphClient(self.names, self.processes.check)

    def run_text(self, text: str) -> ProgramOutcome:
        """Execute a program given as text."""
        return self.run(ProgramRequest("tiny.csv", text=text))

    def run(
        self, request: ProgramRequest, on_progress: Callable[[Progress], None] = lambda progress: None
    ) -> ProgramOutcome:
        """Execute a program."""
        self.client.send(request)
        return self.client.follow(on_progress)

    def signal_all(self, number: signal.Signals) -> None:
        """Send a signal to every node."""
        for name in self.names:
            os.kill(self.processes.pid(name), number)

    def close(self) -> dict[str, int]:
        """End everything; exit codes by node."""
        try:
            return self.processes.stop()
        finally:
            self.client.close()


@contextmanager
def running_graph(directory: Path) -> Iterator[RunningGraph]:
    """A graph whose nodes are all ready."""
    graph = RunningGraph(directory)
    try:
        graph.client.wait_ready()
        yield graph
    finally:
        graph.close()


def feedopt(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The command, as a process."""
    return subprocess.run(
        [sys.executable, "-m", "feedopt_tools.command.main", *arguments],
        capture_output=True,
        text=True,
        timeout=3 * PATIENCE_S,
        check=False,
    )


def wait_for(condition: Callable[[], bool], what: str) -> None:
    """Wait for a condition of another process."""
    until_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until_s, f"waited {PATIENCE_S:g} s in vain: {what}"
        time.sleep(0.02)
