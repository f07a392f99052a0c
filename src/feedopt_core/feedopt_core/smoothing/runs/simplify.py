"""Simplifies polylines to as few vertices as a tolerance allows: a stream of points in, vertices out.

Chords that are short against the tolerance carry no shape, only the rounding of the program; what is left behind this
stage is the same for a run programmed in chords of 0.1, 0.01 or 0.001 mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.compiled import compiled

BoolArray: TypeAlias = NDArray[np.bool_]

_MOST_POINTS = 1024
"""Points that one chord may replace."""
_REPEATED_SHARE = 1e-3
"""Points closer than this share of the tolerance become one point."""


@dataclass(frozen=True)
class Vertices:
    """Vertices of the simplified polyline, in order.

    Attributes:
        points_mm: shape (n, d).
        lines: program line of the move that leaves each vertex, shape (n,); of the last one, the move that ends there.
        feed_mm_s: feed of the same moves, shape (n,).
    """

    points_mm: FloatArray
    lines: IntArray
    feed_mm_s: FloatArray

    def part(self, which: slice) -> Vertices:
        """Some of the vertices."""
        return Vertices(self.points_mm[which], self.lines[which], self.feed_mm_s[which])

    def joined(self, behind: Vertices) -> Vertices:
        """These vertices followed by others."""
        return Vertices(
            np.concatenate([self.points_mm, behind.points_mm]),
            np.concatenate([self.lines, behind.lines]),
            np.concatenate([self.feed_mm_s, behind.feed_mm_s]),
        )


class PolylineSimplifier:
    """Simplifies a polyline as it arrives. The result does not depend on how the points are divided into blocks.

    The simplified polyline starts and ends exactly where the programmed one does, has a vertex at every change of
    feed, and the two are nowhere further apart than the tolerance, seen from either of them.

    Args:
        tolerance_mm: above zero.
    """

    def __init__(self, tolerance_mm: float) -> None:
        self._repeated_mm = _REPEATED_SHARE * tolerance_mm
        self._tolerance_mm = tolerance_mm - 2.0 * self._repeated_mm
        self._points = np.empty((0, 0))
        self._lines = np.empty(0, dtype=np.int64)
        self._feed = np.empty(0)
        self._last_mm: FloatArray | None = None

    def add(self, points_mm: FloatArray, lines: IntArray, feed_mm_s: FloatArray) -> Vertices:
        """Add the next points, shape (n, d), with line and feed of the move that ends at each.

        Returns:
            Newly final vertices.
        """
        if not len(points_mm):
            return self._vertices(np.empty(0, dtype=np.int64))
        points_mm = np.ascontiguousarray(points_mm, dtype=np.float64)
        first = self._last_mm is None
        kept = distinct_points(points_mm if first else np.vstack([self._points[-1:], points_mm]), self._repeated_mm)
        kept = kept if first else kept[1:] - 1
        self._last_mm = points_mm[-1].copy()
        if first:
            self._points, self._lines, self._feed = points_mm[kept], lines[kept], feed_mm_s[kept]
        else:
            self._points = np.concatenate([self._points, points_mm[kept]])
            self._lines = np.concatenate([self._lines, lines[kept]])
            self._feed = np.concatenate([self._feed, feed_mm_s[kept]])
        return self._take(final=False)

    def finish(self) -> Vertices:
        """Remaining vertices, including the last point."""
        if self._last_mm is None:
            return self._vertices(np.empty(0, dtype=np.int64))
        self._points[-1] = self._last_mm
        vertices = self._take(final=True)
        if len(vertices.lines) and np.linalg.norm(vertices.points_mm[-1] - self._last_mm) < self._repeated_mm:
            vertices = vertices.part(slice(-1))
        return vertices.joined(Vertices(self._points[-1:], self._lines[-1:], self._feed[-1:]))

    def _take(self, *, final: bool) -> Vertices:
        forced = np.append(self._feed[1:] != self._feed[:-1], True)
        chosen = kept_vertices(self._points, forced, self._tolerance_mm, _MOST_POINTS, final)
        vertices = self._vertices(chosen[:-1])
        held = slice(int(chosen[-1]), None)
        self._points, self._lines, self._feed = self._points[held], self._lines[held], self._feed[held]
        return vertices

    def _vertices(self, index: IntArray) -> Vertices:
        return Vertices(self._points[index], self._lines[index + 1], self._feed[index + 1])


@compiled
def distinct_points(points_mm: FloatArray, least_mm: float) -> IntArray:
    """Indices of points at least a distance from the last point kept. The first point is kept."""
    count, dimensions = points_mm.shape
    kept = np.empty(count, dtype=np.int64)
    kept[0] = 0
    found = 1
    for i in range(1, count):
        square = 0.0
        for c in range(dimensions):
            square += (points_mm[i, c] - points_mm[kept[found - 1], c]) ** 2
        if square >= least_mm * least_mm:
            kept[found] = i
            found += 1
    return kept[:found]


@compiled
def _replaceable(points_mm: FloatArray, first: int, last: int, tolerance_mm: float) -> bool:
    """True if the points between two others are close to their chord, and in order along it up to the tolerance."""
    dimensions = points_mm.shape[1]
    square = 0.0
    for c in range(dimensions):
        square += (points_mm[last, c] - points_mm[first, c]) ** 2
    length = np.sqrt(square)
    if length < _REPEATED_SHARE * tolerance_mm:
        return False
    furthest = 0.0
    for i in range(first + 1, last):
        along = 0.0
        distance = 0.0
        for c in range(dimensions):
            offset = points_mm[i, c] - points_mm[first, c]
            along += offset * (points_mm[last, c] - points_mm[first, c])
            distance += offset * offset
        along /= length
        inside = min(max(along, 0.0), length)
        if distance - 2.0 * along * inside + inside * inside > tolerance_mm * tolerance_mm:
            return False
        if along < furthest - tolerance_mm:
            return False
        furthest = max(furthest, along)
    return True


@compiled
def kept_vertices(
    points_mm: FloatArray, forced: BoolArray, tolerance_mm: float, most_points: int, final: bool
) -> IntArray:
    """Indices of the vertices to keep, from 0 to the last one that can be decided.

    Args:
        points_mm: shape (n, d).
        forced: points that must stay, shape (n,).
        tolerance_mm: largest distance of a point that is left out.
        most_points: points that one chord may replace.
        final: no more points follow. Otherwise a decision waits for all points that could change it.
    """
    count = len(points_mm)
    kept = np.empty(count, dtype=np.int64)
    kept[0] = 0
    found = 1
    first = 0
    while first < count - 1 and (final or first + most_points < count):
        limit = min(first + most_points, count - 1)
        for i in range(first + 1, limit):
            if forced[i]:
                limit = i
                break
        good, step = first + 1, 1
        bad = limit + 1
        while good < limit:
            trial = min(good + step, limit)
            if not _replaceable(points_mm, first, trial, tolerance_mm):
                bad = trial
                break
            good, step = trial, 2 * step
        while bad - good > 1 and good < limit:
            trial = (good + bad) // 2
            if _replaceable(points_mm, first, trial, tolerance_mm):
                good = trial
            else:
                bad = trial
        kept[found] = good
        found += 1
        first = good
    return kept[:found]
