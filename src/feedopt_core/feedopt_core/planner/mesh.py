"""Knots of the feed profile and the quadratic B-spline basis on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.toolpath import Toolpath

GROWTH = 1.25
"""Ratio of neighbouring knot spacings next to a standstill, where q grows as s^(4/3)."""
SPARE_GROWTH = 2.0
"""Ratio of neighbouring knot spacings next to the end of a stop that the next window is expected to replace."""
_BEND_SHARE = 0.2
_SMALLEST_RATIO = 0.004
_DENSITY_SAMPLES = 17
_LEAST_ELEMENT_MM = 1e-5


@dataclass(frozen=True)
class KnotSpacing:
    """Spacing of the knots along the path.

    Attributes:
        toolpath: contains the window.
        largest_mm: largest spacing.
    """

    toolpath: Toolpath
    largest_mm: float

    def at(self, s_mm: FloatArray) -> FloatArray:
        """Spacing at arc lengths, shape (n,), mm: a part of the length over which the path bends."""
        wanted = _BEND_SHARE * self.toolpath.bend_length_mm(s_mm)
        return np.clip(wanted, _SMALLEST_RATIO * self.largest_mm, self.largest_mm)

    def between_joints(self, joints_mm: FloatArray) -> FloatArray:
        """All joints and the knots between them, shape (n,), mm. They depend on the path only, not on the window."""
        low, widths = joints_mm[:-1], np.diff(joints_mm)
        z = np.linspace(0.0, 1.0, _DENSITY_SAMPLES)
        inside = np.clip(z, 1e-7, 1.0 - 1e-7)
        density = 1.0 / self.at((low[:, None] + widths[:, None] * inside).ravel()).reshape(len(low), -1)
        steps = 0.5 * (density[:, 1:] + density[:, :-1]) * np.diff(z) * widths[:, None]
        parts = []
        for start, width, row in zip(low, widths, steps, strict=True):
            cumulative = np.concatenate([[0.0], np.cumsum(row)])
            count = max(1, int(np.ceil(cumulative[-1] - 1e-9)))
            parts.append(start + width * np.interp(np.arange(count) * (cumulative[-1] / count), cumulative, z))
        return np.concatenate([*parts, joints_mm[-1:]])


def graded_knots(
    start_mm: float,
    end_mm: float,
    spacing: KnotSpacing,
    *,
    start_element_mm: float | None,
    end_element_mm: float,
    spare_end: bool = False,
) -> FloatArray:
    """Knots of a window: every joint of the path, denser where the path bends and towards a standstill.

    Args:
        start_mm, end_mm: ends of the window.
        spacing: spacing of the regular knots.
        start_element_mm: length of the standstill element at the start; None where the window starts in motion.
        end_element_mm: length of the standstill element at the end.
        spare_end: whether the stop at the end is only held in reserve; fewer knots are enough for it.

    Returns:
        Increasing knots from start_mm to end_mm, shape (n,). The last interval is a standstill element, and so is the
        first one where the window starts at standstill.
    """
    half_mm = 0.5 * (end_mm - start_mm)
    joints = spacing.toolpath.joints_mm(start_mm, end_mm)
    head = np.array([start_mm])
    if start_element_mm is not None:
        head = start_mm + _graded_distances(start_mm, +1, start_element_mm, half_mm, spacing, joints - start_mm, GROWTH)
    growth = SPARE_GROWTH if spare_end else GROWTH
    tail = _graded_distances(end_mm, -1, end_element_mm, half_mm, spacing, (end_mm - joints)[::-1], growth)
    tail = (end_mm - tail)[::-1]
    regular = spacing.between_joints(joints)
    regular = regular[(regular > head[-1]) & (regular < tail[0])]
    # The graded ends cut the regular intervals next to them; a knot that would leave a very short interval is dropped.
    gap = 0.3 * spacing.at(np.array([head[-1], tail[0]]))
    keep = np.isin(regular, joints) | ((regular > head[-1] + gap[0]) & (regular < tail[0] - gap[1]))
    return np.concatenate([head, regular[keep], tail])


def _graded_distances(
    standstill_mm: float,
    sign: int,
    first_mm: float,
    half_mm: float,
    spacing: KnotSpacing,
    joints: FloatArray,
    growth: float,
) -> FloatArray:
    """Distances of knots from a standstill, increasing: the standstill element, then growing to the regular spacing.

    Args:
        standstill_mm: arc length of the standstill.
        sign: +1 where the window lies at larger arc lengths than the standstill, -1 at smaller ones.
        first_mm: largest length of the standstill element; it is shorter where the path bends sharply or has a joint.
        half_mm: half the length of the window; the knots stay within 0.8 of it.
        spacing: spacing of the regular knots.
        joints: distances of joints from the standstill, increasing; each one beyond the standstill element is a knot.
        growth: ratio of neighbouring spacings.
    """
    ahead = joints[joints > _LEAST_ELEMENT_MM]
    # Within this distance the spacings grow to the regular one (a geometric series): the path is evaluated once, here.
    reach_mm = min(0.8 * half_mm, spacing.largest_mm * growth / (growth - 1.0))
    distances = np.linspace(min(_LEAST_ELEMENT_MM, reach_mm), reach_mm, _DENSITY_SAMPLES * 4)
    wanted_mm = spacing.at(standstill_mm + sign * distances)
    first_mm = min(first_mm, 0.2 * half_mm, float(wanted_mm[0]), float(ahead[0]) if len(ahead) else np.inf)
    knots, step = [0.0, first_mm], first_mm
    while step * growth < float(np.interp(knots[-1], distances, wanted_mm)):
        step *= growth
        if knots[-1] + step > 0.8 * half_mm:
            break
        knots.append(knots[-1] + step)
    inside = joints[(joints > first_mm) & (joints < knots[-1])]
    if not len(inside):
        return np.array(knots)
    # A joint replaces the knots close to it.
    graded = np.array(knots[2:-1])
    clearance = 0.3 * np.minimum(np.diff(knots)[1:-1], np.diff(knots)[2:])
    near = np.min(np.abs(graded[:, None] - inside), axis=1)
    return np.unique(np.concatenate([[0.0, first_mm], graded[near > clearance], inside, knots[-1:]]))


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
