"""The nodes of a graph as child processes."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from feedopt_core.errors import ConfigError
from feedopt_node.graph import ONE_THREAD, NodeProcess
from feedopt_tools.errors import NodeDiedError

_PR_SET_PDEATHSIG = 1
_LOG_LINES = 8
# The recorder ends last, so that it has what the others say at their end.
_LAST_TO_END = "recorder"
_STEPS = ((signal.SIGINT, 20.0), (signal.SIGTERM, 5.0), (signal.SIGKILL, 5.0))
_POLL_S = 0.02


def executable_path(package: str, executable: str) -> Path:
    """Executable of a node, as ``ros2 run`` would find it.

    Raises:
        ConfigError: it is in no prefix of ``AMENT_PREFIX_PATH``.
    """
    for prefix in _prefixes():
        path = prefix / "lib" / package / executable
        if path.is_file():
            return path
    raise ConfigError(
        f"executable {executable} of package {package} is not installed: build the workspace with ./feedopt, "
        "or source its install/setup.bash"
    )


class GraphProcesses:
    """Starts nodes, watches them, ends them.

    Args:
        nodes: what to start.
        log_directory: gets one file a node.
    """

    def __init__(self, nodes: Sequence[NodeProcess], log_directory: Path) -> None:
        self._nodes = tuple(nodes)
        self._log_directory = log_directory
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self.remarks: list[str] = []

    def start(self) -> None:
        """Start every node. Raises ConfigError where one is not installed; none is started then."""
        commands = {
            node.name: [str(executable_path(node.package, node.executable)), *node.ros_arguments()]
            for node in self._nodes
        }
        self._log_directory.mkdir(parents=True, exist_ok=True)
        for name, command in commands.items():
            with self.log_path(name).open("wb") as log:
                self._children[name] = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=os.environ | ONE_THREAD,
                    # A session of its own: ctrl-C reaches the command alone, which ends the nodes in order.
                    start_new_session=True,
                    # Should the command be killed, the nodes end too.
                    preexec_fn=_end_with_parent,  # noqa: PLW1509 (no thread runs yet)
                )

    def log_path(self, node: str) -> Path:
        """Log file of a node."""
        return self._log_directory / f"{node}.log"

    def pid(self, node: str) -> int:
        """Process of a node."""
        return self._children[node].pid

    def check(self) -> None:
        """Raises NodeDiedError if a node has ended by itself; its message has the end of its log."""
        for name, child in self._children.items():
            code = child.poll()
            if code is not None:
                end_of_log = f"the end of {self.log_path(name)}:\n{self._tail(name)}"
                raise NodeDiedError(f"{name} {_ending(code)}; {end_of_log}", code)

    def stop(self) -> dict[str, int]:
        """End every node that still runs and return all exit codes; ``remarks`` says where force was needed."""
        self._stop([name for name in self._children if name != _LAST_TO_END])
        self._stop([name for name in self._children if name == _LAST_TO_END])
        return {name: child.returncode for name, child in self._children.items()}

    def _stop(self, names: Sequence[str]) -> None:
        for number, patience_s in _STEPS:
            running = [name for name in names if self._children[name].poll() is None]
            if not running:
                return
            for name in running:
                if number != signal.SIGINT:
                    self.remarks.append(f"{name} did not end; sent {number.name}")
                self._children[name].send_signal(number)
            self._wait(running, patience_s)

    def _wait(self, names: Sequence[str], patience_s: float) -> None:
        until_s = time.monotonic() + patience_s
        while any(self._children[name].poll() is None for name in names) and time.monotonic() < until_s:
            time.sleep(_POLL_S)

    def _tail(self, name: str) -> str:
        lines = self.log_path(name).read_text(encoding="utf-8", errors="replace").splitlines()
        return "\n".join(f"    {line}" for line in lines[-_LOG_LINES:]) or "    (empty)"


def _prefixes() -> Iterator[Path]:
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix)


def _ending(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}"
    return f"was killed by {signal.Signals(-code).name}"


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT)
