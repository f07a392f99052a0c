"""The planner node: toolpath segments in, feed-profile chunks out."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

from feedopt_core.errors import FeedoptError, failure_of
from feedopt_core.machine.machine_file import load_machine
from feedopt_core.motion.chunk import Chunk
from feedopt_core.pipeline.warm_up import warm_up_planning
from feedopt_core.planner.stream_planner import PlannerParameters
from feedopt_core.schema import parameter
from feedopt_msgs.msg import NodeStatus, ToolpathSegment
from feedopt_node.conversions import chunk_to_message, machine_to_message, segment_from_message
from feedopt_node.graph_node import GraphNode
from feedopt_node.parameters import MachineNodeParameters
from feedopt_node.run import run_node
from feedopt_node.sequence import SequenceCheck
from feedopt_planner.conversions import chunk_diagnostics
from feedopt_planner.planning_thread import PlanningEvents, PlanningThread

NODE_NAME = "planner"


@dataclass(frozen=True, kw_only=True)
class PlannerNodeParameters(MachineNodeParameters, PlannerParameters):
    """Parameters of the planner node."""

    seconds_ahead: float = parameter(
        # The lower bound is the largest start_ahead_s of the interpolator, which waits for that much before it starts.
        "Largest motion time committed ahead of the interpolator.",
        default=4.0,
        unit="s",
        at_least=1.0,
        at_most=60.0,
    )


class PlannerNode(GraphNode[PlannerNodeParameters]):
    """Passes segments to the planning thread and publishes the committed chunks."""

    def __init__(self) -> None:
        # First load the compiled code: the node must not be READY before.
        warm_up_planning()
        super().__init__(NODE_NAME, PlannerNodeParameters)
        machine = load_machine(self.parameters.machine)
        self._check = SequenceCheck("/toolpath")
        self._last_chunk = 0
        events = PlanningEvents(
            planned=self._planned, path_needed=self.life.report, finished=self._finished, failed=self._failed
        )
        self._planning = PlanningThread(machine, self.parameters, self.parameters.seconds_ahead, events)
        self._chunks = self.publish_topic("/feed_profile")
        self._diagnostics = self.publish_topic("/diagnostics")
        machines = self.publish_topic("/machine")
        message = machine_to_message(machine)
        message.stamp = self.get_clock().now().to_msg()
        machines.publish(message)
        self.subscribe_topic("/toolpath", self._take_segment)
        self.life.on_peer(self._take_status)
        self.life.progress_from(self._progress)
        self._planning.start()

    def close(self) -> None:
        """End the planning thread."""
        self._planning.close()

    def _take_segment(self, message: ToolpathSegment) -> None:
        try:
            if not self._check.accept(message.program_id, message.sequence):
                return
            segment = segment_from_message(message)
        except FeedoptError as error:
            self._planning.abandon(message.program_id)
            self._failed(message.program_id, error)
            return
        if message.sequence == 1:
            self._last_chunk = 0
            self._planning.open(message.program_id)
            self.life.begin_program(message.program_id)
        self._planning.add_segment(segment)

    def _take_status(self, status: NodeStatus) -> None:
        if status.program_id != self._check.program_id:
            return
        if status.state == NodeStatus.FAULT and self._planning.abandon(status.program_id):
            self._check.close()
            self.life.report(state=NodeStatus.DONE, text=f"stopped after a fault of {status.node}")
        elif status.node == "interpolator":
            self._planning.motion_reached(
                status.program_id,
                motion_time_s=status.motion_time_s,
                s_mm=status.s_mm,
                starved_chunk_sequence=status.starved_chunk_sequence,
            )

    def _progress(self) -> dict[str, Any]:
        s_mm, t_s = self._planning.committed
        return {
            "last_input_sequence": self._planning.last_segment_sequence,
            "last_output_sequence": self._last_chunk,
            "s_mm": s_mm,
            "motion_time_s": t_s,
        }

    def _planned(self, program_id: int, chunk: Chunk) -> None:
        now = self.get_clock().now()
        message = chunk_to_message(chunk, program_id)
        message.stamp = now.to_msg()
        self._last_chunk = chunk.sequence
        self._chunks.publish(message)
        self.life.report(state=NodeStatus.RUNNING)
        self._diagnostics.publish(chunk_diagnostics(chunk, now.nanoseconds))

    def _finished(self, program_id: int) -> None:
        self.life.report(state=NodeStatus.DONE)

    def _failed(self, program_id: int, error: Exception) -> None:
        self._check.close()
        failure = failure_of(error)
        self.get_logger().error(f"program {program_id}: {failure}")
        self.life.fail(failure, program_id=program_id)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(PlannerNode))


if __name__ == "__main__":
    main()
