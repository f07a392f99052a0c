"""The interpolator node: receives toolpath and feed profile, publishes one set point a period."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from feedopt_core.errors import Failure, FeedoptError, failure_of
from feedopt_core.machine.machine_file import load_machine
from feedopt_core.motion.setpoints import InterpolatorParameters
from feedopt_core.pipeline.warm_up import warm_up_planning
from feedopt_core.schema import parameter
from feedopt_interpolator.conversions import diagnostics
from feedopt_interpolator.program_motion import ProgramMotion
from feedopt_interpolator.real_time import request_real_time_priority
from feedopt_interpolator.tick_thread import Lateness, TickEvents, TickThread
from feedopt_msgs.msg import FeedProfileChunk, NodeStatus, ToolpathSegment
from feedopt_node.conversions import chunk_from_message, segment_from_message
from feedopt_node.errors import SequenceGapError
from feedopt_node.graph_node import GraphNode
from feedopt_node.parameters import MachineNodeParameters
from feedopt_node.run import run_node
from feedopt_node.sequence import SequenceCheck

NODE_NAME = "interpolator"


@dataclass(frozen=True, kw_only=True)
class InterpolatorNodeParameters(MachineNodeParameters, InterpolatorParameters):
    """Parameters of the interpolator node."""

    start_ahead_s: float = parameter(
        "Motion time that must be committed before the start, unless the program is shorter.",
        default=1.0,
        unit="s",
        at_least=0.0,
        at_most=1.0,
    )
    real_time_priority: int = parameter(
        "SCHED_FIFO priority of the tick thread; if Linux refuses it, the node runs without.",
        default=50,
        at_least=2,
        at_most=99,
    )


class InterpolatorNode(GraphNode[InterpolatorNodeParameters]):
    """Receives segments and chunks of each program in the executor; the tick thread publishes the set points."""

    def __init__(self) -> None:
        # First load the compiled code: the node must not be READY before.
        warm_up_planning()
        super().__init__(NODE_NAME, InterpolatorNodeParameters)
        self._machine = load_machine(self.parameters.machine)
        self._diagnostics = self.publish_topic("/diagnostics")
        self._motion: ProgramMotion | None = None
        self._segments = SequenceCheck("/toolpath")
        self._chunks = SequenceCheck("/feed_profile")
        # Topics whose first message of the current program has arrived; ROS keeps no order between topics.
        self._begun: set[SequenceCheck] = set()
        self._last_chunk = 0
        self._ticks = TickThread(
            self.publish_topic("/axis_setpoint"),
            self._machine.period_s,
            self.parameters.real_time_priority,
            TickEvents(ended=self._ended, failed=self._failed, starved=self._starved),
        )
        self.subscribe_topic("/toolpath", self._take_segment)
        self.subscribe_topic("/feed_profile", self._take_chunk)
        self.life.on_peer(self._take_status)
        self.life.progress_from(self._progress)
        # The executor sometimes holds the interpreter lock. If it were preempted then, it would delay the ticks.
        request_real_time_priority(self.parameters.real_time_priority - 1)
        self._ticks.start()
        if self._ticks.priority_remark:
            self.get_logger().warning(self._ticks.priority_remark)

    def close(self) -> None:
        """End the tick thread."""
        self._ticks.close()

    def _take_segment(self, message: ToolpathSegment) -> None:
        motion = self._accept(message, self._segments)
        if motion is not None:
            self._feed(motion, lambda: motion.add_segment(segment_from_message(message)))

    def _take_chunk(self, message: FeedProfileChunk) -> None:
        motion = self._accept(message, self._chunks)
        if motion is not None:
            self._last_chunk = message.sequence
            self._feed(motion, lambda: motion.add_chunk(chunk_from_message(message)))

    def _accept(self, message: Any, check: SequenceCheck) -> ProgramMotion | None:
        """Motion of the message's program; None if the program has ended or a message was lost."""
        try:
            if not check.accept(message.program_id, message.sequence):
                return None
        except SequenceGapError as error:
            if self._motion is not None and self._motion.program_id == message.program_id:
                self._motion.abandon(failure_of(error))
            else:
                self.life.fail(failure_of(error), program_id=message.program_id)
            return None
        if message.sequence == 1:
            motion = self._motion
            if motion is None or motion.program_id != message.program_id or check in self._begun:
                self._open(message.program_id)
            self._begun.add(check)
        return self._motion

    def _open(self, program_id: int) -> None:
        if self._motion is not None:
            self._motion.abandon()
        self._motion = ProgramMotion(program_id, self._machine, self.parameters, self.parameters.start_ahead_s)
        self._begun = set()
        self._last_chunk = 0
        self.life.begin_program(program_id)
        self._ticks.play(self._motion)

    def _feed(self, motion: ProgramMotion, add: Callable[[], None]) -> None:
        try:
            add()
        except FeedoptError as error:
            motion.abandon(failure_of(error))

    def _take_status(self, status: NodeStatus) -> None:
        """After a fault of any node no further chunk arrives: stop with the last chunk received."""
        motion = self._motion
        if motion is not None and status.state == NodeStatus.FAULT and status.program_id == motion.program_id:
            motion.abandon()

    def _progress(self) -> dict[str, Any]:
        motion = self._motion
        if motion is None:
            return {}
        return {
            "last_input_sequence": self._last_chunk,
            "last_output_sequence": self._ticks.sequence,
            "s_mm": self._ticks.s_mm,
            "motion_time_s": motion.motion_time_s,
            "missed_ticks": self._ticks.missed_ticks,
            "starved_chunk_sequence": motion.starved_chunk_sequence,
        }

    def _starved(self, motion: ProgramMotion) -> None:
        if motion is self._motion:
            self.life.report()

    def _ended(self, motion: ProgramMotion, lateness: Lateness) -> None:
        self._close_program(motion, motion.failure)
        self._diagnostics.publish(diagnostics(lateness.figures(), self.get_clock().now().nanoseconds))

    def _failed(self, motion: ProgramMotion, error: Exception) -> None:
        self._close_program(motion, failure_of(error))

    def _close_program(self, motion: ProgramMotion, failure: Failure | None) -> None:
        if motion is not self._motion:
            return
        self._segments.close()
        self._chunks.close()
        if failure is None:
            self.life.report(state=NodeStatus.DONE, text="")
            return
        self.get_logger().error(f"program {motion.program_id}: {failure}")
        self.life.fail(failure)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(InterpolatorNode))


if __name__ == "__main__":
    main()
