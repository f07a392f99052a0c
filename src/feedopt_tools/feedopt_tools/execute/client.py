"""The command's own node: hears every status, sends the goal, follows it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from feedopt_core.errors import Failure
from feedopt_msgs.action import ExecuteProgram
from feedopt_msgs.msg import NodeStatus, ProgramLines
from feedopt_node.failure_conversions import failure_from_message
from feedopt_node.graph import load_graph
from feedopt_node.qos import qos_profile
from feedopt_node.status import READY_STATES, STATUS_TOPIC
from feedopt_tools.errors import GoalRefusedError, GraphNotReadyError
from feedopt_tools.execute.line_sender import LineSender

ACTION = "/execute_program"
LINES_TOPIC = "/program_lines"
READY_PATIENCE_S = 60.0
_SPIN_S = 0.05


@dataclass(frozen=True)
class ProgramRequest:
    """One program to execute: a file, or its text with a name; tolerance 0: as in config/nodes/toolpath.yaml.

    ``streamed``: the toolpath node gets the lines of the file one after the other instead of its path.
    ``transition_reach_mm``, ``transition_side``: see ``LayerTransitions.requested`` in
    :mod:`feedopt_core.programs.layers.transitions`.
    """

    name: str
    path: Path | None = None
    text: str = ""
    tolerance_mm: float = 0.0
    streamed: bool = False
    transition_reach_mm: float = 0.0
    transition_side: str = ""

    def lines(self) -> Iterator[str]:
        """The program's lines, read as they are asked for. Raises OSError."""
        if self.path is None:
            yield from self.text.splitlines()
        else:
            with self.path.open(encoding="utf-8", errors="replace") as file:
                yield from (line.rstrip("\r\n") for line in file)


@dataclass
class Progress:
    """How far a program is, in mm of arc length and s of motion."""

    s_published_mm: float = 0.0
    s_committed_mm: float = 0.0
    s_commanded_mm: float = 0.0
    motion_time_s: float = 0.0


@dataclass(frozen=True)
class ProgramOutcome:
    """Answer of the toolpath node; the fields are those of the action's result. ``failure`` None: it succeeded."""

    failure: Failure | None
    program_id: int
    segments: int
    path_length_mm: float
    motion_time_s: float

    @property
    def succeeded(self) -> bool:
        """The program was executed to its end."""
        return self.failure is None


@dataclass
class GraphClient:
    """Talks to a running graph.

    Args:
        nodes: names of the nodes that must be ready.
        watch: called all the time while waiting; raises to give up.
    """

    nodes: Sequence[str]
    watch: Callable[[], None]
    statuses: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Signals stay Python's: ctrl-C stops the program before the processes.
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("feedopt_command", enable_rosout=False, start_parameter_services=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._topics = load_graph().topics
        qos = qos_profile(self._topics[STATUS_TOPIC].qos)
        self._node.create_subscription(NodeStatus, STATUS_TOPIC, self._take_status, qos)
        self._lines: Any = None
        self._sender: LineSender | None = None
        self._action = ActionClient(self._node, ExecuteProgram, ACTION)
        self._goal: Any = None
        self._progress = Progress()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def wait_ready(self) -> None:
        """Wait until every node has said READY.

        Raises:
            GraphNotReadyError: not in time.
        """
        until_s = time.monotonic() + READY_PATIENCE_S
        while waiting := [name for name in self.nodes if not self._ready(name)]:
            self._spin()
            if time.monotonic() > until_s:
                names = ", ".join(waiting)
                raise GraphNotReadyError(f"not ready after {READY_PATIENCE_S:g} s: {names}; see their logs")
        while not self._action.server_is_ready():
            self._spin()
            if time.monotonic() > until_s:
                raise GraphNotReadyError(f"the action {ACTION} did not appear within {READY_PATIENCE_S:g} s")

    def send(self, request: ProgramRequest) -> None:
        """Send a program to be executed; returns when it is accepted.

        Raises:
            GoalRefusedError: the toolpath node is busy or not ready.
            GraphNotReadyError: a streamed program finds no reader.
        """
        goal = ExecuteProgram.Goal(
            tolerance_mm=request.tolerance_mm,
            path=str(request.path.absolute()) if request.path and not request.streamed else "",
            text="" if request.streamed else request.text,
            name=request.name,
            streamed=request.streamed,
            transition_reach_mm=request.transition_reach_mm,
            transition_side=request.transition_side,
        )
        self._sender = self._line_sender(request) if request.streamed else None
        self._goal, self._progress = None, Progress()
        accepted = self._action.send_goal_async(goal, feedback_callback=self._take_feedback)
        while not accepted.done():
            self._spin()
        if not accepted.result().accepted:
            raise GoalRefusedError("the toolpath node refused the goal: another program is being executed")
        self._goal = accepted.result()

    def follow(self, on_progress: Callable[[Progress], None]) -> ProgramOutcome:
        """Wait for the end of the program that is being executed; ``on_progress`` is called all the time."""
        answer = self._goal.get_result_async()
        while not answer.done():
            self._send_lines()
            self._spin()
            on_progress(self._progress)
        result = answer.result().result
        return ProgramOutcome(
            failure=failure_from_message(result.failure),
            program_id=result.program_id,
            segments=result.segments,
            path_length_mm=result.path_length_mm,
            motion_time_s=result.motion_time_s,
        )

    def cancel(self) -> None:
        """Ask for a stop on the path."""
        self._goal.cancel_goal_async()

    def _line_sender(self, request: ProgramRequest) -> LineSender:
        """Publisher of the program's lines, once everyone listens: what is published before is lost."""
        topic = self._topics[LINES_TOPIC]
        if self._lines is None:
            self._lines = self._node.create_publisher(ProgramLines, LINES_TOPIC, qos_profile(topic.qos))
        expected = sum(name in self.nodes for name in topic.subscribers)
        until_s = time.monotonic() + READY_PATIENCE_S
        while self._lines.get_subscription_count() < expected:
            self._spin()
            if time.monotonic() > until_s:
                raise GraphNotReadyError(f"{LINES_TOPIC} found no reader within {READY_PATIENCE_S:g} s")

        def publish(sequence: int, lines: list[str], last: bool) -> None:
            stamp = self._node.get_clock().now().to_msg()
            self._lines.publish(ProgramLines(stamp=stamp, sequence=sequence, lines=lines, last=last))

        return LineSender(request.lines(), publish)

    def _send_lines(self) -> None:
        if self._sender is not None:
            status = self.statuses.get("toolpath")
            taken = 0
            if status is not None and status.state == NodeStatus.RUNNING:
                taken = int(status.last_input_sequence)
            self._sender.send(taken)

    def _ready(self, name: str) -> bool:
        status = self.statuses.get(name)
        return status is not None and status.state in READY_STATES

    def _spin(self) -> None:
        self._executor.spin_once(timeout_sec=_SPIN_S)
        self.watch()

    def _take_status(self, status: NodeStatus) -> None:
        self.statuses[status.node] = status

    def _take_feedback(self, message: Any) -> None:
        feedback = message.feedback
        self._progress = Progress(
            feedback.s_published_mm, feedback.s_committed_mm, feedback.s_commanded_mm, feedback.motion_time_s
        )
