"""Processor time of the recorder's MCAP writer beside that of the mcap package, for the same messages.

Run: ``./feedopt bench mcap_writer [--messages N] [--runs N]``. Messages of 200 bytes on four topics go to memory, in
chunks of the same size and compression. Figures are reported, never judged.
"""

from __future__ import annotations

import argparse
import io
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from mcap.writer import CompressionType, Writer
from rich.console import Console
from rich.table import Table

from feedopt_recorder.mcap_writer import CHUNK_BYTES, McapWriter

_TOPICS = 4
_RATE_HZ = 4000
_DEFINITION = "float64[] values"
_START_NS, _STEP_NS = 10**18, 1_000_000_000 // _RATE_HZ
Payloads = list[bytes]


def main(argv: list[str]) -> int:
    """Command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="feedopt bench mcap_writer", description=(__doc__ or "").partition("\n")[0], add_help=True
    )
    parser.add_argument("--messages", type=int, default=400_000, help="messages a run")
    parser.add_argument("--runs", type=int, default=3, help="runs of each writer, one after the other")
    arguments = parser.parse_args(argv)
    payloads = _payloads(2000)
    writers: dict[str, Callable[[Payloads, int], int]] = {"recorder": write_own, "mcap package": write_by_package}
    times_s: dict[str, list[float]] = {name: [] for name in writers}
    sizes: dict[str, int] = {}
    for _ in range(arguments.runs):
        for name, write in writers.items():
            began_s = time.process_time()
            sizes[name] = write(payloads, arguments.messages)
            times_s[name].append(time.process_time() - began_s)
    table = Table("writer", "a message, us", f"of a core at {_RATE_HZ} messages a second, %", "file, bytes")
    for name, taken_s in times_s.items():
        message_s = statistics.median(taken_s) / arguments.messages
        table.add_row(name, f"{1e6 * message_s:.2f}", f"{100.0 * message_s * _RATE_HZ:.2f}", str(sizes[name]))
    Console(width=None if sys.stdout.isatty() else 120).print(table)
    return 0


def write_own(payloads: Payloads, count: int) -> int:
    """Write messages with the recorder's writer; returns the length of the file."""
    sink = io.BytesIO()
    writer = McapWriter(sink, "benchmark")
    schema = writer.add_schema("bench/msg/Values", _DEFINITION)
    channels = [writer.add_channel(f"/topic_{i}", schema, {}) for i in range(_TOPICS)]
    for i in range(count):
        at_ns = _START_NS + _STEP_NS * i
        writer.add_message(channels[i % _TOPICS], payloads[i % len(payloads)], at_ns, at_ns, i)
    writer.finish()
    return sink.tell()


def write_by_package(payloads: Payloads, count: int) -> int:
    """Write the same messages with the writer of the mcap package; returns the length of the file."""
    sink = io.BytesIO()
    writer = Writer(sink, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
    writer.start("ros2", "benchmark")
    schema = writer.register_schema("bench/msg/Values", "ros2msg", _DEFINITION.encode())
    channels = [writer.register_channel(f"/topic_{i}", "cdr", schema) for i in range(_TOPICS)]
    for i in range(count):
        at_ns = _START_NS + _STEP_NS * i
        writer.add_message(channels[i % _TOPICS], at_ns, payloads[i % len(payloads)], at_ns, i)
    writer.finish()  # type: ignore[no-untyped-call]
    return sink.tell()


def _payloads(count: int) -> Payloads:
    """CDR headers with 24 numbers that change as positions do, the same in every run."""
    values = np.cumsum(np.random.default_rng(1).normal(size=(count, 24)), axis=1)
    return [b"\x00\x01\x00\x00" + row.tobytes() for row in values]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
