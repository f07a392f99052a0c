"""Points files: one point a line, x and y (and z) in mm, separated by commas, with an optional header."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError

MAX_POINTS = 500_000
"""The spline through the points needs all of them at once; longer programs come in streamed formats or in parts."""
LEAST_DISTANCE_MM = 1e-6
"""Neighbours closer than this are one point: between them a spline would swing by the rounding of their coordinates."""
_HEADERS = (("x_mm", "y_mm"), ("x_mm", "y_mm", "z_mm"))


@dataclass(frozen=True)
class ProgrammedPoints:
    """Points of a program, shape (n, 2 or 3), mm, with the line each stands on."""

    points_mm: FloatArray
    lines: list[int]


def read_points(lines: Iterable[str], source: str) -> ProgrammedPoints:
    """Read points.

    Args:
        lines: text of the file, line by line.
        source: name for errors.

    Raises:
        ToolpathError: no points, one point only, a field that is not a finite number, a line with another number of
            fields, a point equal to the one before, too many points; names line and column.
    """
    rows: list[list[float]] = []
    numbers: list[int] = []
    columns = 0
    for number, line in _content(lines):
        fields = line.split(",")
        if not rows and tuple(field.strip().lower() for field in fields) in _HEADERS:
            continue
        if not columns:
            columns = len(fields)
            if columns not in (2, 3):
                raise ToolpathError(
                    f"needs x and y, or x, y and z, has {columns} fields: {line[:40]!r}",
                    source=source,
                    line=number,
                    column=1,
                )
        rows.append(_row(line, fields, columns, source, number))
        numbers.append(number)
        if len(rows) > 1 and math.dist(rows[-1], rows[-2]) < LEAST_DISTANCE_MM:
            raise ToolpathError(
                f"repeats the point of line {numbers[-2]}; remove one of them", source=source, line=number, column=1
            )
        if len(rows) > MAX_POINTS:
            raise ToolpathError(
                f"more than {MAX_POINTS} points; divide the program", source=source, line=number, column=1
            )
    if len(rows) < 2:
        found = "holds no points" if not rows else "holds one point only"
        raise ToolpathError(
            f"{found}; a toolpath needs two", source=source, line=numbers[-1] if numbers else 1, column=1
        )
    return ProgrammedPoints(np.array(rows), numbers)


def _content(lines: Iterable[str]) -> Iterator[tuple[int, str]]:
    """Numbered lines that are not blank."""
    for number, raw in enumerate(lines, start=1):
        line = raw.rstrip("\r\n")
        if number == 1:
            line = line.removeprefix("\ufeff")
        if line.strip():
            yield number, line


def _row(line: str, fields: list[str], columns: int, source: str, number: int) -> list[float]:
    if len(fields) != columns:
        at = line.rfind(",") + 2 if len(fields) > columns else len(line) + 1
        raise ToolpathError(
            f"has {len(fields)} fields, the lines before have {columns}", source=source, line=number, column=at
        )
    row, column = [], 1
    for text in fields:
        place = column + len(text) - len(text.lstrip())
        try:
            # Python reads 1_0 as 10; no points file means that.
            value = float(text.replace("_", "?"))
        except ValueError as error:
            raise ToolpathError(
                f"{text.strip()[:40]!r} is not a number", source=source, line=number, column=place
            ) from error
        if not math.isfinite(value):
            raise ToolpathError(f"{text.strip()[:40]} is not a finite number", source=source, line=number, column=place)
        row.append(value)
        column += len(text) + 1
    return row
