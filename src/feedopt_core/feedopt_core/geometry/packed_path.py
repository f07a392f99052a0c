"""The segments of a path packed into arrays, as :mod:`feedopt_core.geometry.path_kernels` evaluates them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.path_kernels import COLUMNS, path_points
from feedopt_core.geometry.path_points import PathPoints


@dataclass(frozen=True)
class PackedSegment:
    """Rows of one segment, counted from its own start.

    Attributes:
        dimensions: 2 or 3.
        starts_mm: arc length at the start of each row, shape (m,), first 0.
        rows: shape (m, COLUMNS).
        curve: spans of its curve, flat; empty for planar segments.
    """

    dimensions: int
    starts_mm: FloatArray
    rows: FloatArray
    curve: FloatArray

    def points(self, s_mm: FloatArray) -> PathPoints:
        """Path at arc lengths from the start of the segment, shape (n,)."""
        return _points((self.starts_mm, self.rows, self.curve, 0), s_mm, self.dimensions)


class Queue:
    """Rows appended behind and dropped in front, contiguous at any time; memory follows what is held.

    Attributes:
        dropped: number of rows dropped so far.
    """

    def __init__(self, *width: int) -> None:
        self._rows = np.empty((64, *width))
        self._first = self._end = self.dropped = 0

    def __len__(self) -> int:
        """Number of rows held."""
        return self._end - self._first

    @property
    def held(self) -> FloatArray:
        """The rows, a view: valid until the next change."""
        return self._rows[self._first : self._end]

    def append(self, rows: FloatArray) -> None:
        """Take in rows, shape (n, *width)."""
        if self._end + len(rows) > len(self._rows):
            self._move(max(64, 2 * (len(self) + len(rows))))
        self._rows[self._end : self._end + len(rows)] = rows
        self._end += len(rows)

    def drop(self, count: int) -> None:
        """Forget the first rows."""
        self._first += count
        self.dropped += count
        if len(self._rows) > 64 and 8 * len(self) < len(self._rows):
            self._move(max(64, 2 * len(self)))

    def shorten(self, count: int) -> None:
        """Forget the last rows."""
        self._end -= count

    def _move(self, room: int) -> None:
        rows = np.empty((room, *self._rows.shape[1:]))
        rows[: len(self)] = self.held
        self._rows, self._first, self._end = rows, 0, len(self)


class PackedPath:
    """Rows of consecutive segments, counted from the start of the program."""

    def __init__(self, dimensions: int) -> None:
        self.dimensions = dimensions
        self._starts, self._rows, self._curve = Queue(), Queue(COLUMNS), Queue()

    def append(self, segment: PackedSegment, s_start_mm: float) -> None:
        """Take in the next segment."""
        self._starts.append(segment.starts_mm + s_start_mm)
        rows = segment.rows.copy()
        rows[:, 0] += s_start_mm
        rows[:, 14:17] += self._curve.dropped + len(self._curve) if len(segment.curve) else 0.0
        self._rows.append(rows)
        self._curve.append(segment.curve)

    def drop(self, segment: PackedSegment) -> None:
        """Forget the first segment, which is this one."""
        self._starts.drop(len(segment.rows))
        self._rows.drop(len(segment.rows))
        self._curve.drop(len(segment.curve))

    def points(self, s_mm: FloatArray) -> PathPoints:
        """Path at arc lengths that are held, shape (n,)."""
        return _points(self._tables(), s_mm, self.dimensions)

    def derivatives(self, s_mm: FloatArray) -> FloatArray:
        """dr/ds, d2r/ds2 and d3r/ds3, shape (3, n, dimensions): cheaper, where the position is an integral."""
        derivatives = np.empty((3, len(s_mm), self.dimensions))
        path_points(*self._tables(), _contiguous(s_mm), np.empty((0, self.dimensions)), derivatives)
        return derivatives

    def _tables(self) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        return self._starts.held, self._rows.held, self._curve.held, self._curve.dropped


def _points(tables: tuple[FloatArray, FloatArray, FloatArray, int], s_mm: FloatArray, dimensions: int) -> PathPoints:
    r, derivatives = np.empty((len(s_mm), dimensions)), np.empty((3, len(s_mm), dimensions))
    path_points(*tables, _contiguous(s_mm), r, derivatives)
    return PathPoints(r, *derivatives)


def _contiguous(s_mm: FloatArray) -> FloatArray:
    return np.ascontiguousarray(s_mm, dtype=np.float64)
