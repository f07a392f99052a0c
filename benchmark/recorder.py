"""Processor time of the recorder at four 1 kHz topics, and data lost when it is killed.

Run: ``./feedopt bench recorder [--seconds N] [--kills N] [--seed N]``. A recorder in a separate process records four
topics of axis states at 1 kHz: once to the normal end, for its processor time; then ``--kills`` times until a kill at a
random instant, for the data missing in the repaired bag.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.table import Table
from rosbags.highlevel import AnyReader

from feedopt_node.graph import load_graph
from feedopt_recorder.bags.repair import repair_bag
from feedopt_recorder.run_folder import SUMMARY_NAME

TOPICS = tuple(f"/load_{number}" for number in range(1, 5))
PERIOD_S = 0.001
TYPE = "feedopt_msgs/msg/AxisState"
SETTLE_S = 1.0
LOST_AT_MOST_S = 0.5
BURST_S = 0.1
# Larger than the header of a file without messages.
STARTED_BYTES = 10_000


def main(argv: list[str]) -> int:
    """Command line; returns the exit code: 0 if no message was missed and no kill lost more than 0.5 s, else 1."""
    parser = argparse.ArgumentParser(prog="feedopt bench recorder", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="length of the recording that runs to its end")
    parser.add_argument("--kills", type=int, default=20, help="recordings that are killed")
    parser.add_argument("--seed", type=int, default=0, help="of the instants of the kills")
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory(prefix="feedopt-recorder-") as folder:
        root = Path(folder)
        prefix = write_graph(root / "prefix")
        with _source() as source:
            summary = record(source, prefix, root / "whole", arguments.seconds)
        instants = random.Random(arguments.seed)
        lost_s = [
            lost_by_kill(prefix, root / f"killed_{number}", instants.uniform(0.2, 3.0))
            for number in range(arguments.kills)
        ]
    counts = {name: topic["messages"] for name, topic in summary["topics"].items() if name in TOPICS}
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_row("messages", f"{sum(counts.values())} on {len(counts)} topics at {1 / PERIOD_S:.0f} Hz")
    table.add_row("complete", "yes" if summary["complete"] else f"no: {summary['gaps']}")
    table.add_row("recorder", f"{100.0 * summary['cpu_share_ratio']:.1f} % of a core")
    if lost_s:
        table.add_row("killed", f"{len(lost_s)} times, all bags readable after the repair")
        table.add_row("lost at most", f"{max(lost_s):.3f} s")
        table.add_row("lost on average", f"{sum(lost_s) / len(lost_s):.3f} s")
    table.add_row("load", f"{os.getloadavg()[0]:.2f}")
    Console().print(table)
    return 0 if summary["complete"] and max(lost_s, default=0.0) <= LOST_AT_MOST_S else 1


def write_graph(prefix: Path) -> Path:
    """Write a graph of one source and the recorder, in the layout of an installed workspace."""
    qos = {"reliability": "reliable", "durability": "volatile", "depth": 4000}
    names = ["source", "recorder"]
    document = {
        "qos": {"evidence": qos},
        "topics": {
            **{name: {"type": TYPE, "from": ["source"], "to": ["recorder"], "qos": "evidence"} for name in TOPICS},
            "/status": {"type": "feedopt_msgs/msg/NodeStatus", "from": names, "to": names, "qos": "evidence"},
        },
        "actions": {},
        "nodes": {
            name: {"package": "feedopt_tools", "executable": f"{name}_node", "parameters": "nodes/recorder.yaml"}
            for name in names
        },
    }
    path = prefix / "share" / "feedopt_config" / "graph.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    load_graph(path)
    return prefix


def start_recorder(prefix: Path, bag: Path) -> subprocess.Popen[str]:
    """Start a recorder of that graph."""
    command = [sys.executable, "-m", "feedopt_recorder.recorder_node", "--ros-args"]
    command += ["-p", "present_nodes:=[recorder]", "-p", f"bag_directory:={bag}"]
    environment = os.environ | {"AMENT_PREFIX_PATH": f"{prefix}{os.pathsep}{os.environ['AMENT_PREFIX_PATH']}"}
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)


def record(source: Source, prefix: Path, bag: Path, seconds: float) -> dict[str, Any]:
    """Record for ``seconds`` and end normally; returns the recorder's summary."""
    process = start_recorder(prefix, bag)
    try:
        source.wait_matched()
        source.publish_for(seconds)
        time.sleep(SETTLE_S)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate()
    finally:
        process.kill()
        process.wait()
    if process.returncode:
        raise RuntimeError(f"the recorder ended with exit code {process.returncode}: {errors}")
    summary: dict[str, Any] = json.loads((bag / SUMMARY_NAME).read_text(encoding="utf-8"))
    return summary


def lost_by_kill(prefix: Path, bag: Path, after_s: float) -> float:
    """Kill a recorder and repair its bag; returns the time between the last sent and the last recorded message, s."""
    path = bag / f"{bag.name}_0.mcap"
    # A new source, because an older one would count the recorder killed before as a subscription for some time.
    with _source() as source:
        process = start_recorder(prefix, bag)
        try:
            source.wait_matched()
            # The start is not measured: the time counts from the first chunk in the file.
            while not path.is_file() or path.stat().st_size < STARTED_BYTES:
                source.publish_for(BURST_S)
            source.publish_for(after_s)
        finally:
            process.kill()
            killed_ns = time.time_ns()
            process.communicate()
    repair_bag(bag)
    with AnyReader([bag]) as reader:
        newest_ns = max(time_ns for _, time_ns, _ in reader.messages())
    return (killed_ns - newest_ns) * 1e-9


class Source:
    """Publishes axis states of three axes on every topic, one per millisecond."""

    def __init__(self) -> None:
        import rclpy

        from feedopt_msgs.msg import AxisState
        from feedopt_node.graph import Qos
        from feedopt_node.qos import qos_profile

        rclpy.init(args=[])
        self._node = rclpy.create_node("source", enable_rosout=False, start_parameter_services=False)
        profile = qos_profile(Qos("evidence", "reliable", "volatile", 4000))
        self._publishers = [self._node.create_publisher(AxisState, name, profile) for name in TOPICS]
        values, flags = [0.1, 0.2, 0.3], [False] * 3
        self._message = AxisState(
            reference_mm=values,
            position_mm=values,
            velocity_mm_s=values,
            tracking_error_mm=values,
            control_signal_volts=values,
            saturated=flags,
        )
        self._program_id = 0

    def wait_matched(self) -> None:
        """Wait for the recorder."""
        while any(publisher.get_subscription_count() != 1 for publisher in self._publishers):
            time.sleep(0.01)
        time.sleep(SETTLE_S)

    def publish_for(self, seconds: float) -> None:
        """Publish one program of this duration."""
        self._program_id += 1
        message = self._message
        message.program_id = self._program_id
        began_s = time.monotonic()
        for tick in range(round(seconds / PERIOD_S)):
            time.sleep(max(0.0, began_s + tick * PERIOD_S - time.monotonic()))
            message.sequence = message.setpoint_sequence = tick + 1
            message.tick = tick
            for publisher in self._publishers:
                publisher.publish(message)

    def close(self) -> None:
        """Leave the domain."""
        import rclpy

        self._node.destroy_node()
        rclpy.try_shutdown()


@contextmanager
def _source() -> Iterator[Source]:
    source = Source()
    try:
        yield source
    finally:
        source.close()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
