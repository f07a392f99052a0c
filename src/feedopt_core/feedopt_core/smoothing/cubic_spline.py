"""C2 cubic spline through points over chord length, as NURBS segments of several intervals with arc-length maps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import CubicSpline

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.arc_length import ArcLengthMap, StandstillError, map_arc_length
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.geometry.segments import NurbsSegment, SegmentPlace

_CLOSED_MM = 1e-9
_INTERVALS = 8
"""Intervals per segment. Long segments are cheaper to send and evaluate, short ones arrive earlier."""


DEFAULT_TOLERANCE_MM = 0.01
"""Default of the largest distance between smoothed and programmed path."""


def interpolate_points(
    points_mm: FloatArray, source_lines: list[int], tolerance_mm: float = DEFAULT_TOLERANCE_MM
) -> Iterator[NurbsSegment]:
    """Segments of the C2 cubic spline through the points, a few intervals each.

    The spline is periodic where the last point repeats the first; else it is not-a-knot at the ends (natural for two
    points, which is the straight line).

    Args:
        points_mm: shape (n, dimensions), n >= 2, no two neighbours equal.
        source_lines: line of the program of each point.
        tolerance_mm: largest distance of the segments from the points; they pass through them up to rounding.

    Raises:
        ToolpathError: a point is farther from the segments than the tolerance, which is below the rounding error.
        StandstillError: the spline reverses at a point; names the line of the nearest programmed point.
    """
    chords = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_mm, axis=0), axis=1))])
    closed = len(points_mm) > 3 and float(np.linalg.norm(points_mm[-1] - points_mm[0])) <= _CLOSED_MM
    if closed:
        points_mm = points_mm.copy()
        points_mm[-1] = points_mm[0]
    spline = CubicSpline(chords, points_mm, bc_type="periodic" if closed else "not-a-knot")
    count = len(points_mm) - 1
    s_start_mm = 0.0
    for sequence, first in enumerate(range(0, count, _INTERVALS), start=1):
        stop = min(first + _INTERVALS, count)
        try:
            curve, arc_length_map = _piece(spline, first, stop)
        except StandstillError as error:
            nearest = int(np.argmin(np.abs(spline.x - spline.x[first] - error.parameter)))
            error.line, error.column = source_lines[nearest], 1
            raise
        distances = np.linalg.norm(curve.evaluate(curve.joints)[0] - points_mm[first : stop + 1], axis=1)
        if not np.max(distances) <= tolerance_mm:
            worst = int(np.argmax(distances))
            raise ToolpathError(
                f"the smoothed path is {distances[worst]:.3g} mm from here; the tolerance is {tolerance_mm:.3g} mm",
                line=source_lines[first + worst],
                column=1,
            )
        place = SegmentPlace(sequence, source_lines[first], s_start_mm, last=stop == count)
        yield NurbsSegment(place, curve, arc_length_map)
        s_start_mm += arc_length_map.length_mm


def _piece(spline: CubicSpline, first: int, stop: int) -> tuple[NurbsCurve, ArcLengthMap]:
    """Intervals first to stop of the spline as one clamped cubic B-spline over chord length, from 0."""
    joints = spline.x[first : stop + 1] - spline.x[first]
    knots = np.concatenate([np.zeros(3), joints, np.full(3, joints[-1])])
    # Control point i is the blossom of a polynomial in its support, at the three knots after knot i.
    index = np.arange(len(joints) + 2)
    owner = np.clip(index - 2, 0, stop - first - 1)
    a3, a2, a1, a0 = spline.c[:, first + owner]
    p, q, r = (knots[index + offset] - joints[owner] for offset in (1, 2, 3))
    control_mm = (
        a0
        + a1 * ((p + q + r) / 3.0)[:, None]
        + a2 * ((p * q + p * r + q * r) / 3.0)[:, None]
        + a3 * (p * q * r)[:, None]
    )
    curve = NurbsCurve.from_control_net(3, knots, control_mm, np.ones(len(control_mm)))
    return curve, map_arc_length(curve.evaluate, curve.joints)
