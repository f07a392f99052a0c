"""Position and derivatives from arc length, compiled: one pass over points, whatever the segments they lie on.

A planar segment is one piece, a NURBS segment one piece for each piece of its arc-length map. A span of a curve is a
stretch of one flat array: the parameter it starts at, then the homogeneous coefficients, highest power first,
``dimensions + 1`` a power. Its place there is counted from the start of the program; ``curve_first`` is the place of
the first one that is held.
"""

from __future__ import annotations

import math

import numpy as np

from feedopt_core.arrays import FloatArray, RecordArray, record
from feedopt_core.compiled import compiled
from feedopt_core.geometry.quadrature import gauss_legendre

PLANAR, NURBS = 0, 1
"""Kinds of pieces."""
PIECE = record(
    segment_start_mm="f8",
    segment_length_mm="f8",
    kind="i8",
    slope="f8",
    curvature_per_mm="f8",
    sharpness_per_mm2="f8",
    start_mm="3f8",
    tangent="3f8",
    normal="3f8",
    rise="3f8",
    map_start_mm="f8",
    map_length_mm="f8",
    map_u="8f8",
    degree="i8",
    first_span="i8",
    last_span="i8",
    own_span="i8",
)
"""A piece of the path: its segment and kind, then the fields of its kind; those of the other kind are zero.

PLANAR: in-plane part of the tangent (slope), curvature at the start and its change, start, and the directions of
:class:`~feedopt_core.geometry.segments.PlanarSegment`. NURBS: where the piece of the arc-length map starts in the
segment, its length and u(z), lowest power first; degree of the curve, places of its first and last span and of the span
at the start of the piece.
"""
_FIRST, _SECOND, _THIRD = 0, 1, 2
"""Places of the derivatives of the path."""
_VALUE, _SLOPE, _BEND, _CHANGE = 0, 1, 2, 3
"""Places of the homogeneous coordinates of a curve and of their derivatives by its parameter."""
_NODES, _WEIGHTS = gauss_legendre(12)
_LEAST_BEND_PER_MM = 1e-12


@compiled
def curve_points(spans: FloatArray, degree: int, u: FloatArray, r: FloatArray, derivatives: FloatArray) -> None:
    """Position and three derivatives of a NURBS curve with respect to its parameter.

    Args:
        spans: of the curve, shape (m, 1 + (degree + 1) (dimensions + 1)).
        degree: of the curve.
        u: parameters, shape (n,).
        r: shape (n, dimensions), filled.
        derivatives: shape (3, n, dimensions), filled.
    """
    stride, homogeneous = spans.shape[1], np.empty((4, r.shape[1] + 1))
    last = stride * (spans.shape[0] - 1)
    _curve_run(spans.reshape(-1), (degree, 0, 0, last), u, (0, len(u)), homogeneous, r, derivatives)


@compiled
def path_points(
    starts: FloatArray,
    pieces: RecordArray,
    curve: FloatArray,
    curve_first: int,
    s: FloatArray,
    r: FloatArray,
    derivatives: FloatArray,
) -> None:
    """Path at arc lengths.

    Args:
        starts: arc length at the start of each piece, increasing, shape (m,).
        pieces: of type PIECE, shape (m,).
        curve: spans of all curves.
        curve_first: place of the first of them.
        s: arc lengths, shape (n,); fastest where they increase.
        r: shape (n, dimensions), filled with the position; without rows, the position is not computed.
        derivatives: shape (3, n, dimensions), filled with dr/ds, d2r/ds2 and d3r/ds3.
    """
    homogeneous, parameter = np.empty((4, derivatives.shape[2] + 1)), np.empty(len(s))
    at = begin = 0
    while begin < len(s):
        at = _piece(starts, s[begin], at)
        # Neighbouring points on the same piece go together.
        low = starts[at] if at > 0 else -math.inf
        high = starts[at + 1] if at + 1 < len(starts) else math.inf
        end = begin + 1
        while end < len(s) and low <= s[end] < high:
            end += 1
        piece = pieces[at]
        if piece.kind == PLANAR:
            _planar_run(piece, s, begin, end, r, derivatives)
        else:
            _parameters(piece, s, begin, end, parameter)
            first, last, own = piece.first_span, piece.last_span, piece.own_span
            spans = (piece.degree, own - curve_first, first - curve_first, last - curve_first)
            _curve_run(curve, spans, parameter, (begin, end), homogeneous, r, derivatives)
            _by_arc_length(derivatives, begin, end)
        begin = end


