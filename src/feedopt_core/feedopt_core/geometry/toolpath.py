"""The toolpath received so far: segments in order, evaluated at any arc length that is held."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from feedopt_core.arrays import FloatArray, record
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.packed_path import PackedPath, Queue
from feedopt_core.geometry.path_kernels import bend_lengths, lowest_at, mapped
from feedopt_core.geometry.path_points import PathPoints
from feedopt_core.geometry.segments import Segment

JOINT_TOLERANCE_MM = 1e-6
JOINT_TOLERANCE = 1e-6
_EXTENT = record(start_mm="f8", end_mm="f8", feed_limit_mm_s="f8", exact_stop="?", dwell_s="f8")
"""Of a segment: where it starts and ends, its feed, whether it ends in an exact stop, its dwell there."""


class Toolpath:
    """Segments of one program, appended as they arrive and dropped after use.

    Arc lengths are counted from the start of the program throughout.
    """

    def __init__(self) -> None:
        self._segments: deque[Segment] = deque()
        self._packed: PackedPath | None = None
        self._extents = Queue(_EXTENT)
        self._joints = Queue()
        # First and last point of the newest segment.
        self._newest: PathPoints | None = None

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The segments held, in order."""
        return tuple(self._segments)

    @property
    def start_mm(self) -> float:
        """Smallest arc length that can be evaluated."""
        return self._segments[0].place.s_start_mm if self._segments else 0.0

    @property
    def end_mm(self) -> float:
        """Largest arc length that can be evaluated."""
        return float(self._extents.held["end_mm"][-1]) if self._segments else 0.0

    @property
    def complete(self) -> bool:
        """The last segment of the program has arrived."""
        return bool(self._segments) and self._segments[-1].place.last

    def append(self, segment: Segment) -> None:
        """Add the next segment.

        Raises:
            ToolpathError: it is out of sequence or does not start where the one before ends.
        """
        if self._segments:
            before = self._segments[-1]
            if segment.place.sequence != before.place.sequence + 1:
                raise ToolpathError(
                    f"segment {segment.place.sequence} came after {before.place.sequence}: one is lost, send all again",
                    line=segment.place.source_line,
                )
        elif segment.place.sequence != 1:
            raise ToolpathError(
                f"the first segment has sequence {segment.place.sequence}: the start of the program is lost"
            )
        ends = segment.evaluate(np.array([0.0, segment.length_mm]))
        if self._newest is not None:
            _check_joint(self._segments[-1], self._newest, segment, ends)
        place, joints = segment.place, segment.place.s_start_mm + segment.joints_mm
        end_mm = place.s_start_mm + segment.length_mm
        if self._packed is None:
            self._packed = PackedPath(segment.packed.dimensions)
        self._packed.append(segment.packed, place.s_start_mm)
        self._segments.append(segment)
        self._newest = ends
        extent = (place.s_start_mm, end_mm, place.feed_limit_mm_s, place.exact_stop, place.dwell_s)
        self._extents.append(np.array([extent], _EXTENT))
        # One joint where two segments meet, however their lengths were rounded.
        self._joints.shorten(min(1, len(self._joints)))
        self._joints.append(joints)

    def discard_before(self, s_mm: float) -> None:
        """Forget the segments that end before an arc length."""
        count = max(0, int(np.searchsorted(self._starts, s_mm, side="right")) - 1)
        if count and self._packed is not None:
            for _ in range(count):
                self._packed.drop(self._segments.popleft().packed)
            self._extents.drop(count)
            self._joints.drop(int(np.searchsorted(self._joints.held, self._segments[0].place.s_start_mm)))

    @property
    def _starts(self) -> FloatArray:
        return np.asarray(self._extents.held["start_mm"])

    def evaluate(self, s_mm: FloatArray) -> PathPoints:
        """Path at arc lengths inside the part that is held, shape (n,), in any order.

        Raises:
            ToolpathError: an arc length lies outside that part.
        """
        s_mm = np.asarray(s_mm, dtype=np.float64)
        return self._holding(s_mm).points(s_mm)

    def axis_derivatives(self, s_mm: FloatArray, axis_matrix: FloatArray) -> FloatArray:
        """First three derivatives of the axis positions K r at arc lengths inside the part that is held.

        Args:
            s_mm: shape (n,), in any order.
            axis_matrix: axis map K, shape (n_axes, dimensions).

        Returns:
            Shape (3, n_axes, n).

        Raises:
            ToolpathError: an arc length lies outside that part, or the axis map has other dimensions than the path.
        """
        s_mm = np.asarray(s_mm, dtype=np.float64)
        derivatives = self._holding(s_mm).derivatives(s_mm)
        if axis_matrix.shape[1] != derivatives.shape[2]:
            raise ToolpathError(
                f"the path has {derivatives.shape[2]} coordinates, "
                f"the axes of the machine follow {axis_matrix.shape[1]}"
            )
        return mapped(np.ascontiguousarray(axis_matrix), derivatives)

    def _holding(self, s_mm: FloatArray) -> PackedPath:
        """The path, where it holds all of these arc lengths."""
        slack = 1e-9 * max(1.0, self.end_mm)
        low, high = float(np.min(s_mm, initial=np.inf)), float(np.max(s_mm, initial=-np.inf))
        # This form refuses a NaN as well.
        inside = low >= self.start_mm - slack and high <= self.end_mm + slack
        if self._packed is None or not (inside or not len(s_mm)):
            raise ToolpathError(
                f"s from {low:g} to {high:g} mm is outside the path, {self.start_mm:g} to {self.end_mm:g} mm"
            )
        return self._packed

    def feed_limits_mm_s(self, s_mm: FloatArray) -> FloatArray:
        """Programmed feed at arc lengths, shape (n,); the lower one at a joint."""
        starts, limits = (np.ascontiguousarray(self._extents.held[name]) for name in ("start_mm", "feed_limit_mm_s"))
        return lowest_at(starts, limits, np.ascontiguousarray(s_mm, dtype=np.float64))

    def joints_mm(self, start_mm: float, end_mm: float) -> FloatArray:
        """Arc lengths where a derivative of the path may jump, increasing.

        From the last one at or before start_mm to the first one at or behind end_mm.
        """
        every = self._joints.held
        first = max(0, int(np.searchsorted(every, start_mm, side="right")) - 1)
        return np.asarray(every[first : int(np.searchsorted(every, end_mm, side="left")) + 1].copy())

    def bend_length_mm(self, s_mm: FloatArray) -> FloatArray:
        """Length over which the path bends noticeably at arc lengths, shape (n,).

        With k the curvature vector, the smaller of ``1 / |k|`` and ``1 / sqrt |dk/ds|``.
        """
        return bend_lengths(self._holding(s_mm).derivatives(s_mm))

    def exact_stops_mm(self) -> FloatArray:
        """Arc lengths of the ends of segments where the machine must come to rest, increasing."""
        extents = self._extents.held
        return np.asarray(extents["end_mm"][extents["exact_stop"]])

    def dwell_s(self, s_mm: float) -> float:
        """Time to wait at an arc length where the machine rests; 0 where no dwell is programmed."""
        extents = self._extents.held
        first, last = np.searchsorted(extents["end_mm"], [s_mm - JOINT_TOLERANCE_MM, s_mm + JOINT_TOLERANCE_MM])
        return float(np.max(extents["dwell_s"][first:last], initial=0.0))


