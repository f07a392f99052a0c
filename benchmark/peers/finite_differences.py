"""Independent check of set points with its own path and finite differences, without feedopt_core.

The path is built from the points of the program: scipy's cubic spline over chord length, its arc length by
Gauss-Legendre quadrature, its inverse by Newton's method. Positions at the given arc lengths, extended by standstill,
are differenced by repeated subtraction.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

FloatArray = NDArray[np.float64]

_NODES = 16
_PIECES_AN_INTERVAL = 4
_REST_TICKS = 10
_CLOSED_MM = 1e-9


class ChordSpline:
    """C2 cubic spline through the points of a CSV file over chord length, evaluated by arc length."""

    def __init__(self, points_csv: Path) -> None:
        points_mm = np.loadtxt(points_csv, delimiter=",", skiprows=1)
        chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_mm, axis=0), axis=1))])
        closed = bool(np.linalg.norm(points_mm[-1] - points_mm[0]) <= _CLOSED_MM)
        self._spline = CubicSpline(chord, points_mm, bc_type="periodic" if closed else "not-a-knot")
        self._slope = self._spline.derivative()
        fractions = np.arange(_PIECES_AN_INTERVAL) / _PIECES_AN_INTERVAL
        starts = chord[:-1, None] + np.diff(chord)[:, None] * fractions
        self._edges = np.append(starts.ravel(), chord[-1])
        self._lengths_mm = np.concatenate([[0.0], np.cumsum(self._length(self._edges[:-1], self._edges[1:]))])

    @property
    def length_mm(self) -> float:
        return float(self._lengths_mm[-1])

    def position_mm(self, s_mm: FloatArray) -> FloatArray:
        """Position at arc lengths, shape (n,) to (n, dimensions)."""
        s_mm = np.clip(s_mm, 0.0, self.length_mm)
        piece = np.clip(np.searchsorted(self._lengths_mm, s_mm, side="right") - 1, 0, len(self._edges) - 2)
        start, wanted = self._edges[piece], s_mm - self._lengths_mm[piece]
        u = start + wanted / np.linalg.norm(self._slope(start), axis=1)
        for _ in range(8):
            u -= (self._length(start, u) - wanted) / np.linalg.norm(self._slope(u), axis=1)
        return np.asarray(self._spline(u))

    def _length(self, start: FloatArray, end: FloatArray) -> FloatArray:
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        half = 0.5 * (end - start)
        u = start[:, None] + half[:, None] * (1.0 + nodes)
        speed = np.linalg.norm(self._slope(u.ravel()), axis=1).reshape(u.shape)
        return np.asarray(half * (speed @ weights))


def worst_differences(position_mm: FloatArray, period_s: float) -> dict[str, FloatArray]:
    """Largest velocity, acceleration and jerk of each column, including standstill before and after.

    Args:
        position_mm: equidistant positions, shape (n, columns).
        period_s: time between them.

    Returns:
        Arrays of shape (columns,) under ``velocity``, ``acceleration`` and ``jerk``; mm and s.
    """
    before, after = np.repeat(position_mm[:1], _REST_TICKS, axis=0), np.repeat(position_mm[-1:], _REST_TICKS, axis=0)
    values = np.concatenate([before, position_mm, after])
    worst = {}
    for name in ("velocity", "acceleration", "jerk"):
        values = (values[1:] - values[:-1]) / period_s
        worst[name] = np.max(np.abs(values), axis=0)
    return worst
