"""Records every topic of the graph, raw, until it is told to stop.

The subscriptions are drained by polling, in a thread of their own: at 1 kHz on several topics, waking the executor for
every message costs a third of a core, a timer of the executor every 10 ms a fifth, the thread a few hundredths. The
status of the node itself is done there too, so that the executor has nothing to wake up for.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.subscription import Subscription

from feedopt_core.errors import Failure, failure_of
from feedopt_node.graph_node import GraphNode
from feedopt_node.polling import PollingThread
from feedopt_node.private_rclpy import PolledGroup, take_all
from feedopt_node.run import EXIT_FAILURE, EXIT_OK, run_node
from feedopt_recorder.bag_writer import BagWriter, Received
from feedopt_recorder.errors import BagWriteError
from feedopt_recorder.message_schemas import MessageSchemas, ament_share_directories
from feedopt_recorder.parameters import RecorderParameters
from feedopt_recorder.provenance import read_provenance, versions
from feedopt_recorder.run_folder import SUMMARY_NAME
from feedopt_recorder.sequence_watch import RecorderSummary, SequenceWatch, has_identity

NODE_NAME = "recorder"
_GAPS_PRINTED = 5
# What comes while the disk or another process holds the recorder up waits here: topics for display keep ten alone.
_QUEUE_DEPTH = 1000


@dataclass(frozen=True)
class _Tap:
    """One recorded topic."""

    subscription: Subscription
    watch: SequenceWatch


class RecorderNode(GraphNode[RecorderParameters]):
    """Writes every topic it is given by the graph into one bag."""

    def __init__(self) -> None:
        super().__init__(NODE_NAME, RecorderParameters, polled=True)
        schemas = MessageSchemas(ament_share_directories())
        provenance = self.parameters.provenance_file
        topics = self.graph.subscriptions(self.get_name())
        self.failure: Failure | None = None
        self._writer = BagWriter(
            self.parameters.directory(),
            topics,
            schemas,
            provenance=read_provenance(Path(provenance)) if provenance else {"feedopt/versions": versions()},
            flush_interval_s=self.parameters.flush_interval_s,
        )
        self._start_s, self._start_cpu_s = time.monotonic(), time.process_time()
        group = PolledGroup()
        self._taps = [
            _Tap(
                self.subscribe_topic(topic.name, self._never_called, raw=True, group=group, depth=_QUEUE_DEPTH),
                SequenceWatch(
                    topic.name,
                    identified=has_identity(schemas.schema(topic.type)),
                    numbered=len(set(topic.publishers) & set(self.life.present)) == 1,
                ),
            )
            for topic in topics
        ]
        self._polling = PollingThread("record", self.parameters.poll_interval_s, self._record, self._stop_recording)
        self._polling.start()

    def close(self) -> None:
        """Drain what is left and finish the bag; what it recorded and missed goes into it and beside it."""
        self._polling.close()
        try:
            self._drain()
            self._writer.close({"feedopt/recorder": {"summary": json.dumps(self._summary().as_document())}})
        except BagWriteError as error:
            self._fail(failure_of(error))
        summary = self._summary()
        (self._writer.directory / SUMMARY_NAME).write_text(
            json.dumps(summary.as_document(), indent=1), encoding="utf-8"
        )
        for gap in summary.gaps[:_GAPS_PRINTED]:
            program = f"program {gap.program_id}: " if gap.program_id else ""
            self._say(f"{gap.topic}: {program}messages {gap.first} to {gap.last} are missing")

    def _record(self) -> None:
        self.life.poll()
        self._drain()
        self._writer.flush_if_due()

    def _stop_recording(self, error: Exception) -> None:
        failure = failure_of(error)
        self._fail(failure)
        self.life.fail(failure)

    def _drain(self) -> None:
        batch = []
        for tap in self._taps:
            watch = tap.watch
            for payload, info in take_all(tap.subscription, raw=True):
                number = info["publication_sequence_number"] or 0
                watch.add(payload, number)
                batch.append(
                    Received(info["received_timestamp"], info["source_timestamp"], watch.topic, payload, number)
                )
        batch.sort()
        self._writer.write(batch)

    def _summary(self) -> RecorderSummary:
        duration_s = time.monotonic() - self._start_s
        return RecorderSummary(
            topics={tap.watch.topic: tap.watch.count for tap in self._taps},
            gaps=tuple(gap for tap in self._taps for gap in tap.watch.gaps),
            duration_s=duration_s,
            cpu_share_ratio=(time.process_time() - self._start_cpu_s) / duration_s,
            failure=str(self.failure or ""),
        )

    def _fail(self, failure: Failure) -> None:
        self.failure = failure
        self._say(str(failure))

    def _say(self, text: str) -> None:
        # Not the node's logger: at the end ROS is shut down already.
        sys.stderr.write(f"{self.get_name()}: {text}\n")

    def _never_called(self, message: Any) -> None:
        raise AssertionError("the executor took a message that the recorder polls for")


def main() -> None:
    """Run the node; exit code 1 when the bag could not be written to its end."""
    nodes: list[RecorderNode] = []

    def make() -> RecorderNode:
        nodes.append(RecorderNode())
        return nodes[0]

    code = run_node(make)
    failed = code == EXIT_OK and any(node.failure for node in nodes)
    sys.exit(EXIT_FAILURE if failed else code)


if __name__ == "__main__":
    main()