@compiled
def mapped(axis_matrix: FloatArray, derivatives: FloatArray) -> FloatArray:
    """The derivatives of the axes, shape (3, n_axes, n).

    Args:
        axis_matrix: axis map K, shape (n_axes, dimensions).
        derivatives: shape (3, n, dimensions), as :func:`path_points` fills them.
    """
    axes, dimensions = axis_matrix.shape
    out = np.empty((3, axes, derivatives.shape[1]))
    for order in range(3):
        for axis in range(axes):
            for i in range(derivatives.shape[1]):
                value = 0.0
                for d in range(dimensions):
                    value += axis_matrix[axis, d] * derivatives[order, i, d]
                out[order, axis, i] = value
    return out


@compiled
def lowest_at(starts: FloatArray, values: FloatArray, s: FloatArray) -> FloatArray:
    """Value of the piece that holds an arc length, shape (n,); the lower one of both at a joint.

    Args:
        starts: arc length at the start of each piece, increasing, shape (m,).
        values: of the pieces, shape (m,).
        s: arc lengths, shape (n,).
    """
    out = np.empty(len(s))
    at = 0
    for i in range(len(s)):
        at = _piece(starts, s[i], at)
        out[i] = min(values[at], values[at - 1]) if at > 0 and s[i] == starts[at] else values[at]
    return out


@compiled
def bend_lengths(derivatives: FloatArray) -> FloatArray:
    """Length over which the path bends, ``min(1 / |k|, 1 / sqrt |dk/ds|)`` with k the curvature vector, shape (n,).

    Args:
        derivatives: shape (3, n, dimensions), as :func:`path_points` fills them.
    """
    out = np.empty(derivatives.shape[1])
    for i in range(len(out)):
        bend, change = 0.0, 0.0
        for d in range(derivatives.shape[2]):
            bend += derivatives[_SECOND, i, d] ** 2
            change += derivatives[_THIRD, i, d] ** 2
        out[i] = 1.0 / max(math.sqrt(bend), math.sqrt(math.sqrt(change)), _LEAST_BEND_PER_MM)
    return out


@compiled
def _piece(starts: FloatArray, s: float, guess: int) -> int:
    """Piece that holds an arc length, the later one at a joint. Starts at a guess, which is right most often."""
    last = len(starts) - 1
    for at in range(guess, min(guess + 2, last + 1)):
        if starts[at] <= s and (at == last or s < starts[at + 1]):
            return at
    return max(0, int(np.searchsorted(starts, s, side="right")) - 1)


@compiled
def _planar_run(piece: np.record, s: FloatArray, begin: int, end: int, r: FloatArray, derivatives: FloatArray) -> None:
    """Line, arc, clothoid or helix: the heading is quadratic in the in-plane arc length."""
    start, length = piece.segment_start_mm, piece.segment_length_mm
    slope, start_curvature, sharpness = piece.slope, piece.curvature_per_mm, piece.sharpness_per_mm2
    origin, tangent, normal, rise = piece.start_mm, piece.tangent, piece.normal, piece.rise
    for i in range(begin, end):
        local = min(max(s[i] - start, 0.0), length)
        x = local * slope
        angle = x * (start_curvature + 0.5 * sharpness * x)
        curvature = start_curvature + sharpness * x
        cos, sin = math.cos(angle), math.sin(angle)
        for d in range(derivatives.shape[2]):
            along = cos * tangent[d] + sin * normal[d]
            across = cos * normal[d] - sin * tangent[d]
            derivatives[_FIRST, i, d] = slope * along + rise[d]
            derivatives[_SECOND, i, d] = slope**2 * curvature * across
            derivatives[_THIRD, i, d] = slope**3 * (sharpness * across - curvature**2 * along)
        if len(r) > 0:
            ahead, aside = _displacement(x, start_curvature, sharpness)
            for d in range(derivatives.shape[2]):
                r[i, d] = origin[d] + ahead * tangent[d] + aside * normal[d] + local * rise[d]


@compiled
def _displacement(x: float, curvature: float, sharpness: float) -> tuple[float, float]:
    """In-plane displacement ahead and aside: integrals of cos and sin of the heading."""
    if sharpness == 0.0:
        half = 0.5 * x * curvature
        chord = x if half == 0.0 else x * math.sin(half) / half
        return chord * math.cos(half), chord * math.sin(half)
    # Gauss-Legendre panels of at most one radian: exact to rounding.
    panels = max(1, math.ceil(abs(x) * (abs(curvature) + abs(sharpness * x))))
    ahead, aside = 0.0, 0.0
    for panel in range(panels):
        for node in range(len(_NODES)):
            at = x * (panel + _NODES[node]) / panels
            angle = at * (curvature + 0.5 * sharpness * at)
            ahead += _WEIGHTS[node] * math.cos(angle)
            aside += _WEIGHTS[node] * math.sin(angle)
    return ahead * x / panels, aside * x / panels


