"""Utilisation of the limits by a feed profile, for each span, on a grid finer than that of the optimisation."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray, RecordArray, record
from feedopt_core.compiled import compiled
from feedopt_core.constraints.axis_geometry import ONE_SIDED_MM, AxisGeometry, axis_geometry
from feedopt_core.geometry.sampling import samples_between
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.limits import MotionLimits
from feedopt_core.motion.profile import FeedProfile

_LEAST_SAMPLES = 25
_AXIS_MODEL = record(
    velocity="f8",
    acceleration="f8",
    jerk="f8",
    inertia="f8",
    viscous="f8",
    offset="f8",
    coulomb="f8",
    kv="f8",
    ka="f8",
    kj="f8",
)
"""Of one axis, each divided by its limit: one by velocity, acceleration and jerk; drive model; tracking model."""


class FineGrid:
    """Points between knots at which the utilisation is computed, with the geometry of the axes there.

    Args:
        toolpath: contains all knots.
        axis_matrix: axis map.
        s_mm: increasing knots, shape (m + 1,).
    """

    def __init__(self, toolpath: Toolpath, axis_matrix: FloatArray, s_mm: FloatArray) -> None:
        self._samples = samples_between(toolpath, s_mm, _LEAST_SAMPLES)
        owner, widths = self._samples.owner, np.diff(s_mm)[self._samples.owner]
        inset = np.minimum(ONE_SIDED_MM, 1e-3 * widths)
        self._x_mm = inset + self._samples.z * (widths - 2.0 * inset)
        self._geometry = axis_geometry(toolpath, axis_matrix, s_mm[owner] + self._x_mm)

    def limit_ratios(self, limits: MotionLimits, profile: FeedProfile) -> FloatArray:
        """Largest ratio of any quantity to its limit on each element, shape (m,).

        Args:
            limits: of the axes and the feed.
            profile: QUADRATIC elements on the knots of the grid only.
        """
        e, x = self._samples.owner, self._x_mm
        bend = profile.d2q_ds2_per_s2[e]
        slope = profile.dq_ds_mm_s2[e] + bend * x
        q = profile.q_mm2_s2[e] + (profile.dq_ds_mm_s2[e] + 0.5 * bend * x) * x
        ratios = largest_ratios(limits, self._geometry, q, slope, bend)
        return np.asarray(np.maximum.reduceat(ratios, self._samples.first))


def limit_ratios(toolpath: Toolpath, limits: MotionLimits, profile: FeedProfile) -> FloatArray:
    """See :meth:`FineGrid.limit_ratios`, on a grid of its own."""
    return FineGrid(toolpath, limits.kinematic.axis_matrix, profile.s_mm).limit_ratios(limits, profile)


def largest_ratios(
    limits: MotionLimits, geometry: AxisGeometry, q: FloatArray, slope: FloatArray, bend: FloatArray
) -> FloatArray:
    """Largest ratio of any quantity to its limit at n points, shape (n,), from q, dq/ds and d2q/ds2 there."""
    kinematic = limits.kinematic
    feed = np.minimum(geometry.feed_limit_mm_s, kinematic.feed_mm_s)
    return _ratios(geometry.g1, geometry.g2, geometry.g3, 1.0 / feed, q, slope, bend, _axis_models(limits))


def _axis_models(limits: MotionLimits) -> RecordArray:
    """Models of the axes, shape (n_axes,); zero where there is none."""
    kinematic, control, tracking = limits.kinematic, limits.control, limits.tracking
    models = np.zeros(len(limits.axis_names), _AXIS_MODEL)
    models["velocity"] = 1.0 / kinematic.velocity_mm_s
    models["acceleration"] = 1.0 / kinematic.acceleration_mm_s2
    models["jerk"] = 1.0 / kinematic.jerk_mm_s3
    if control is not None:
        models["inertia"] = control.inertia_volts_s2_mm / control.limit_volts
        models["viscous"] = control.viscous_volts_s_mm / control.limit_volts
        models["offset"] = control.offset_volts / control.limit_volts
        models["coulomb"] = control.coulomb_volts / control.limit_volts
    if tracking is not None:
        models["kv"] = tracking.kv_s / tracking.limit_mm
        models["ka"] = tracking.ka_s2 / tracking.limit_mm
        models["kj"] = tracking.kj_s3 / tracking.limit_mm
    return models


@compiled
def _ratios(
    g1: FloatArray,
    g2: FloatArray,
    g3: FloatArray,
    inverse_feed: FloatArray,
    q: FloatArray,
    slope: FloatArray,
    bend: FloatArray,
    models: RecordArray,
) -> FloatArray:
    """Largest ratios, shape (n,).

    Args:
        g1, g2, g3: geometry of the axes, shape (n_axes, n).
        inverse_feed: of the feed limits, shape (n,).
        q, slope, bend: profile, shape (n,).
        models: of the axes, shape (n_axes,).
    """
    ratios = np.empty(len(q))
    for n in range(len(q)):
        root = np.sqrt(q[n])
        worst = root * inverse_feed[n]
        for axis in range(len(g1)):
            v = g1[axis, n] * root
            a = g2[axis, n] * q[n] + 0.5 * g1[axis, n] * slope[n]
            j = root * (g3[axis, n] * q[n] + 1.5 * g2[axis, n] * slope[n] + 0.5 * g1[axis, n] * bend[n])
            model = models[axis]
            control = model.inertia * a + model.viscous * v + model.offset + model.coulomb * np.sign(v)
            error = model.ka * a + model.kv * v + model.kj * j
            kinematic = max(abs(v) * model.velocity, abs(a) * model.acceleration, abs(j) * model.jerk)
            worst = max(worst, kinematic, abs(control), abs(error))
        ratios[n] = worst
    return ratios
