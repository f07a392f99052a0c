"""Position and derivatives from arc length, compiled: one pass over points, whatever the segments they lie on.

A planar segment is one row, a NURBS segment one row for each piece of its arc-length map. Columns of a row:

    0 start of its segment, 1 length of its segment, 2 kind
    PLANAR  3 slope, 4 curvature, 5 sharpness, 6 start[3], 9 tangent[3], 12 normal[3], 15 rise[3]
    NURBS   3 start in the segment, 4 length, 5 u(z)[8], lowest power first, 13 degree,
            14 first, 15 last, 16 own span of the curve

(slope: in-plane part of the tangent). A span of a curve is a stretch of one flat array: the parameter it starts at,
then the homogeneous coefficients, highest power first, ``dimensions + 1`` a power. Its place there is counted from the
start of the program; ``curve_first`` is the place of the first one that is held.
"""

from __future__ import annotations

import math

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.compiled import compiled
from feedopt_core.geometry.quadrature import gauss_legendre

COLUMNS = 18
PLANAR, NURBS = 0.0, 1.0
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
    rows: FloatArray,
    curve: FloatArray,
    curve_first: int,
    s: FloatArray,
    r: FloatArray,
    derivatives: FloatArray,
) -> None:
    """Path at arc lengths.

    Args:
        starts: arc length at the start of each row, increasing, shape (m,).
        rows: shape (m, COLUMNS).
        curve: spans of all curves.
        curve_first: place of the first of them.
        s: arc lengths, shape (n,); fastest where they increase.
        r: shape (n, dimensions), filled with the position; where it has no row, the position is not computed.
        derivatives: shape (3, n, dimensions), filled with dr/ds, d2r/ds2 and d3r/ds3.
    """
    homogeneous, parameter = np.empty((4, derivatives.shape[2] + 1)), np.empty(len(s))
    at = begin = 0
    while begin < len(s):
        at = _row(starts, s[begin], at)
        # Neighbouring points on the same row go together.
        low = starts[at] if at > 0 else -math.inf
        high = starts[at + 1] if at + 1 < len(starts) else math.inf
        end = begin + 1
        while end < len(s) and low <= s[end] < high:
            end += 1
        if rows[at, 2] == PLANAR:
            _planar_run(rows, at, s, begin, end, r, derivatives)
        else:
            _parameters(rows, at, s, begin, end, parameter)
            first, last, own = int(rows[at, 14]), int(rows[at, 15]), int(rows[at, 16])
            spans = (int(rows[at, 13]), own - curve_first, first - curve_first, last - curve_first)
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
    """Value of the row that holds an arc length, shape (n,); the lower one of both at a joint.

    Args:
        starts: arc length at the start of each row, increasing, shape (m,).
        values: of the rows, shape (m,).
        s: arc lengths, shape (n,).
    """
    out = np.empty(len(s))
    at = 0
    for i in range(len(s)):
        at = _row(starts, s[i], at)
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
            bend += derivatives[1, i, d] ** 2
            change += derivatives[2, i, d] ** 2
        out[i] = 1.0 / max(math.sqrt(bend), math.sqrt(math.sqrt(change)), _LEAST_BEND_PER_MM)
    return out


@compiled
def _row(starts: FloatArray, s: float, guess: int) -> int:
    """Row that holds an arc length, the later one at a joint; the one behind the guess is right most often."""
    last = len(starts) - 1
    for at in range(guess, min(guess + 2, last + 1)):
        if starts[at] <= s and (at == last or s < starts[at + 1]):
            return at
    return max(0, int(np.searchsorted(starts, s, side="right")) - 1)


@compiled
def _planar_run(
    rows: FloatArray, at: int, s: FloatArray, begin: int, end: int, r: FloatArray, derivatives: FloatArray
) -> None:
    """Line, arc, clothoid or helix: the heading is quadratic in the in-plane arc length."""
    start, length = rows[at, 0], rows[at, 1]
    slope, start_curvature, sharpness = rows[at, 3], rows[at, 4], rows[at, 5]
    for i in range(begin, end):
        local = min(max(s[i] - start, 0.0), length)
        x = local * slope
        angle = x * (start_curvature + 0.5 * sharpness * x)
        curvature = start_curvature + sharpness * x
        cos, sin = math.cos(angle), math.sin(angle)
        for d in range(derivatives.shape[2]):
            along = cos * rows[at, 9 + d] + sin * rows[at, 12 + d]
            across = cos * rows[at, 12 + d] - sin * rows[at, 9 + d]
            derivatives[0, i, d] = slope * along + rows[at, 15 + d]
            derivatives[1, i, d] = slope**2 * curvature * across
            derivatives[2, i, d] = slope**3 * (sharpness * across - curvature**2 * along)
        if len(r) > 0:
            ahead, aside = _displacement(x, start_curvature, sharpness)
            for d in range(derivatives.shape[2]):
                r[i, d] = (
                    rows[at, 6 + d] + ahead * rows[at, 9 + d] + aside * rows[at, 12 + d] + local * rows[at, 15 + d]
                )


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
def _parameters(rows: FloatArray, at: int, s: FloatArray, begin: int, end: int, u: FloatArray) -> None:
    """Curve parameters of points on one piece of an arc-length map, filled."""
    start, length, piece, by_width = rows[at, 0], rows[at, 1], rows[at, 3], 1.0 / rows[at, 4]
    for i in range(begin, end):
        z = (min(max(s[i] - start, 0.0), length) - piece) * by_width
        value = rows[at, 12]
        for power in range(11, 4, -1):
            value = value * z + rows[at, power]
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
            h[0, c], h[1, c], h[2, c], h[3, c] = value, slope, 2.0 * bend, 6.0 * change
        by, w_u, w_uu, w_uuu = 1.0 / h[0, width - 1], h[1, width - 1], h[2, width - 1], h[3, width - 1]
        for d in range(width - 1):
            value = h[0, d] * by
            slope = (h[1, d] - w_u * value) * by
            bend = (h[2, d] - 2.0 * w_u * slope - w_uu * value) * by
            derivatives[0, i, d], derivatives[1, i, d] = slope, bend
            derivatives[2, i, d] = (h[3, d] - 3.0 * w_u * bend - 3.0 * w_uu * slope - w_uuu * value) * by
            if len(r) > 0:
                r[i, d] = value


@compiled
def _by_arc_length(derivatives: FloatArray, begin: int, end: int) -> None:
    """From derivatives with respect to a parameter to those with respect to arc length: chain rule, ds/du = |dr/du|."""
    for i in range(begin, end):
        speed2, along, along_u = 0.0, 0.0, 0.0
        for d in range(derivatives.shape[2]):
            r_u, r_uu = derivatives[0, i, d], derivatives[1, i, d]
            speed2 += r_u**2
            along += r_u * r_uu
            along_u += r_uu**2 + r_u * derivatives[2, i, d]
        first = 1.0 / math.sqrt(speed2)
        second = -along / speed2**2
        third = (4.0 * along**2 / speed2 - along_u) / speed2**2 * first
        for d in range(derivatives.shape[2]):
            r_u, r_uu, r_uuu = derivatives[0, i, d], derivatives[1, i, d], derivatives[2, i, d]
            derivatives[0, i, d] = r_u * first
            derivatives[1, i, d] = r_uu * first**2 + r_u * second
            derivatives[2, i, d] = r_uuu * first**3 + 3.0 * r_uu * first * second + r_u * third
