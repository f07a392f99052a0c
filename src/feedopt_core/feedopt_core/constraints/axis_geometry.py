"""Derivatives of the axis positions along the path, and the velocity limits that follow from them.

With g1, g2, g3 = K r', K r'', K r''' (K: axis map) and q = feedrate^2, an axis has

    velocity      v = g1 sqrt(q)
    acceleration  a = g2 q + g1 q'/2
    jerk          j = sqrt(q) (g3 q + 3/2 g2 q' + 1/2 g1 q'')
    control       u = inertia a + viscous v + offset + coulomb sign(v)
    tracking      e = kv v + ka a + kj j
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.limits import KinematicLimits

ONE_SIDED_MM = 1e-9


@dataclass(frozen=True)
class AxisGeometry:
    """K r', K r'' and K r''' at points of the path; shape (n_axes, ...) each, and the programmed feed, shape (...)."""

    g1: FloatArray
    g2: FloatArray
    g3: FloatArray
    feed_limit_mm_s: FloatArray


def axis_geometry(toolpath: Toolpath, axis_matrix: FloatArray, s_mm: FloatArray) -> AxisGeometry:
    """Geometry of the axes at arc lengths of any shape. Raises ToolpathError outside the path held by ``toolpath``."""
    g1, g2, g3 = toolpath.axis_derivatives(s_mm.ravel(), axis_matrix).reshape(3, len(axis_matrix), *s_mm.shape)
    return AxisGeometry(g1, g2, g3, toolpath.feed_limits_mm_s(s_mm.ravel()).reshape(s_mm.shape))


def span_points(knots_mm: FloatArray, z: FloatArray) -> FloatArray:
    """Arc lengths at z in [0, 1] of every span, shape (len(z), m).

    The first and the last lie just inside the span, because the derivatives may jump at a knot.
    """
    widths = np.diff(knots_mm)
    inset = np.minimum(ONE_SIDED_MM, 1e-3 * widths)
    return np.asarray(knots_mm[:-1] + inset + z[:, None] * (widths - 2.0 * inset))


def q_limit(geometry: AxisGeometry, limits: KinematicLimits) -> FloatArray:
    """Largest q that the feed limit and the axis velocity limits allow, shape of the points, mm^2/s^2."""
    feed = np.minimum(geometry.feed_limit_mm_s, limits.feed_mm_s)
    shape = (-1,) + (1,) * feed.ndim
    with np.errstate(divide="ignore"):
        axis = np.min(limits.velocity_mm_s.reshape(shape) / np.abs(geometry.g1), axis=0)
    return np.asarray(np.minimum(feed, axis) ** 2)


def steady_q_limit(geometry: AxisGeometry, limits: KinematicLimits) -> FloatArray:
    """Largest q at constant feedrate, shape of the points, mm^2/s^2.

    It also counts the acceleration and jerk that the curvature of the path causes.
    """
    shape = (-1,) + (1,) * geometry.feed_limit_mm_s.ndim
    with np.errstate(divide="ignore", over="ignore"):
        bend = limits.acceleration_mm_s2.reshape(shape) / np.abs(geometry.g2)
        twist = (limits.jerk_mm_s3.reshape(shape) / np.abs(geometry.g3)) ** (2.0 / 3.0)
    return np.asarray(np.minimum(q_limit(geometry, limits), np.min(np.minimum(bend, twist), axis=0)))
