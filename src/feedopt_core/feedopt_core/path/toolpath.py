"""The toolpath as it is known so far: segments in order, evaluated at any arc length that is held."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.path.derivatives import PathPoints
from feedopt_core.path.segments import Segment

JOINT_TOLERANCE_MM = 1e-6
JOINT_TOLERANCE = 1e-6


class Toolpath:
    """Segments of one program, appended as they arrive and dropped when they are behind.

    Arc lengths are counted from the start of the program throughout.
    """

    def __init__(self) -> None:
        self._segments: list[Segment] = []
        self._starts: list[float] = []

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The segments held, in order."""
        return tuple(self._segments)

    @property
    def start_mm(self) -> float:
        """Smallest arc length that can be evaluated."""
        return self._starts[0] if self._starts else 0.0

    @property
    def end_mm(self) -> float:
        """Largest arc length that can be evaluated."""
        return self._starts[-1] + self._segments[-1].length_mm if self._segments else 0.0

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
            _check_joint(before, segment)
        elif segment.place.sequence != 1:
            raise ToolpathError(
                f"the first segment has sequence {segment.place.sequence}: the start of the program is lost"
            )
        self._segments.append(segment)
        self._starts.append(segment.place.s_start_mm)

    def discard_before(self, s_mm: float) -> None:
        """Forget the segments that end before an arc length."""
        count = max(0, int(np.searchsorted(self._starts, s_mm, side="right")) - 1)
        del self._segments[:count]
        del self._starts[:count]

    def evaluate(self, s_mm: FloatArray) -> PathPoints:
        """Path at arc lengths inside the part that is held, shape (n,), in any order.

        Raises:
            ToolpathError: an arc length lies outside that part.
        """
        s_mm = np.asarray(s_mm, dtype=float)
        slack = 1e-9 * max(1.0, self.end_mm)
        if not self._segments or not np.all((s_mm >= self.start_mm - slack) & (s_mm <= self.end_mm + slack)):
            raise ToolpathError(
                f"s from {np.min(s_mm, initial=np.inf):g} to {np.max(s_mm, initial=-np.inf):g} mm is outside the path, "
                f"{self.start_mm:g} to {self.end_mm:g} mm"
            )
        owner = np.clip(np.searchsorted(self._starts, s_mm, side="right") - 1, 0, len(self._segments) - 1)
        first = self._segments[int(owner[0])].evaluate(np.zeros(0)) if s_mm.size else None
        dimensions = first.r_mm.shape[1] if first else 2
        out = [np.empty((len(s_mm), dimensions)) for _ in range(4)]
        order = np.argsort(owner, kind="stable")
        edges = np.flatnonzero(np.diff(owner[order])) + 1
        for group in np.split(order, edges) if s_mm.size else ():
            index = int(owner[group[0]])
            segment = self._segments[index]
            local = np.clip(s_mm[group] - self._starts[index], 0.0, segment.length_mm)
            points = segment.evaluate(local)
            for array, values in zip(out, (points.r_mm, points.dr_ds, points.d2r_ds2, points.d3r_ds3), strict=True):
                array[group] = values
        return PathPoints(*out)

    def feed_limits_mm_s(self, s_mm: FloatArray) -> FloatArray:
        """Programmed feed at arc lengths, shape (n,); the lower one at a joint."""
        limits = np.array([segment.place.feed_limit_mm_s for segment in self._segments])
        right = np.clip(np.searchsorted(self._starts, s_mm, side="right") - 1, 0, len(limits) - 1)
        left = np.clip(np.searchsorted(self._starts, s_mm, side="left") - 1, 0, len(limits) - 1)
        return np.asarray(np.minimum(limits[left], limits[right]))

    def joints_mm(self, start_mm: float, end_mm: float) -> FloatArray:
        """Arc lengths where a derivative of the path may jump, increasing.

        From the last one at or before start_mm to the first one at or behind end_mm.
        """
        joints = [
            start + segment.joints_mm
            for start, segment in zip(self._starts, self._segments, strict=True)
            if start < end_mm and start + segment.length_mm > start_mm
        ]
        every = np.unique(np.concatenate(joints))
        first = max(0, int(np.searchsorted(every, start_mm, side="right")) - 1)
        return every[first : int(np.searchsorted(every, end_mm, side="left")) + 1]

    def bend_length_mm(self, s_mm: FloatArray) -> FloatArray:
        """Length over which the path bends noticeably at arc lengths, shape (n,).

        With k the curvature vector, the smaller of ``1 / |k|`` and ``1 / sqrt |dk/ds|``.
        """
        points = self.evaluate(s_mm)
        bend = np.maximum(np.linalg.norm(points.d2r_ds2, axis=1), np.sqrt(np.linalg.norm(points.d3r_ds3, axis=1)))
        return np.asarray(1.0 / np.maximum(bend, 1e-12))

    def exact_stops_mm(self) -> FloatArray:
        """Arc lengths of the ends of segments where the machine must come to rest, increasing."""
        return np.array(
            [
                start + segment.length_mm
                for start, segment in zip(self._starts, self._segments, strict=True)
                if segment.place.exact_stop
            ]
        )

    def dwell_s(self, s_mm: float) -> float:
        """Time to wait at an arc length where the machine rests; 0 where no dwell is programmed."""
        return max(
            (
                segment.place.dwell_s
                for start, segment in zip(self._starts, self._segments, strict=True)
                if abs(start + segment.length_mm - s_mm) <= JOINT_TOLERANCE_MM
            ),
            default=0.0,
        )


def _check_joint(before: Segment, after: Segment) -> None:
    name, line = f"segment {after.place.sequence}", after.place.source_line
    if before.place.last:
        raise ToolpathError(f"{name} comes after the last one of its program", line=line)
    expected_mm = before.place.s_start_mm + before.length_mm
    if not abs(after.place.s_start_mm - expected_mm) <= JOINT_TOLERANCE_MM * max(1.0, expected_mm):
        raise ToolpathError(
            f"{name} starts at s = {after.place.s_start_mm:g} mm, the one before ends at {expected_mm:g} mm", line=line
        )
    end, start = before.evaluate(np.array([before.length_mm])), after.evaluate(np.zeros(1))
    gap_mm = float(np.linalg.norm(start.r_mm - end.r_mm))
    if not gap_mm <= JOINT_TOLERANCE_MM * max(1.0, float(np.max(np.abs(end.r_mm)))):
        raise ToolpathError(f"{name} starts {gap_mm:g} mm from the end of the one before", line=line)
    turn = float(np.linalg.norm(start.dr_ds - end.dr_ds))
    if not before.place.exact_stop and not turn <= JOINT_TOLERANCE:
        raise ToolpathError(
            f"{name} turns by {turn:g} rad from the one before: smooth the corner or stop there", line=line
        )
