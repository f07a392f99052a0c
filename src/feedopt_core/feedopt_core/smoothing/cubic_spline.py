"""C2 cubic spline through points over chord length, as NURBS segments with arc-length maps."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from feedopt_core.arrays import FloatArray
from feedopt_core.path.arc_length import ArcLengthMap, map_arc_length
from feedopt_core.path.nurbs import NurbsCurve, bezier_from_power, bezier_knots
from feedopt_core.path.segments import NurbsSegment, SegmentPlace

_CLOSED_MM = 1e-9
_BLOCK = 64


def interpolate_points(points_mm: FloatArray, source_lines: list[int]) -> Iterator[NurbsSegment]:
    """Segments of the C2 cubic spline through the points, one an interval.

    The spline is periodic where the last point repeats the first; else it is not-a-knot at the ends (natural for two
    points, which is the straight line).

    Args:
        points_mm: shape (n, dimensions), n >= 2, no two neighbours equal.
        source_lines: line of the program of each point.
    """
    chords = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_mm, axis=0), axis=1))])
    closed = len(points_mm) > 3 and float(np.linalg.norm(points_mm[-1] - points_mm[0])) <= _CLOSED_MM
    if closed:
        points_mm = points_mm.copy()
        points_mm[-1] = points_mm[0]
    spline = CubicSpline(chords, points_mm, bc_type="periodic" if closed else "not-a-knot")
    count = len(points_mm) - 1
    s_start_mm = 0.0
    for first in range(0, count, _BLOCK):
        block = range(first, min(first + _BLOCK, count))
        for index, arc_length_map in zip(block, _maps(spline, chords[first : block.stop + 1]), strict=True):
            control = bezier_from_power(spline.c[::-1, index], float(chords[index + 1] - chords[index]))
            place = SegmentPlace(index + 1, source_lines[index], s_start_mm, last=index == count - 1)
            curve = NurbsCurve.from_control_net(3, bezier_knots(3), control, np.ones(4))
            yield NurbsSegment(place, curve, arc_length_map)
            s_start_mm += arc_length_map.length_mm


def _maps(spline: CubicSpline, chords: FloatArray) -> Iterator[ArcLengthMap]:
    """Arc-length map of each interval to its Bezier parameter in [0, 1]; one quadrature for the whole block."""
    derivatives = [spline.derivative(order) for order in (1, 2, 3)]
    whole = map_arc_length(lambda u: (spline(u), *(derivative(u) for derivative in derivatives)), chords)
    starts = np.searchsorted(whole.coefficients[:, 0], chords[:-1])
    for k, (start, stop) in enumerate(pairwise([*starts, len(whole.coefficients)])):
        coefficients = whole.coefficients[start:stop].copy()
        coefficients[:, 0] -= chords[k]
        coefficients /= chords[k + 1] - chords[k]
        s_mm = whole.s_mm[start : stop + 1]
        yield ArcLengthMap(s_mm - s_mm[0], coefficients, whole.error_mm)
