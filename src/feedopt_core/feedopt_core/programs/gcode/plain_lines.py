"""Fast scanner for the lines that make up most of a program: G0 and G1 with plain numbers, or no G word.

It gives the same result as the general reader, and leaves all other lines to it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.compiled import compiled

END, OTHER_LINE, OTHER_MOTION = 0, 1, 2
MAX_COORDINATE_MM = 1e6
"""Larger coordinates are refused as errors: no machine is a kilometre long."""

_MOST_DIGITS = 15
"""Fewer digits than a float64 holds exactly: their quotient by a power of ten is the nearest float64, as of float()."""
_POWERS_OF_TEN = np.array([10.0**k for k in range(_MOST_DIGITS + 1)])
_NEWLINE, _RETURN, _SPACE, _TAB, _PLUS, _MINUS, _POINT, _ZERO, _NINE = 10, 13, 32, 9, 43, 45, 46, 48, 57
_G, _X, _Y, _Z, _F, _N = 0, 1, 2, 3, 4, 5
_LOWER_CASE = 32
_g, _x, _y, _z, _f, _n = 103, 120, 121, 122, 102, 110


@compiled
def _read_number(codes: NDArray[np.uint8], at: int) -> tuple[int, float]:
    """Index after a plain number, and its value; index -1 if there is none."""
    negative = codes[at] == _MINUS
    if negative or codes[at] == _PLUS:
        at += 1
    mantissa, digits, decimals, behind_point = 0, 0, 0, False
    while True:
        code = codes[at]
        if _ZERO <= code <= _NINE:
            mantissa = 10 * mantissa + (code - _ZERO)
            digits += 1
            if behind_point:
                decimals += 1
            if digits > _MOST_DIGITS:
                return -1, 0.0
        elif code == _POINT and not behind_point:
            behind_point = True
        else:
            break
        at += 1
    if digits == 0:
        return -1, 0.0
    value = mantissa / _POWERS_OF_TEN[decimals]
    return at, -value if negative else value


@compiled
def _word_slot(code: int) -> int:
    """Slot of a letter, -1 for all others."""
    letter = code | _LOWER_CASE
    if letter == _x:
        return _X
    if letter == _y:
        return _Y
    if letter == _z:
        return _Z
    if letter == _g:
        return _G
    if letter == _f:
        return _F
    if letter == _n:
        return _N
    return -1


@compiled
def _read_line(codes: NDArray[np.uint8], at: int, values: FloatArray) -> int:
    """Index after a plain line, with its words in their slots; -1 if the line is not plain."""
    values[:] = math.nan
    first = True
    while True:
        code = codes[at]
        if code == _NEWLINE:
            return at + 1
        if code in (_SPACE, _TAB):
            at += 1
            continue
        if code == _RETURN and codes[at + 1] == _NEWLINE:
            return at + 2
        slot = _word_slot(code)
        if slot < 0 or not math.isnan(values[slot]) or (slot == _N and not first):
            return -1
        at += 1
        while codes[at] in (_SPACE, _TAB):
            at += 1
        at, values[slot] = _read_number(codes, at)
        if at < 0:
            return -1
        first = False


@compiled
def _target(
    values: FloatArray, scale: float, offset_mm: FloatArray, position_mm: FloatArray, end_mm: FloatArray
) -> int:
    """Where a line ends; 0: no motion, 1: motion, -1: out of any range."""
    moves = 0
    for axis in range(3):
        value = values[_X + axis]
        end_mm[axis] = position_mm[axis]
        if not math.isnan(value):
            end_mm[axis] = value * scale + offset_mm[axis]
            if abs(end_mm[axis]) > MAX_COORDINATE_MM:
                return -1
            if end_mm[axis] != position_mm[axis]:
                moves = 1
    return moves


@compiled
def scan_plain_lines(  # noqa: PLR0917 (compiled: arrays and numbers, no objects)
    codes: NDArray[np.uint8],
    at: int,
    line: int,
    scale: float,
    offset_mm: FloatArray,
    position_mm: FloatArray,
    motion: int,
    feed_mm_s: float,
    points_mm: FloatArray,
    lines: IntArray,
    feeds_mm_s: FloatArray,
    count: int,
    run_motion: int,
) -> tuple[int, int, int, int, int, float]:
    """Read lines up to the first that is not plain or would begin another run of moves.

    Args:
        codes: ASCII text; it ends with a newline.
        at, line: index in it, and number, of the first line.
        scale: mm of a unit of the program.
        offset_mm: added to coordinates, shape (3,).
        position_mm: where the machine stands, shape (3,); moves along.
        motion: 0 for G0, 1 for G1, -1 for others.
        feed_mm_s: feed, nan for none.
        points_mm, lines, feeds_mm_s: filled from ``count`` on.
        count: moves so far.
        run_motion: motion of the moves so far.

    Returns:
        why it ended, and at, line, count, motion, feed_mm_s as they are then.
    """
    values = np.empty(6)
    end_mm = np.empty(3)
    while at < len(codes):
        behind = _read_line(codes, at, values)
        if behind < 0 or values[_N] < 0.0:
            return OTHER_LINE, at, line, count, motion, feed_mm_s
        line_motion, line_feed_mm_s = motion, feed_mm_s
        if not math.isnan(values[_G]):
            if values[_G] not in (0.0, 1.0):
                return OTHER_LINE, at, line, count, motion, feed_mm_s
            line_motion = int(values[_G])
        if not math.isnan(values[_F]):
            if values[_F] <= 0.0:
                return OTHER_LINE, at, line, count, motion, feed_mm_s
            line_feed_mm_s = values[_F] * scale / 60.0
        if not (math.isnan(values[_X]) and math.isnan(values[_Y]) and math.isnan(values[_Z])):
            moves = _target(values, scale, offset_mm, position_mm, end_mm)
            if moves < 0 or line_motion < 0 or (line_motion == 1 and math.isnan(line_feed_mm_s)):
                return OTHER_LINE, at, line, count, motion, feed_mm_s
            if moves:
                if count and line_motion != run_motion:
                    return OTHER_MOTION, at, line, count, motion, feed_mm_s
                run_motion = line_motion
                points_mm[count] = end_mm
                lines[count] = line
                feeds_mm_s[count] = line_feed_mm_s if line_motion == 1 else math.inf
                count += 1
                position_mm[:] = end_mm
        motion, feed_mm_s, at, line = line_motion, line_feed_mm_s, behind, line + 1
    return END, at, line, count, motion, feed_mm_s