@compiled
def _parameters(piece: np.record, s: FloatArray, begin: int, end: int, u: FloatArray) -> None:
    """Curve parameters of points on one piece of an arc-length map, filled."""
    start, length, map_u = piece.segment_start_mm, piece.segment_length_mm, piece.map_u
    map_start, by_width = piece.map_start_mm, 1.0 / piece.map_length_mm
    for i in range(begin, end):
        z = (min(max(s[i] - start, 0.0), length) - map_start) * by_width
        value = map_u[-1]
        for power in range(len(map_u) - 2, -1, -1):
            value = value * z + map_u[power]
        u[i] = value


@compiled
def _curve_run(
    curve: FloatArray,
    spans: tuple[int, int, int, int],
    u: FloatArray,
    run: tuple[int, int],
    h: FloatArray,
    r: FloatArray,
    derivatives: FloatArray,
) -> None:
    """Position and derivatives with respect to the parameter, filled: homogeneous coordinates by Horner's scheme.

    Then Leibniz' rule for r = (w r) / w.

    Args:
        curve: spans of all curves.
        spans: degree; places of the span to begin with (a guess), of the first one and the last one of this curve.
        u: parameters.
        run: first point, and the one behind the last.
        h: work array, shape (4, dimensions + 1).
        r, derivatives: as in :func:`curve_points`.
    """
    degree, place, first, last = spans
    width = h.shape[1]
    stride = 1 + (degree + 1) * width
    for i in range(run[0], run[1]):
        while place < last and u[i] >= curve[place + stride]:
            place += stride
        while place > first and u[i] < curve[place]:
            place -= stride
        x = u[i] - curve[place]
        for c in range(width):
            at = place + 1 + c
            value, slope, bend, change = curve[at], 0.0, 0.0, 0.0
            for _ in range(degree):
                at += width
                change = change * x + bend
                bend = bend * x + slope
                slope = slope * x + value
                value = value * x + curve[at]
            h[_VALUE, c], h[_SLOPE, c], h[_BEND, c], h[_CHANGE, c] = value, slope, 2.0 * bend, 6.0 * change
        w = width - 1
        by, w_u, w_uu, w_uuu = 1.0 / h[_VALUE, w], h[_SLOPE, w], h[_BEND, w], h[_CHANGE, w]
        for d in range(width - 1):
            value = h[_VALUE, d] * by
            slope = (h[_SLOPE, d] - w_u * value) * by
            bend = (h[_BEND, d] - 2.0 * w_u * slope - w_uu * value) * by
            derivatives[_FIRST, i, d], derivatives[_SECOND, i, d] = slope, bend
            derivatives[_THIRD, i, d] = (h[_CHANGE, d] - 3.0 * w_u * bend - 3.0 * w_uu * slope - w_uuu * value) * by
            if len(r) > 0:
                r[i, d] = value


@compiled
def _by_arc_length(derivatives: FloatArray, begin: int, end: int) -> None:
    """From derivatives with respect to a parameter to those with respect to arc length: chain rule, ds/du = |dr/du|."""
    for i in range(begin, end):
        speed2, along, along_u = 0.0, 0.0, 0.0
        for d in range(derivatives.shape[2]):
            r_u, r_uu = derivatives[_FIRST, i, d], derivatives[_SECOND, i, d]
            speed2 += r_u**2
            along += r_u * r_uu
            along_u += r_uu**2 + r_u * derivatives[_THIRD, i, d]
        first = 1.0 / math.sqrt(speed2)
        second = -along / speed2**2
        third = (4.0 * along**2 / speed2 - along_u) / speed2**2 * first
        for d in range(derivatives.shape[2]):
            r_u, r_uu, r_uuu = derivatives[_FIRST, i, d], derivatives[_SECOND, i, d], derivatives[_THIRD, i, d]
            derivatives[_FIRST, i, d] = r_u * first
            derivatives[_SECOND, i, d] = r_uu * first**2 + r_u * second
            derivatives[_THIRD, i, d] = r_uuu * first**3 + 3.0 * r_uu * first * second + r_u * third
