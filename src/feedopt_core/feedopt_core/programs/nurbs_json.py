"""NURBS programs in JSON: curves with their control nets, in millimetres; docs/programs.md describes the format."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.programs.moves import LineMoves, NurbsMove

HIGHEST_DEGREE = 9
LARGEST_COORDINATE_MM = 1e6
_WEIGHT_RANGE = 1e6
_LEAST_SPAN = 1e-9
_JOIN_MM = 1e-6
_CURVE_DEPTH = 3
_PROGRAM_KEYS = ("curves", "feed_mm_s")
_CURVE_KEYS = ("degree", "knots", "control_points_mm", "weights", "feed_mm_s")
_MARKS = re.compile(r'"(?:\\.|[^"\\])*"|[{}\[\]\n]', re.DOTALL)


def read_nurbs_json(text: str, source: str) -> Iterator[LineMoves | NurbsMove]:
    """Moves of a program of NURBS curves; a rapid leads from a curve to the next one where they do not meet.

    Args:
        text: the program.
        source: its name, for errors.

    Raises:
        ToolpathError: it is not JSON, or a curve cannot be used; names line and column where the JSON breaks off, else
            the line the curve starts on.
    """
    document = _document(text, source)
    try:
        _refuse_unknown(document, _PROGRAM_KEYS)
        feed_mm_s = _feed_mm_s(document)
    except ToolpathError as error:
        raise ToolpathError(error.message, source=source, line=1) from error
    curves = document.get("curves")
    if not isinstance(curves, list) or not curves:
        raise ToolpathError('needs "curves", a list with at least one curve', source=source, line=1)
    end_mm: FloatArray | None = None
    for number, (curve, line) in enumerate(zip(curves, _curve_lines(text, len(curves)), strict=True), start=1):
        try:
            move = _curve_move(curve, line, feed_mm_s, end_mm)
        except ToolpathError as error:
            raise ToolpathError(f"curve {number}: {error.message}", source=source, line=line) from error
        start_mm = move.start_mm if isinstance(move, LineMoves) else move.control_points_mm[0]
        if end_mm is not None and np.any(start_mm != end_mm):
            yield LineMoves(end_mm, start_mm[None, :], np.array([line]), np.array([math.inf]), rapid=True)
        yield move
        end_mm = move.points_mm[-1] if isinstance(move, LineMoves) else move.control_points_mm[-1]


def _document(text: str, source: str) -> dict[str, object]:
    try:
        document = json.loads(
            text.removeprefix("\ufeff"),
            parse_int=float,
            parse_constant=_refuse_constant,
            object_pairs_hook=_object_of_pairs,
        )
    except json.JSONDecodeError as error:
        raise ToolpathError(
            f"is not JSON: {error.msg}", source=source, line=error.lineno, column=error.colno
        ) from error
    except RecursionError as error:
        raise ToolpathError("is nested too deeply for a NURBS program", source=source, line=1) from error
    except ToolpathError as error:
        raise ToolpathError(error.message, source=source, line=1) from error
    if not isinstance(document, dict):
        raise ToolpathError('needs an object with "curves"', source=source, line=1)
    return document


def _refuse_constant(name: str) -> float:
    raise ToolpathError(f"holds {name}, which is not a finite number")


def _object_of_pairs(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Object of its keys and values; JSON itself would let the last one of a repeated key win."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ToolpathError(f"has the key {next(key for key in keys if keys.count(key) > 1)!r} twice in one object")
    return found


def _refuse_unknown(found: dict[str, object], known: tuple[str, ...]) -> None:
    for key in found:
        if key not in known:
            raise ToolpathError(f"has the key {key[:40]!r}; there are: {', '.join(known)}")


def _curve_lines(text: str, count: int) -> list[int]:
    """Line each entry of "curves" starts on, from 1; 1 for entries that are no objects."""
    lines, line, depth = list[int](), 1, 0
    for mark in _MARKS.finditer(text):
        character = mark.group()[0]
        if character == "\n":
            line += 1
        elif character in "{[":
            depth += 1
            if depth == _CURVE_DEPTH and character == "{":
                lines.append(line)
        elif character in "}]":
            depth -= 1
    return lines if len(lines) == count else [1] * count


def _curve_move(curve: object, line: int, program_feed_mm_s: float, end_mm: FloatArray | None) -> LineMoves | NurbsMove:
    """Move of one curve; it starts exactly at end_mm where it does so but for rounding."""
    if not isinstance(curve, dict):
        raise ToolpathError("needs an object with degree, knots and control_points_mm")
    _refuse_unknown(curve, _CURVE_KEYS)
    degree = curve.get("degree")
    if not isinstance(degree, float) or degree not in range(1, HIGHEST_DEGREE + 1):
        raise ToolpathError(f"needs a degree from 1 to {HIGHEST_DEGREE}")
    order = int(degree) + 1
    control_mm = _control_points_mm(curve.get("control_points_mm"))
    count = len(control_mm)
    if count < order:
        raise ToolpathError(f"has {count} control points; degree {order - 1} needs at least {order}")
    knots = _numbers(curve.get("knots"), "knots")
    if len(knots) != count + order:
        raise ToolpathError(
            f"has {len(knots)} knots; degree {order - 1} with {count} control points needs {count + order}"
        )
    check_knots(knots, order - 1)
    weights = _numbers(curve["weights"], "weights") if "weights" in curve else np.ones(count)
    if len(weights) != count:
        raise ToolpathError(f"has {len(weights)} weights for {count} control points")
    check_weights(weights)
    feed_mm_s = _feed_mm_s(curve) if "feed_mm_s" in curve else program_feed_mm_s
    if end_mm is not None and np.linalg.norm(control_mm[0] - end_mm) <= _JOIN_MM:
        control_mm[0] = end_mm
    if np.all(np.ptp(control_mm, axis=0) <= _JOIN_MM):
        raise ToolpathError("all control points are one: the curve has no length; remove it")
    if order == 2:
        feeds, lines = np.full(count - 1, feed_mm_s), np.full(count - 1, line)
        return LineMoves(control_mm[0], control_mm[1:], lines, feeds)
    return NurbsMove(order - 1, knots, control_mm, weights, line, feed_mm_s)


def check_knots(knots: FloatArray, degree: int) -> None:
    """Refuse knots that no continuous clamped curve has.

    Raises:
        ToolpathError: they decrease, lie too close, are not clamped, or break the curve inside.
    """
    span = float(knots[-1] - knots[0])
    steps = np.diff(knots)
    if np.any(steps < 0.0):
        raise ToolpathError(f"knot {int(np.argmax(steps < 0.0)) + 2} is smaller than the one before")
    if not span > 0.0 or np.any((steps > 0.0) & (steps < _LEAST_SPAN * span)):
        raise ToolpathError(f"two knots differ by less than {_LEAST_SPAN:g} of their whole span; make them equal")
    if knots[degree] != knots[0] or knots[-degree - 1] != knots[-1]:
        raise ToolpathError(f"is not clamped: the first and the last {degree + 1} knots must be equal")
    _, repeats = np.unique(knots[degree + 1 : -degree - 1], return_counts=True)
    if np.any(repeats > degree):
        raise ToolpathError(f"repeats a knot inside {int(np.max(repeats))} times; {degree} times at most hold together")
    if knots[degree + 1] == knots[0] or knots[-degree - 2] == knots[-1]:
        raise ToolpathError(f"repeats an end knot more than {degree + 1} times")


def check_weights(weights: FloatArray) -> None:
    """Refuse weights that are not above zero or too different for double precision.

    Raises:
        ToolpathError: names the weight.
    """
    least, greatest = float(np.min(weights)), float(np.max(weights))
    if not least > 0.0:
        raise ToolpathError(f"weight {int(np.argmin(weights)) + 1} is {least:g}, must be above zero")
    if greatest > _WEIGHT_RANGE * least:
        raise ToolpathError(f"weights from {least:g} to {greatest:g} differ by more than a factor of {_WEIGHT_RANGE:g}")


def _control_points_mm(found: object) -> FloatArray:
    """Control points with three coordinates, shape (n, 3)."""
    if not isinstance(found, list) or not found:
        raise ToolpathError("needs control_points_mm, a list of points")
    points = [_numbers(point, f"control point {number}") for number, point in enumerate(found, start=1)]
    dimensions = len(points[0])
    for number, point in enumerate(points, start=1):
        if len(point) != dimensions or dimensions not in (2, 3):
            raise ToolpathError(f"control point {number} has {len(point)} coordinates; needs 2, or 3, in all of them")
    control_mm = np.pad(np.stack(points), ((0, 0), (0, 3 - dimensions)))
    if np.max(np.abs(control_mm)) > LARGEST_COORDINATE_MM:
        raise ToolpathError(f"has a control point further than {LARGEST_COORDINATE_MM:g} mm from the origin")
    return control_mm


def _numbers(found: object, name: str) -> FloatArray:
    if not isinstance(found, list) or not found:
        raise ToolpathError(f"needs {name}, a list of numbers")
    for place, value in enumerate(found, start=1):
        if not isinstance(value, float) or not math.isfinite(value):
            raise ToolpathError(f"{name}: entry {place} is not a finite number")
    return np.array(found, dtype=np.float64)


def _feed_mm_s(found: dict[str, object]) -> float:
    """Feed of a program or curve; infinity, the machine's limits alone, where it names none."""
    feed = found.get("feed_mm_s", math.inf)
    if not isinstance(feed, float) or not feed > 0.0 or ("feed_mm_s" in found and not math.isfinite(feed)):
        raise ToolpathError("feed_mm_s must be a finite number above zero")
    return feed
