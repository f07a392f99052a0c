"""Knots of the feed profile and the quadratic B-spline basis on them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from feedopt_core.arrays import FloatArray

GROWTH = 1.25
"""Ratio of neighbouring knot spacings next to a point of rest, where q grows as s^(4/3)."""


def graded_knots(
    start_mm: float,
    end_mm: float,
    joints_mm: FloatArray,
    spacing_mm: float,
    *,
    rest_start_mm: float | None,
    rest_end_mm: float,
) -> FloatArray:
    """Knots from start to end: every joint of the path, spaced evenly between them, graded towards rest.

    Args:
        start_mm, end_mm: ends of the window.
        joints_mm: arc lengths where a path derivative may jump, strictly inside the window, increasing.
        spacing_mm: largest spacing.
        rest_start_mm: length of the element that leaves rest at the start; None where the window starts in motion.
        rest_end_mm: length of the element that comes to rest at the end.

    Returns:
        Increasing knots, shape (n,), first start_mm, last end_mm; the first (last) interval is the element at rest.
    """
    length = end_mm - start_mm
    head = _grading(rest_start_mm, spacing_mm, 0.5 * length) if rest_start_mm is not None else np.zeros(1)
    tail = _grading(rest_end_mm, spacing_mm, 0.5 * length)
    head, tail = start_mm + head, (end_mm - tail)[::-1]
    inner = joints_mm[(joints_mm > head[-1] + 0.3 * spacing_mm) & (joints_mm < tail[0] - 0.3 * spacing_mm)]
    edges = np.concatenate([head[-1:], inner, tail[:1]])
    parts = [head[:-1]]
    for low, high in pairwise(edges):
        count = max(1, int(np.ceil((high - low) / spacing_mm - 1e-9)))
        parts.append(np.linspace(low, high, count + 1)[:-1])
    return np.concatenate([*parts, tail])


def _grading(first_mm: float, spacing_mm: float, room_mm: float) -> FloatArray:
    """0, first, then spacings growing by GROWTH up to the regular one, within the room."""
    first_mm = min(first_mm, 0.2 * room_mm)
    knots, step = [0.0, first_mm], first_mm
    while step * GROWTH < spacing_mm and knots[-1] + step * GROWTH < 0.8 * room_mm:
        step *= GROWTH
        knots.append(knots[-1] + step)
    return np.array(knots)


@dataclass(frozen=True)
class QuadraticSpline:
    """Clamped quadratic B-spline on increasing knots: m spans, m + 2 control points.

    Attributes:
        knots_mm: shape (m + 1,).
        power: on span k, ``q = sum_l c[k + l] sum_i power[l, i, k] z^i`` with z in [0, 1] across the span; shape (3,
            3, m).
    """

    knots_mm: FloatArray
    power: FloatArray

    @classmethod
    def on(cls, knots_mm: FloatArray) -> QuadraticSpline:
        """Basis on the given knots (Cox-de Boor recursion written out for degree 2)."""
        padded = np.concatenate([knots_mm[:1], knots_mm, knots_mm[-1:]])
        low, left, right, high = padded[:-3], padded[1:-2], padded[2:-1], padded[3:]
        h, wide_left, wide_right = right - left, right - low, high - left
        power = np.zeros((3, 3, len(h)))
        a, b, c = h / wide_left, (left - low) / wide_left, h / wide_right
        power[0] = a, -2.0 * a, a
        power[1] = b, 2.0 * a, -a - c
        power[2, 2] = c
        return cls(knots_mm, power)

    @property
    def widths_mm(self) -> FloatArray:
        """Widths of the spans, shape (m,)."""
        return np.diff(self.knots_mm)

    def basis(self, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, dq/ds and d2q/ds2 of the three local basis functions at z in [0, 1], shape (3, len(z), m) each."""
        h = self.widths_mm
        value = np.einsum("pi,lik->lpk", np.vander(z, 3, increasing=True), self.power)
        slope = np.einsum("pi,lik->lpk", np.stack([np.ones_like(z), 2.0 * z], axis=1), self.power[:, 1:]) / h
        bend = np.broadcast_to(2.0 * self.power[:, None, 2] / h**2, value.shape)
        return value, slope, np.ascontiguousarray(bend)

    def start_of_spans(self, control_points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, dq/ds, d2q/ds2 at the start of every span, shape (m,) each."""
        m, h = len(self.widths_mm), self.widths_mm
        local = np.stack([control_points[offset : offset + m] for offset in range(3)])
        taylor = np.einsum("lik,lk->ik", self.power, local)
        return taylor[0], taylor[1] / h, 2.0 * taylor[2] / h**2
