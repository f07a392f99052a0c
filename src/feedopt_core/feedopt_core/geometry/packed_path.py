"""The segments of a path packed into arrays, as :mod:`feedopt_core.geometry.path_kernels` evaluates them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from feedopt_core.arrays import FloatArray, RecordArray
from feedopt_core.geometry.path_kernels import PIECE, path_points
from feedopt_core.geometry.path_points import PathPoints

_Tables: TypeAlias = tuple[FloatArray, RecordArray, FloatArray, int]
"""Starts, pieces, spans of the curves, and the place of the first of these, as ``path_points`` takes them."""


@dataclass(frozen=True)
class PackedSegment:
    """Pieces of one segment, counted from its own start.

    Attributes:
        dimensions: 2 or 3.
        starts_mm: arc length at the start of each piece, shape (m,), first 0.
        pieces: of type PIECE, shape (m,).
        curve: spans of its curve, flat; empty for planar segments.
    """

    dimensions: int
    starts_mm: FloatArray
    pieces: RecordArray
    curve: FloatArray

    def points(self, s_mm: FloatArray) -> PathPoints:
        """Path at arc lengths from the start of the segment, shape (n,)."""
        return _points((self.starts_mm, self.pieces, self.curve, 0), s_mm, self.dimensions)


class Queue:
    """Values appended at the end and dropped at the front, always contiguous; memory follows the number held.

    Args:
        dtype: of the values.

    Attributes:
        dropped: number of values dropped so far.
    """

    def __init__(self, dtype: DTypeLike = np.float64) -> None:
        self._values: NDArray[Any] = np.empty(64, dtype)
        self._first = self._end = self.dropped = 0

    def __len__(self) -> int:
        """Number of values held."""
        return self._end - self._first

    @property
    def held(self) -> NDArray[Any]:
        """The values, a view: valid until the next change."""
        return self._values[self._first : self._end]

    def append(self, values: NDArray[Any]) -> None:
        """Take in values, shape (n,)."""
        if self._end + len(values) > len(self._values):
            self._move(max(64, 2 * (len(self) + len(values))))
        self._values[self._end : self._end + len(values)] = values
        self._end += len(values)

    def drop(self, count: int) -> None:
        """Forget the first values."""
        self._first += count
        self.dropped += count
        if len(self._values) > 64 and 8 * len(self) < len(self._values):
            self._move(max(64, 2 * len(self)))

    def shorten(self, count: int) -> None:
        """Forget the last values."""
        self._end -= count

    def _move(self, size: int) -> None:
        values = np.empty(size, self._values.dtype)
        values[: len(self)] = self.held
        self._values, self._first, self._end = values, 0, len(self)


class PackedPath:
    """Pieces of consecutive segments, counted from the start of the program."""

    def __init__(self, dimensions: int) -> None:
        self.dimensions = dimensions
        self._starts, self._pieces, self._curve = Queue(), Queue(PIECE), Queue()

    def append(self, segment: PackedSegment, s_start_mm: float) -> None:
        """Take in the next segment."""
        self._starts.append(segment.starts_mm + s_start_mm)
        pieces = segment.pieces.copy()
        pieces["segment_start_mm"] += s_start_mm
        if len(segment.curve):
            for place in ("first_span", "last_span", "own_span"):
                pieces[place] += self._curve.dropped + len(self._curve)
        self._pieces.append(pieces)
        self._curve.append(segment.curve)

    def drop(self, segment: PackedSegment) -> None:
        """Forget the first segment, which is this one."""
        self._starts.drop(len(segment.pieces))
        self._pieces.drop(len(segment.pieces))
        self._curve.drop(len(segment.curve))

    def points(self, s_mm: FloatArray) -> PathPoints:
        """Path at arc lengths that are held, shape (n,)."""
        return _points(self._tables(), s_mm, self.dimensions)

    def derivatives(self, s_mm: FloatArray) -> FloatArray:
        """dr/ds, d2r/ds2 and d3r/ds3, shape (3, n, dimensions): cheaper, where the position is an integral."""
        derivatives = np.empty((3, len(s_mm), self.dimensions))
        path_points(*self._tables(), _contiguous(s_mm), np.empty((0, self.dimensions)), derivatives)
        return derivatives

    def _tables(self) -> _Tables:
        return self._starts.held, self._pieces.held, self._curve.held, self._curve.dropped


def _points(tables: _Tables, s_mm: FloatArray, dimensions: int) -> PathPoints:
    r, derivatives = np.empty((len(s_mm), dimensions)), np.empty((3, len(s_mm), dimensions))
    path_points(*tables, _contiguous(s_mm), r, derivatives)
    return PathPoints(r, *derivatives)


def _contiguous(s_mm: FloatArray) -> FloatArray:
    return np.ascontiguousarray(s_mm, dtype=np.float64)
