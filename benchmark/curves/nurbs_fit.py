"""NURBS segments fitted to points by least squares, joined with G2 continuity by beta constraints.

The construction of the NURBS thesis (section 3.2): the points are divided into segments that share their ends; each
segment gets as many control points as it has points, chord-length parameters (eq. 3.4) and averaged knots (eq. 3.5);
the control points minimise the squared distances (eq. 3.11) under the constraints at the joints (eq. 3.15, 3.16)

    C_k'(0) = b C_{k-1}'(1),    C_k''(0) = b^2 C_{k-1}''(1),

one factor b a joint (its beta 1; its beta 2 is zero), solved with Lagrange multipliers (eq. 3.29).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import block_array, csc_array, lil_array
from scipy.sparse.linalg import splu

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.nurbs import NurbsCurve

_DEGREE = 3
_LEAST_INTERVALS = 3
_CLOSED_MM = 1e-9
_LEAST_CHORD_MM = 1e-9
_LARGEST_RESIDUAL = 1e-8


@dataclass(frozen=True)
class PointSegment:
    """Points that one NURBS segment is fitted to.

    Attributes:
        points_mm: shape (n, dimensions).
        parameters: by chord length, 0 to 1, shape (n,).
        knots: averaged, clamped, shape (n + 4,).
        chord_length_mm: sum of the chords.
    """

    points_mm: FloatArray
    parameters: FloatArray
    knots: FloatArray
    chord_length_mm: float


@dataclass(frozen=True)
class NurbsFit:
    """Cubic segments with G2 joints, each over [0, 1] with weights 1.

    Attributes:
        curves: the segments, in order.
        betas: factor b of each joint; index k is the joint after segment k, the last one closes a closed contour.
        distances_mm: from each point to the curve at the point's parameter, shape (m,).
    """

    curves: tuple[NurbsCurve, ...]
    betas: FloatArray
    distances_mm: FloatArray


def divide_points(points_mm: FloatArray, intervals: int) -> tuple[PointSegment, ...]:
    """Divide points into segments that share their ends; the last segment also gets the remaining points.

    Args:
        points_mm: shape (m, dimensions), no two neighbours equal.
        intervals: intervals per segment, at least 3.

    Raises:
        ToolpathError: too few points or intervals, a repeated point or a value that is not finite.
    """
    if intervals < _LEAST_INTERVALS or len(points_mm) <= intervals:
        raise ToolpathError(
            f"{len(points_mm)} points in segments of {intervals} intervals: a cubic segment needs at least "
            f"{_LEAST_INTERVALS} intervals and one point more than that"
        )
    if not np.all(np.isfinite(points_mm)):
        raise ToolpathError("the points contain a value that is not finite")
    chords = np.linalg.norm(np.diff(points_mm, axis=0), axis=1)
    if np.min(chords) < _LEAST_CHORD_MM:
        raise ToolpathError(f"point {int(np.argmin(chords)) + 2} repeats the one before; remove one of them")
    starts = list(range(0, len(chords) - intervals + 1, intervals))
    stops = [*starts[1:], len(chords)]
    return tuple(_point_segment(points_mm[start : stop + 1]) for start, stop in zip(starts, stops, strict=True))


def chord_length_ratios(segments: Sequence[PointSegment]) -> FloatArray:
    """Factors b as ratios of chord lengths: segment after the joint to segment before it (eq. 3.17)."""
    lengths = np.array([segment.chord_length_mm for segment in segments])
    return np.asarray(np.roll(lengths, -1) / lengths)


def knot_span_ratios(segments: Sequence[PointSegment]) -> FloatArray:
    """Factors b as ratios of knot spans: the last span before the joint to the first span after it.

    Appendix A of the thesis prints these values, except for the factors that it marks as set by hand.
    """
    first = np.array([segment.knots[_DEGREE + 1] for segment in segments])
    last = np.array([1.0 - segment.knots[-_DEGREE - 2] for segment in segments])
    return np.asarray(last / np.roll(first, -1))


def fit_nurbs(points_mm: FloatArray, intervals: int = 5, betas: FloatArray | None = None) -> NurbsFit:
    """Fit cubic NURBS segments to points.

    An open curve starts at the first and ends at the last point (eq. 3.12). If the last point repeats the first, the
    contour is closed with the same continuity. Its ends then coincide, but not necessarily at that point, as for the
    control points printed in appendix A of the thesis.

    Args:
        points_mm: shape (m, dimensions), no two neighbours equal.
        intervals: intervals between points per segment.
        betas: factor b of each joint, above zero, as in NurbsFit; None: ratios of chord lengths.

    Raises:
        ToolpathError: see divide_points; factors of wrong number or sign; no curve meets the constraints.
    """
    segments = divide_points(np.asarray(points_mm, dtype=float), intervals)
    closed = float(np.linalg.norm(segments[-1].points_mm[-1] - segments[0].points_mm[0])) <= _CLOSED_MM
    factors = chord_length_ratios(segments) if betas is None else np.asarray(betas, dtype=float)
    if factors.shape != (len(segments),) or not np.all(np.isfinite(factors) & (factors > 0.0)):
        raise ToolpathError(f"needs {len(segments)} finite factors above zero, one a segment, has {factors}")
    constraints, values = _constraints(segments, factors, closed)
    control_mm = _solve(segments, constraints, values)
    curves, distances, first = [], [], 0
    for segment in segments:
        net = control_mm[first : first + len(segment.points_mm)]
        curves.append(NurbsCurve.from_control_net(_DEGREE, segment.knots, net, np.ones(len(net))))
        distances.append(np.linalg.norm(curves[-1].evaluate(segment.parameters)[0] - segment.points_mm, axis=1))
        first += len(net) - 1
    shared = [distances[0], *(each[1:] for each in distances[1:])]
    return NurbsFit(tuple(curves), factors, np.concatenate(shared))


def _point_segment(points_mm: FloatArray) -> PointSegment:
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_mm, axis=0), axis=1))])
    u = along / along[-1]
    inner = [float(np.mean(u[first : first + _DEGREE])) for first in range(1, len(u) - _DEGREE)]
    knots = np.concatenate([np.zeros(_DEGREE + 1), inner, np.ones(_DEGREE + 1)])
    return PointSegment(points_mm, u, knots, float(along[-1]))


def _end_rows(segment: PointSegment, u: float) -> FloatArray:
    """Value, first and second derivative at an end as rows over the control points of the segment, shape (3, n)."""
    basis = BSpline(segment.knots, np.eye(len(segment.points_mm)), _DEGREE)
    return np.stack([basis(u, nu=order) for order in range(3)])


def _constraints(segments: Sequence[PointSegment], factors: FloatArray, closed: bool) -> tuple[lil_array, FloatArray]:
    """Rows over all control points, and their values, shape (rows, dimensions); neighbours share one control point."""
    offsets = np.concatenate([[0], np.cumsum([len(segment.points_mm) - 1 for segment in segments])])
    count, joints = int(offsets[-1]) + 1, len(segments) if closed else len(segments) - 1
    rows = lil_array((2 * joints + (1 if closed else 2), count))
    values = np.zeros((rows.shape[0], segments[0].points_mm.shape[1]))
    for joint in range(joints):
        after = (joint + 1) % len(segments)
        end, start = _end_rows(segments[joint], 1.0), _end_rows(segments[after], 0.0)
        for order in (1, 2):
            row = 2 * joint + order - 1
            for segment, part in ((joint, factors[joint] ** order * end[order]), (after, -start[order])):
                at = slice(int(offsets[segment]), int(offsets[segment + 1]) + 1)
                rows[row, at] = rows[row, at].toarray() + part
    if closed:
        rows[-1, 0], rows[-1, count - 1] = 1.0, -1.0
    else:
        rows[-2, 0], rows[-1, count - 1] = 1.0, 1.0
        values[-2:] = segments[0].points_mm[0], segments[-1].points_mm[-1]
    return rows, values


def _solve(segments: Sequence[PointSegment], constraints: lil_array, values: FloatArray) -> FloatArray:
    """Control points of all segments, shape (m, dimensions): the linear system of eq. 3.29."""
    count = constraints.shape[1]
    regressors = lil_array((count, count))
    offset = 0
    for index, segment in enumerate(segments):
        # The first point of every further segment is the last one of the segment before.
        skip = 1 if index else 0
        local = BSpline.design_matrix(segment.parameters[skip:], segment.knots, _DEGREE).toarray()
        regressors[offset + skip : offset + len(segment.points_mm), offset : offset + len(segment.points_mm)] = local
        offset += len(segment.points_mm) - 1
    points_mm = np.concatenate([segments[0].points_mm, *(segment.points_mm[1:] for segment in segments[1:])])
    phi, xi = csc_array(regressors), csc_array(constraints)
    blocks = [[csc_array(phi.T @ phi), csc_array(xi.T)], [xi, csc_array((len(values), len(values)))]]
    matrix = csc_array(block_array(blocks))
    right = np.concatenate([phi.T @ points_mm, values])
    try:
        solution = splu(matrix).solve(right)
    except RuntimeError as error:
        raise ToolpathError("no curve meets the continuity constraints at every joint; change the factors") from error
    control_mm = np.asarray(solution[:count], dtype=np.float64)
    left_over = np.abs(xi @ control_mm - values)
    allowed = _LARGEST_RESIDUAL * np.max(np.abs(points_mm)) * (1.0 + np.max(np.abs(xi.data)))
    if not np.all(left_over <= allowed):
        raise ToolpathError("no curve meets the continuity constraints at every joint; change the factors")
    return control_mm
