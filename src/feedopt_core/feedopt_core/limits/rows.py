"""The limits at the points of a mesh, as the two-sided rows of the interior point.

With A = g2 q + g1 q'/2 and W = g3 q + 3/2 g2 q' + 1/2 g1 q'' (both linear in the control points), divided by the limit
in each case:

    velocity      q <= q_limit
    acceleration  A
    jerk          sqrt(q) W
    control       inertia A + viscous g1 sqrt(q), offset and friction moved into the limits
    tracking      kv g1 sqrt(q) + ka A + kj sqrt(q) W
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.limits.axis_limits import AxisGeometry, ControlLimits, MotionLimits, TrackingLimits, q_limit
from feedopt_core.solvers.interior_point_data import BEND, LINE, ROOT, ROW_SIZE, Rows

_NO_DIRECTION = 1e-9
"""Below this share of the path's motion an axis may move either way: friction counts against both sides."""


@dataclass
class _Row:
    """One row at all points: linear and bend part of shape (m, p, 3) or None, root (m, p), limits (m, p, 2)."""

    limits: FloatArray
    linear: FloatArray | None = None
    bend: FloatArray | None = None
    root: FloatArray | None = None


def limit_rows(
    geometry: AxisGeometry,
    limits: MotionLimits,
    basis: tuple[FloatArray, FloatArray, FloatArray],
    weights_mm: FloatArray,
    scale: FloatArray,
) -> Rows:
    """Rows of all limits at p points of each of m spans: velocity first, then kind by kind, axis by axis.

    Args:
        geometry: at the points, shape (n_axes, p, m).
        limits: of the machine.
        basis: q, q', q'' of the local basis functions, shape (3, p, m) each.
        weights_mm: quadrature weights, shape (p, m).
        scale: factor on every limit at the points, shape (p, m), at most 1.
    """
    value, slope, bend = (np.ascontiguousarray(part.transpose(2, 1, 0)) for part in basis)
    factor = scale.T
    g1, g2, g3 = (part.transpose(0, 2, 1) for part in (geometry.g1, geometry.g2, geometry.g3))
    acceleration = g2[..., None] * value + 0.5 * g1[..., None] * slope
    jerk = g3[..., None] * value + 1.5 * g2[..., None] * slope + 0.5 * g1[..., None] * bend
    both = np.ones((*factor.shape, 2))
    bound = (q_limit(geometry, limits.kinematic) * scale**2).T
    rows = [_Row(both * [1.0, np.inf], value / bound[..., None])]
    for axis, limit in enumerate(limits.kinematic.acceleration_mm_s2):
        if np.isfinite(limit):
            rows.append(_Row(both, acceleration[axis] / (limit * factor)[..., None]))
    if limits.control is not None:
        rows += [_control_row(limits.control, axis, g1[axis], acceleration[axis], factor) for axis in range(len(g1))]
    for axis, limit in enumerate(limits.kinematic.jerk_mm_s3):
        if np.isfinite(limit):
            rows.append(_Row(both, bend=jerk[axis] / (limit * factor)[..., None]))
    if limits.tracking is not None:
        rows += [
            _tracking_row(limits.tracking, axis, g1[axis], acceleration[axis], jerk[axis], factor)
            for axis in range(len(g1))
        ]
    return _stacked(rows, value, np.ascontiguousarray(weights_mm.T))


def _control_row(
    control: ControlLimits, axis: int, g1: FloatArray, acceleration: FloatArray, factor: FloatArray
) -> _Row:
    allowed = control.limit_volts[axis] * factor
    offset, friction = control.offset_volts[axis], control.coulomb_volts[axis]
    sign = np.sign(g1)
    # An axis that hardly moves may do so in either direction between the points.
    both = np.abs(g1) < _NO_DIRECTION
    up = allowed - offset - np.where(both, friction, sign * friction)
    down = allowed + offset + np.where(both, -friction, sign * friction)
    return _Row(
        limits=np.stack([up, down], axis=-1) / allowed[..., None],
        linear=control.inertia_volts_s2_mm[axis] * acceleration / allowed[..., None],
        root=control.viscous_volts_s_mm[axis] * g1 / allowed,
    )


def _tracking_row(
    tracking: TrackingLimits,
    axis: int,
    g1: FloatArray,
    acceleration: FloatArray,
    jerk: FloatArray,
    factor: FloatArray,
) -> _Row:
    allowed = tracking.limit_mm[axis] * factor
    return _Row(
        limits=np.ones((*factor.shape, 2)),
        linear=tracking.ka_s2[axis] * acceleration / allowed[..., None],
        bend=tracking.kj_s3[axis] * jerk / allowed[..., None],
        root=tracking.kv_s[axis] * g1 / allowed,
    )


def _stacked(rows: list[_Row], value: FloatArray, weights_mm: FloatArray) -> Rows:
    shape = (*weights_mm.shape, len(rows))
    coefficients, inverse_limits = np.zeros((*shape, ROW_SIZE)), np.empty((*shape, 2))
    for index, row in enumerate(rows):
        inverse_limits[:, :, index] = 1.0 / row.limits
        if row.linear is not None:
            coefficients[:, :, index, LINE : LINE + 3] = row.linear
        if row.bend is not None:
            coefficients[:, :, index, BEND : BEND + 3] = row.bend
        if row.root is not None:
            coefficients[:, :, index, ROOT] = row.root
    over_root = np.array([float(row.bend is not None) for row in rows])
    return Rows(value, weights_mm, coefficients, inverse_limits, over_root)


def release_start_state(rows: Rows) -> None:
    """Take the rows without q'' off the very start: a given state there cannot be chosen any more."""
    given = ~np.any(rows.coefficients[0, 0, :, BEND : BEND + 3], axis=-1)
    rows.inverse_limits[0, 0, given] = 0.0


def drop_repeated(rows: Rows) -> None:
    """Take off the ends of spans what the starts of the next ones say as well: rows without q'' where nothing jumps."""
    end, start = rows.coefficients[:-1, -1], rows.coefficients[1:, 0]
    line = np.isclose(end[..., LINE + 1 : LINE + 3], start[..., LINE : LINE + 2], rtol=1e-6, atol=0.0).all(axis=-1)
    root = np.isclose(end[..., ROOT], start[..., ROOT], rtol=1e-6, atol=0.0)
    same = np.isclose(rows.inverse_limits[:-1, -1], rows.inverse_limits[1:, 0], rtol=1e-6, atol=0.0).all(axis=-1)
    rows.inverse_limits[:-1, -1][line & root & same & (rows.over_root == 0.0)] = 0.0
