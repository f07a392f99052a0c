"""Vertices of a run with the data for its fit: a parameter free of noise, and how sharply the run turns.

Both come from a second, coarser simplification: what stays within half of the tolerance of a chord is noise to the
curve, and neither its length nor its turns count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.compiled import compiled
from feedopt_core.smoothing.runs.knots import LARGEST_SPAN_MM, span_counts, span_lengths_mm, turns_rad
from feedopt_core.smoothing.runs.simplify import Vertices, kept_vertices

_COARSE_SHARE = 0.5
_MOST_POINTS = 64
_U_TURN_RAD = 2.9
_U_TURN_SHARE = 0.5
_LEAST_STEP = 1e-6


@dataclass(frozen=True)
class RunPolyline:
    """Vertices of a run, with the data for its fit.

    Attributes:
        points_mm: shape (n, d).
        u: parameter, about the length of the run up to here, increasing, shape (n,).
        span_mm: knot spacing asked for, shape (n,).
        size: rough count of knot spans up to here, shape (n,).
        offset_mm: distance by which the vertex was moved from its programmed place, shape (n,).
        lines, feed_mm_s: program line and feed of the move that leaves it, shape (n,).
    """

    points_mm: FloatArray
    u: FloatArray
    span_mm: FloatArray
    size: FloatArray
    offset_mm: FloatArray
    lines: IntArray
    feed_mm_s: FloatArray

    def part(self, which: slice | IntArray | NDArray[np.bool_]) -> RunPolyline:
        """Some of the vertices."""
        return RunPolyline(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def joined(self, behind: RunPolyline) -> RunPolyline:
        """These vertices followed by others."""
        pairs = ((getattr(self, name), getattr(behind, name)) for name in self.__dataclass_fields__)
        return RunPolyline(*(np.concatenate(pair) for pair in pairs))


class PolylineMeasure:
    """Measures the vertices of a run as they arrive.

    A vertex where the run reverses is replaced by one on each side of it: the curve needs space to turn.

    Args:
        tolerance_mm: of the run.
    """

    def __init__(self, tolerance_mm: float) -> None:
        self._tolerance_mm = tolerance_mm
        # Starts at the last measured vertex of the coarse polyline; the next one is at _anchor.
        self._held: Vertices | None = None
        self._anchor = 0
        self._measured_any = False
        self._u = 0.0
        self._size = 0.0
        self._span_mm = LARGEST_SPAN_MM

    def add(self, vertices: Vertices, *, final: bool) -> RunPolyline:
        """Add the next vertices; ``final``: no more follow.

        Returns:
            Newly measured vertices.
        """
        held = vertices if self._held is None else self._held.joined(vertices)
        points_mm = held.points_mm
        unforced = np.zeros(len(points_mm) - self._anchor, dtype=np.bool_)
        found = kept_vertices(
            points_mm[self._anchor :], unforced, _COARSE_SHARE * self._tolerance_mm, _MOST_POINTS, final
        )
        coarse = np.unique(np.append(self._anchor + found, 0))
        turn = turns_rad(points_mm[coarse])
        known = len(coarse) if final else max(len(coarse) - 1, 1)
        first = 1 if self._measured_any else 0
        measured = self._measure(held, coarse[:known], turn[:known], first)
        start = int(coarse[known - 1])
        self._held = held.part(slice(start, None))
        self._anchor = int(coarse[-1]) - start
        self._measured_any = True
        return measured

    def _measure(self, held: Vertices, coarse: IntArray, turn_rad: FloatArray, first: int) -> RunPolyline:
        """Vertices after coarse[0] up to coarse[-1]; including coarse[0] if first is 0."""
        points_mm = held.points_mm[: coarse[-1] + 1]
        turning = turn_rad > _U_TURN_RAD
        extra_mm = np.where(turning, 2.0 * _U_TURN_SHARE * self._tolerance_mm, 0.0)
        # Continue the sums of the call before, so that the result does not depend on the blocks, not even by rounding.
        u = along_coarse(points_mm, coarse, extra_mm, self._u, _LEAST_STEP * self._tolerance_mm)
        span_mm = np.full(len(points_mm), LARGEST_SPAN_MM)
        span_mm[coarse] = span_lengths_mm(turn_rad, self._tolerance_mm)
        span_mm[0] = self._span_mm if first else span_mm[0]
        size = np.interp(u, u[coarse], span_counts(np.diff(u[coarse]), span_mm[coarse], self._size))
        copies = np.ones(len(points_mm), dtype=np.int64)
        aside_mm = np.zeros_like(points_mm)
        for at in coarse[turning]:
            aside_mm[at] = _U_TURN_SHARE * self._tolerance_mm * _perpendicular(points_mm[at] - points_mm[at - 1])
            copies[at] = 2
        index = np.repeat(np.arange(len(points_mm)), copies)
        second = np.append(False, index[1:] == index[:-1])
        offset_mm = np.linalg.norm(aside_mm[index], axis=1)
        every = RunPolyline(
            points_mm[index] + np.where(second, -1.0, 1.0)[:, None] * aside_mm[index],
            u[index] + np.where(second, 2.0 * _U_TURN_SHARE * self._tolerance_mm, 0.0),
            span_mm[index],
            size[index],
            offset_mm,
            held.lines[index],
            held.feed_mm_s[index],
        )
        self._u, self._size, self._span_mm = float(every.u[-1]), float(every.size[-1]), float(every.span_mm[-1])
        return every.part(slice(first, None))


@compiled
def along_coarse(
    points_mm: FloatArray, coarse: IntArray, extra_mm: FloatArray, start_mm: float, least_mm: float
) -> FloatArray:
    """Length of the coarse polyline up to the projection of each vertex, made increasing, shape (n,).

    Args:
        points_mm: vertices, shape (n, d).
        coarse: indices of those of the coarse polyline, first 0, last n - 1, shape (k,).
        extra_mm: length added behind each of these, shape (k,).
        start_mm: length at the first vertex.
        least_mm: smallest step.
    """
    out = np.zeros(len(points_mm))
    out[0] = start_mm
    for k in range(len(coarse) - 1):
        low, high = coarse[k], coarse[k + 1]
        chord = points_mm[high] - points_mm[low]
        length = np.sqrt(np.sum(chord * chord))
        start = out[low] + extra_mm[k]
        before = start
        for i in range(low + 1, high):
            along = np.sum((points_mm[i] - points_mm[low]) * chord) / length
            room = length - (high - i) * least_mm
            out[i] = max(before + least_mm, start + min(along, room))
            before = out[i]
        out[high] = max(before + least_mm, start + length)
    return out


def _perpendicular(direction: FloatArray) -> FloatArray:
    """A unit vector perpendicular to a direction, in the plane of the first two coordinates."""
    aside = np.zeros_like(direction)
    aside[0], aside[1] = -direction[1], direction[0]
    length = float(np.linalg.norm(aside))
    if length > 0.0:
        return aside / length
    aside[0] = 1.0
    return aside
