"""Time and memory for reading and smoothing programs of many short lines as a stream."""

from __future__ import annotations

import multiprocessing
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from feedopt_core.pipeline.read_program import open_program, read_moves, read_program

_KILOBYTES_A_MEGABYTE = 1024.0


@dataclass(frozen=True)
class ReadingFigures:
    """One program read as a stream.

    Attributes:
        lines: number of lines of the program.
        parse_s: processor time from the file to moves.
        whole_s: processor time from the file to segments.
        first_segment_s: processor time until the first segment.
        segments: number of segments.
        memory_mb: largest resident memory of the process; ``start_mb``: before reading.
    """

    lines: int
    parse_s: float
    whole_s: float
    first_segment_s: float
    segments: int
    memory_mb: float
    start_mb: float


def measure_reading(path: Path, warm_up: Path, tolerance_mm: float) -> ReadingFigures:
    """Read a program in a separate process, after a small program that loads the compiled code."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_measure, (path, warm_up, tolerance_mm))


def _measure(path: Path, warm_up: Path, tolerance_mm: float) -> ReadingFigures:
    deque(read_program(open_program(warm_up), str(warm_up), 2, tolerance_mm), maxlen=0)
    start_mb = _peak_mb()
    began_s = time.process_time()
    first_s, segments = 0.0, 0
    for _ in read_program(open_program(path), str(path), 2, tolerance_mm):
        first_s = first_s or time.process_time() - began_s
        segments += 1
    whole_s, memory_mb = time.process_time() - began_s, _peak_mb()
    began_s = time.process_time()
    deque(read_moves(open_program(path), str(path)), maxlen=0)
    parse_s = time.process_time() - began_s
    with path.open("rb") as file:
        lines = sum(1 for _ in file)
    return ReadingFigures(lines, parse_s, whole_s, first_s, segments, memory_mb, start_mb)


def _peak_mb() -> float:
    """Largest resident memory of this process; ``getrusage`` would include that of the parent before the fork."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) / _KILOBYTES_A_MEGABYTE
