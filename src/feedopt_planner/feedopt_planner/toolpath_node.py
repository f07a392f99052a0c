"""The toolpath node: serves the action, reads a program and streams the segments of the smoothed toolpath."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup

from feedopt_core.errors import Failure, FailureKind, failure_of
from feedopt_core.geometry.segments import Segment
from feedopt_core.machine.machine_file import load_machine
from feedopt_core.pipeline.read_program import Program, open_program, read_program
from feedopt_core.pipeline.warm_up import warm_up_reading
from feedopt_core.programs.layers.transitions import LayerTransitions
from feedopt_core.schema import parameter
from feedopt_core.smoothing.cubic_spline import DEFAULT_TOLERANCE_MM
from feedopt_msgs.action import ExecuteProgram
from feedopt_msgs.msg import NodeStatus, ProgramLines
from feedopt_node.conversions import segment_to_message
from feedopt_node.failure_conversions import failure_of_status, failure_to_message
from feedopt_node.graph_node import GraphNode
from feedopt_node.parameters import MachineNodeParameters
from feedopt_node.run import run_node
from feedopt_planner.conversions import DisplayPath
from feedopt_planner.line_inbox import LineInbox

NODE_NAME = "toolpath"
ACTION = "/execute_program"
# Statuses of the other nodes wake the waiting program; this period is only for the checks for silence and shutdown.
WAIT_PERIOD_S = 0.1
# One thread streams the program, one receives statuses, one answers the client.
THREADS = 3

Result: TypeAlias = ExecuteProgram.Result


@dataclass(frozen=True, kw_only=True)
class ToolpathNodeParameters(MachineNodeParameters):
    """Parameters of the toolpath node."""

    segments_ahead: int = parameter(
        "Segments published ahead of the last one that the planner has used.", default=200, at_least=1, at_most=900
    )
    tolerance_mm: float = parameter(
        "Largest distance between smoothed and programmed path, if the goal gives none.",
        default=DEFAULT_TOLERANCE_MM,
        unit="mm",
        at_least=1e-6,
        at_most=10.0,
    )
    display_spacing_mm: float = parameter(
        "Distance between the points of the displayed path.", default=0.5, unit="mm", at_least=1e-3, at_most=1e3
    )


class ProgramStopped(Exception):  # noqa: N818 (an outcome, not an error)
    """The program ends early; ``failure`` is the cause."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(str(failure))
        self.failure = failure


@dataclass
class RunningProgram:
    """The program being executed."""

    goal: ServerGoalHandle
    display: DisplayPath
    lines: LineInbox
    program_id: int = 0
    segments: int = 0
    s_mm: float = 0.0
    failure: Failure | None = None


