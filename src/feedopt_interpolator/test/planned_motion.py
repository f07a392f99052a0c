"""A planned program for the tests: a short curve on the simulated router, as segments and chunks."""

from __future__ import annotations

from functools import cache

import numpy as np

from feedopt_core.geometry.segments import Segment
from feedopt_core.machine.machine_file import Machine, load_machine
from feedopt_core.motion.chunk import Chunk
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner
from feedopt_core.smoothing.cubic_spline import interpolate_points


def machine() -> Machine:
    return load_machine("router_simulation")


@cache
def planned(commitment_mm: float = 0.0) -> tuple[tuple[Segment, ...], tuple[Chunk, ...]]:
    """Segments and chunks of a 90 mm curve; a small commitment makes many chunks."""
    x_mm = np.linspace(0.0, 90.0, 10)
    points_mm = np.column_stack([x_mm, 4.0 * np.sin(x_mm / 12.0)])
    planner = StreamPlanner(machine(), PlannerParameters(knot_spacing_mm=1.0, commitment_mm=commitment_mm))
    segments, chunks = list(interpolate_points(points_mm, list(range(1, 11)))), list[Chunk]()
    for segment in segments:
        planner.add_segment(segment)
        while (chunk := planner.next_chunk()) is not None:
            chunks.append(chunk)
    return tuple(segments), tuple(chunks)