def _check_joint(before: Segment, before_ends: PathPoints, after: Segment, after_ends: PathPoints) -> None:
    name, line = f"segment {after.place.sequence}", after.place.source_line
    if before.place.last:
        raise ToolpathError(f"{name} comes after the last one of its program", line=line)
    expected_mm = before.place.s_start_mm + before.length_mm
    if not abs(after.place.s_start_mm - expected_mm) <= JOINT_TOLERANCE_MM * max(1.0, expected_mm):
        raise ToolpathError(
            f"{name} starts at s = {after.place.s_start_mm:g} mm, the one before ends at {expected_mm:g} mm", line=line
        )
    end_mm = before_ends.r_mm[1]
    gap_mm = _distance(after_ends.r_mm[0], end_mm)
    if not gap_mm <= JOINT_TOLERANCE_MM * max(1.0, *map(abs, end_mm.tolist())):
        raise ToolpathError(f"{name} starts {gap_mm:g} mm from the end of the one before", line=line)
    turn = _distance(after_ends.dr_ds[0], before_ends.dr_ds[1])
    if not before.place.exact_stop and not turn <= JOINT_TOLERANCE:
        raise ToolpathError(
            f"{name} turns by {turn:g} rad from the one before: smooth the corner or stop there", line=line
        )


def _distance(first: FloatArray, second: FloatArray) -> float:
    return math.dist(first.tolist(), second.tolist())