class ToolpathNode(GraphNode[ToolpathNodeParameters]):
    """Executes one program at a time."""

    def __init__(self) -> None:
        # First load the compiled code: the node must not be READY before.
        warm_up_reading()
        super().__init__(NODE_NAME, ToolpathNodeParameters)
        self._dimensions = load_machine(self.parameters.machine).dimensions
        self._changed = threading.Condition()
        self._running: RunningProgram | None = None
        self._accepted = False
        self._lines = LineInbox()
        self._closing = False
        self._segments = self.publish_topic("/toolpath")
        self._display = self.publish_topic("/toolpath_display")
        self.subscribe_topic("/program_lines", self._take_lines)
        self.life.on_peer(self._take_status)
        self.life.progress_from(self._progress)
        self._action = ActionServer(
            self,
            ExecuteProgram,
            ACTION,
            execute_callback=self._execute,
            goal_callback=self._take_goal,
            cancel_callback=self._take_cancel,
            callback_group=ReentrantCallbackGroup(),
        )

    def close(self) -> None:
        """End a running program at once."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()

    def _take_goal(self, request: ExecuteProgram.Goal) -> GoalResponse:
        with self._changed:
            if self._accepted:
                self.get_logger().warning("goal refused: another program is being executed")
                return GoalResponse.REJECT
            self._accepted = True
            # Made now, because the sender starts as soon as the goal is accepted.
            self._lines = LineInbox()
        return GoalResponse.ACCEPT

    def _take_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        with self._changed:
            self._changed.notify_all()
        return CancelResponse.ACCEPT

    def _execute(self, goal: ServerGoalHandle) -> Result:
        run = RunningProgram(goal, DisplayPath(self.parameters.display_spacing_mm), self._lines)
        try:
            result = self._run(run)
        finally:
            with self._changed:
                self._accepted = False
                self._running = None
        result.program_id = run.program_id
        result.segments = run.segments
        result.path_length_mm = run.s_mm
        # The planned motion time or, if the program ended early, the motion time reached.
        timekeeper = "interpolator" if result.failure.kind else "planner"
        result.motion_time_s = float(self._peer_value(timekeeper, run, "motion_time_s"))
        return result

    def _run(self, run: RunningProgram) -> Result:
        """Stream the program and wait for its end; the cause of an early end becomes the result."""
        try:
            # The nodes become READY one after the other; an early goal waits for the last of them.
            self._wait(run, lambda: self.life.peers_ready() is None)
            run.program_id = self._next_program_id()
            with self._changed:
                self._running = run
            self.life.begin_program(run.program_id)
            for segment in self._read(run):
                self._wait(run, lambda: self._may_publish(run))
                self._publish(run, segment)
            self._display.publish(run.display.to_message(self.get_clock().now().nanoseconds))
            self._wait(run, lambda: self._motion_over(run))
        except ProgramStopped as stop:
            failure = stop.failure
        except Exception as error:  # noqa: BLE001 (after any error the machine stops and the client gets the failure)
            failure = replace(failure_of(error), node=NODE_NAME)
            if failure.kind is FailureKind.INTERNAL:
                self.get_logger().error(traceback.format_exc())
        else:
            self.life.report(state=NodeStatus.DONE)
            run.goal.succeed()
            return Result()
        self.get_logger().warning(f"program {run.program_id}: {failure}")
        # For the other nodes this is the end of the stream; the interpolator stops on the path.
        self.life.fail(failure)
        self._wait_for_standstill(run)
        if self.context.ok():
            (run.goal.canceled if failure.kind is FailureKind.CANCELED else run.goal.abort)()
        return Result(failure=failure_to_message(failure))

    def _read(self, run: RunningProgram) -> Iterator[Segment]:
        request = run.goal.request
        tolerance_mm = request.tolerance_mm or self.parameters.tolerance_mm
        if request.streamed:
            program, source = Program.from_lines(self._streamed_lines(run), request.name), "/program_lines"
        elif request.path:
            program, source = open_program(Path(request.path)), request.path
        else:
            program, source = Program.from_text(request.text, request.name), "program text"
        transitions = LayerTransitions.requested(request.transition_reach_mm, request.transition_side)
        return read_program(program, request.name or source, self._dimensions, tolerance_mm, transitions)

    def _streamed_lines(self, run: RunningProgram) -> Iterator[str | None]:
        """Lines as they arrive; None before each wait. Raises ProgramStopped, and ToolpathError if lines were lost."""
        while True:
            with self._changed:
                waiting = not run.lines.ready
            if waiting:
                yield None
            self._wait(run, lambda: run.lines.ready)
            with self._changed:
                lines = run.lines.take()
            if lines is None:
                return
            yield from lines
            self.life.report()

    def _publish(self, run: RunningProgram, segment: Segment) -> None:
        message = segment_to_message(segment, run.program_id)
        message.stamp = self.get_clock().now().to_msg()
        self._segments.publish(message)
        run.segments = segment.place.sequence
        run.s_mm = segment.place.s_start_mm + segment.length_mm
        run.display.add(segment)

    def _wait(self, run: RunningProgram, condition: Any) -> None:
        """Wait for a condition that depends on statuses of other nodes. Raises ProgramStopped."""
        with self._changed:
            while True:
                failure = self._failure(run)
                if failure is not None:
                    raise ProgramStopped(failure)
                if condition():
                    return
                self._changed.wait(WAIT_PERIOD_S)

    def _failure(self, run: RunningProgram) -> Failure | None:
        """Failure outside this node, shutdown or cancellation that ends the program; None: none of them."""
        if run.failure is not None:
            return run.failure
        if run.goal.is_cancel_requested:
            return Failure(kind=FailureKind.CANCELED, message="canceled by the client")
        silent = self.life.silent_peer()
        if silent is not None:
            message = "no longer publishes its status; see its log for the cause"
            return Failure(kind=FailureKind.SILENT_PEER, node=silent, message=message)
        if self._closing:
            return Failure(kind=FailureKind.NODE_DIED, node=NODE_NAME, message="was shut down")
        return None

    def _wait_for_standstill(self, run: RunningProgram) -> None:
        """After an early end, wait until the machine is at standstill, or until a node that reports it is silent."""
        with self._changed:
            while run.segments and not (self._motion_over(run) or self.life.silent_peer() or self._closing):
                self._changed.wait(WAIT_PERIOD_S)

    def _may_publish(self, run: RunningProgram) -> bool:
        taken = self._peer_value("planner", run, "last_input_sequence")
        return run.segments < taken + self.parameters.segments_ahead

    def _motion_over(self, run: RunningProgram) -> bool:
        """Whether the interpolator has ended the program and the router has executed its last set point."""
        interpolator = self._peer("interpolator", run)
        if interpolator is None or interpolator.state not in (NodeStatus.DONE, NodeStatus.FAULT):
            return False
        nothing_moves = interpolator.state == NodeStatus.FAULT or interpolator.last_output_sequence == 0
        if nothing_moves or "router_sim" not in self.life.present:
            return True
        router = self._peer("router_sim", run)
        return router is not None and router.state in (NodeStatus.DONE, NodeStatus.FAULT)

    def _take_lines(self, message: ProgramLines) -> None:
        with self._changed:
            if self._accepted:
                self._lines.put(message.sequence, message.lines, last=message.last)
                self._changed.notify_all()

    def _take_status(self, status: NodeStatus) -> None:
        with self._changed:
            run = self._running
            if run is None or status.program_id != run.program_id:
                return
            failure = failure_of_status(status)
            if failure is not None and run.failure is None:
                run.failure = replace(failure, node=str(status.node))
            self._changed.notify_all()
            if run.goal.is_active:
                self._send_feedback(run)

    def _send_feedback(self, run: RunningProgram) -> None:
        run.goal.publish_feedback(
            ExecuteProgram.Feedback(
                program_id=run.program_id,
                segments_published=run.segments,
                s_published_mm=run.s_mm,
                s_committed_mm=float(self._peer_value("planner", run, "s_mm")),
                s_commanded_mm=float(self._peer_value("interpolator", run, "s_mm")),
                motion_time_s=float(self._peer_value("interpolator", run, "motion_time_s")),
            )
        )

    def _next_program_id(self) -> int:
        """Number above every number that a node reports, because this node may have been restarted."""
        statuses = [self.life.peers.get(name) for name in self.life.present]
        return 1 + max([self.life.program_id, *(int(status.program_id) for status in statuses if status is not None)])

    def _peer(self, name: str, run: RunningProgram) -> NodeStatus | None:
        status = self.life.peers.get(name)
        return status if status is not None and status.program_id == run.program_id else None

    def _peer_value(self, name: str, run: RunningProgram, value: str) -> Any:
        """A value of another node's status; 0 if that status does not belong to the program."""
        status = self._peer(name, run)
        return 0 if status is None else getattr(status, value)

    def _progress(self) -> dict[str, Any]:
        run = self._running
        if run is None:
            return {}
        return {
            "last_input_sequence": run.lines.sequence,
            "last_output_sequence": run.segments,
            "s_mm": run.s_mm,
        }


def main() -> None:
    """Run the node."""
    sys.exit(run_node(ToolpathNode, threads=THREADS))


if __name__ == "__main__":
    main()
