"""Limits of every axis along the path, as rows that are linear in q, dq/ds and d2q/ds2.

With g1, g2, g3 = K r', K r'', K r''' (K: axis map) and q = feedrate^2, an axis has

    velocity      g1 sqrt(q)
    acceleration  g2 q + g1 q'/2
    jerk          sqrt(q) (g3 q + 3/2 g2 q' + 1/2 g1 q'')

The jerk limit is ``|w| <= j / sqrt(q)`` with w linear. Its right side is convex in q, so its tangent at any q_k,
``3/2 j / sqrt(q_k) - j q / (2 q_k^(3/2))``, lies below it: what obeys the tangent obeys the limit, and both touch at q
= q_k.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.config.machine import Machine
from feedopt_core.path.toolpath import Toolpath

ONE_SIDED_MM = 1e-9


@dataclass(frozen=True)
class KinematicLimits:
    """Limits of velocity, acceleration and jerk of each axis, shape (n_axes,), and of the feedrate; mm and s."""

    axis_matrix: FloatArray
    feed_mm_s: float
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    jerk_mm_s3: FloatArray

    @classmethod
    def of(cls, machine: Machine) -> KinematicLimits:
        """The limits written in the machine file."""
        return cls(
            machine.axis_matrix(),
            machine.feed_limit_mm_s,
            np.array(machine.velocity_limit_mm_s),
            np.array(machine.acceleration_limit_mm_s2),
            np.array(machine.jerk_limit_mm_s3),
        )


@dataclass(frozen=True)
class AxisGeometry:
    """K r', K r'' and K r''' at points of the path; shape (n_axes, ...) each, and the programmed feed, shape (...)."""

    g1: FloatArray
    g2: FloatArray
    g3: FloatArray
    feed_limit_mm_s: FloatArray


def axis_geometry(toolpath: Toolpath, axis_matrix: FloatArray, s_mm: FloatArray) -> AxisGeometry:
    """Geometry of the axes at arc lengths of any shape. Raises ToolpathError outside the path held."""
    points = toolpath.evaluate(s_mm.ravel())
    shape = (len(axis_matrix), *s_mm.shape)
    g1, g2, g3 = (
        np.reshape((values @ axis_matrix.T).T, shape) for values in (points.dr_ds, points.d2r_ds2, points.d3r_ds3)
    )
    return AxisGeometry(g1, g2, g3, toolpath.feed_limits_mm_s(s_mm.ravel()).reshape(s_mm.shape))


def span_points(knots_mm: FloatArray, z: FloatArray) -> FloatArray:
    """Arc lengths at z in [0, 1] of every span, shape (len(z), m), a hair inside: derivatives may jump at a knot."""
    widths = np.diff(knots_mm)
    inset = np.minimum(ONE_SIDED_MM, 1e-3 * widths)
    return np.asarray(knots_mm[:-1] + inset + z[:, None] * (widths - 2.0 * inset))


def q_limit(geometry: AxisGeometry, limits: KinematicLimits) -> FloatArray:
    """Largest q the feed and the axis velocities allow, shape of the points, mm^2/s^2."""
    feed = np.minimum(geometry.feed_limit_mm_s, limits.feed_mm_s)
    shape = (-1,) + (1,) * feed.ndim
    with np.errstate(divide="ignore"):
        axis = np.min(limits.velocity_mm_s.reshape(shape) / np.abs(geometry.g1), axis=0)
    return np.asarray(np.minimum(feed, axis) ** 2)


class LimitRows:
    """Rows ``sum_l R[l] c[k + l] <= 1`` of all limits at p points of each of m spans.

    Order of the rows: p of velocity; then, axis by axis, p each of acceleration upwards and downwards; then, axis by
        axis, p each of jerk upwards and downwards (the tangents, set anew for every q).
    """

    def __init__(
        self,
        geometry: AxisGeometry,
        limits: KinematicLimits,
        basis: tuple[FloatArray, FloatArray, FloatArray],
        scale: FloatArray,
    ) -> None:
        """Prepare the rows.

        Args:
            geometry: at the points, shape (n_axes, p, m).
            limits: of the machine.
            basis: q, q', q'' of the local basis functions, shape (3, p, m) each.
            scale: factor on every limit at the points, shape (p, m), at most 1.
        """
        value, slope, bend = basis
        axes, points, spans = geometry.g1.shape
        self.basis = value
        self.q_limit = q_limit(geometry, limits) * scale**2
        a = limits.acceleration_mm_s2[:, None, None] * scale
        j = limits.jerk_mm_s3[:, None, None] * scale
        g1, g2, g3 = geometry.g1[:, None], geometry.g2[:, None], geometry.g3[:, None]
        self._w = (g3 * value + 1.5 * g2 * slope + 0.5 * g1 * bend) / j[:, None]
        self._rows = np.empty((3, points * (1 + 4 * axes), spans))
        self._rows[:, :points] = value / self.q_limit
        acceleration = (g2 * value + 0.5 * g1 * slope) / a[:, None]
        for axis in range(axes):
            first = points * (1 + 2 * axis)
            self._rows[:, first : first + points] = acceleration[axis]
            self._rows[:, first + points : first + 2 * points] = -acceleration[axis]
        self._jerk_start = points * (1 + 2 * axes)

    def release_start_state(self) -> None:
        """Take the velocity and acceleration rows off the very start: a given state there cannot be chosen any more."""
        self._rows[:, 0 : self._jerk_start : len(self.basis[0]), 0] = 0.0

    def tangent_at(self, q: FloatArray) -> FloatArray:
        """All rows with the jerk limit's tangent at q > 0, shape (3, r, m); the array is reused by the next call."""
        points = len(self.basis[0])
        root = np.sqrt(q) / 1.5
        lean = self.basis / (3.0 * q)
        for axis in range(len(self._w)):
            first = self._jerk_start + 2 * points * axis
            w = self._w[axis] * root
            np.add(lean, w, out=self._rows[:, first : first + points])
            np.subtract(lean, w, out=self._rows[:, first + points : first + 2 * points])
        return self._rows
