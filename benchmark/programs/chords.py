"""The fan contour as a program of chords, and the smooth curve for comparison."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.config_files import find_config
from feedopt_core.geometry.segments import Segment
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.programs.points_csv import read_points
from feedopt_core.smoothing.cubic_spline import interpolate_points

_FEED_MM_MIN = 60_000
"""Above every limit of these machines, so that only the machine limits apply."""


def fan_contour() -> tuple[Segment, ...]:
    """The C2 spline through the points of the fan contour, moved to start at the origin."""
    path = find_config("programs", "fan_contour", ".csv")
    with path.open(encoding="utf-8") as file:
        points_mm = read_points(file, str(path)).points_mm
    return tuple(interpolate_points(points_mm - points_mm[0], list(range(1, len(points_mm) + 1))))


def sampled(segments: tuple[Segment, ...], chord_mm: float) -> FloatArray:
    """Points on a path, equal arc lengths apart, shape (n, 2)."""
    toolpath = Toolpath()
    for segment in segments:
        toolpath.append(segment)
    return toolpath.evaluate(np.linspace(0.0, toolpath.end_mm, round(toolpath.end_mm / chord_mm) + 1)).r_mm


def write_chords(path: Path, points_mm: FloatArray, decimals: int, laps: int = 1) -> None:
    """Write a program that follows points, some laps of a closed contour."""
    lines = [f"G1 X{x:.{decimals}f} Y{y:.{decimals}f}\n" for x, y in points_mm[1:].tolist()]
    with path.open("w", encoding="ascii") as file:
        file.write(f"G21 G17 G90 G94\nF{_FEED_MM_MIN}\n")
        for _ in range(laps):
            file.writelines(lines)
        file.write("M2\n")


def chord_lengths() -> Iterator[tuple[float, int]]:
    """Chord lengths in mm with their number of decimals, sufficient to distinguish neighbouring points."""
    yield from ((0.1, 4), (0.01, 4), (0.001, 5))
