"""From a program, file or text, to the stream of segments of its smoothed toolpath."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from feedopt_core.errors import ToolpathError
from feedopt_core.path.segments import Segment
from feedopt_core.smoothing.cubic_spline import DEFAULT_TOLERANCE_MM, interpolate_points
from feedopt_core.toolpath.points_csv import read_points

POINTS_SUFFIXES = (".csv", ".txt")


def open_program(path: Path) -> str:
    """Text of a program file.

    Raises:
        ToolpathError: it cannot be opened, is not text, or is of a kind that is not read.
    """
    if path.suffix.lower() not in POINTS_SUFFIXES:
        raise ToolpathError(
            f"files of type {path.suffix or '(none)'} are not read; there are: {', '.join(POINTS_SUFFIXES)}",
            source=str(path),
        )
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ToolpathError(f"cannot be read: {error.strerror}", source=str(path)) from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        column = error.start - (error.object.rfind(b"\n", 0, error.start) + 1) + 1
        raise ToolpathError("is not UTF-8 text", source=str(path), line=line, column=column) from error


def read_program(
    text: str, source: str, dimensions: int, tolerance_mm: float = DEFAULT_TOLERANCE_MM
) -> Iterator[Segment]:
    """Segments of a program of points, in order.

    Args:
        text: the program.
        source: its name, for errors.
        dimensions: coordinates of the machine, 2 or 3; a plane program on a machine with z stays at z = 0.
        tolerance_mm: largest distance of the smoothed from the programmed path, above zero.

    Raises:
        ToolpathError: the program cannot be read, or needs a coordinate the machine has not.
    """
    if not 0.0 < tolerance_mm < float("inf"):
        raise ToolpathError(f"the tolerance is {tolerance_mm:g} mm, must be above zero", source=source)
    programmed = read_points(io.StringIO(text), source)
    points_mm = programmed.points_mm
    missing = dimensions - points_mm.shape[1]
    if missing < 0:
        raise ToolpathError(
            "has a z coordinate, the machine has no axis for it", source=source, line=programmed.lines[0], column=1
        )
    points_mm = np.pad(points_mm, ((0, 0), (0, missing)))
    try:
        yield from interpolate_points(points_mm, programmed.lines, tolerance_mm)
    except ToolpathError as error:
        error.source = source
        raise
