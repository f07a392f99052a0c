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
_SAME = 1e-6
"""Relative difference of numbers that say the same."""


@dataclass
class _Row:
    """One row at all points: limits (m, p, 2); linear part by q and q', bend by q, q' and q'', root, (m, p) each."""

    limits: FloatArray
    linear: tuple[FloatArray, FloatArray] | None = None
    bend: tuple[FloatArray, FloatArray, FloatArray] | None = None
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
        weights_mm: quadrature weights, shape (p, m); a point without one has no limits either.
        scale: factor on every limit at the points, shape (p, m), at most 1.
    """
    factor = scale.T
    g1, g2, g3 = (part.transpose(0, 2, 1) for part in (geometry.g1, geometry.g2, geometry.g3))
    both = np.ones((*factor.shape, 2))
    bound = (q_limit(geometry, limits.kinematic) * scale**2).T
    rows = [_Row(both * [1.0, np.inf], (1.0 / bound, np.zeros_like(bound)))]
    for axis, limit in enumerate(limits.kinematic.acceleration_mm_s2):
        if np.isfinite(limit):
            rows.append(_Row(both, _acceleration(g1[axis], g2[axis], 1.0 / (limit * factor))))
    if limits.control is not None:
        rows += [_control_row(limits.control, axis, g1[axis], g2[axis], factor) for axis in range(len(g1))]
    for axis, limit in enumerate(limits.kinematic.jerk_mm_s3):
        if np.isfinite(limit):
            rows.append(_Row(both, bend=_jerk(g1[axis], g2[axis], g3[axis], 1.0 / (limit * factor))))
    if limits.tracking is not None:
        rows += [
            _tracking_row(limits.tracking, axis, (g1[axis], g2[axis], g3[axis]), factor) for axis in range(len(g1))
        ]
    return _stacked(rows, np.stack(basis).transpose(3, 2, 0, 1), np.ascontiguousarray(weights_mm.T))


def _acceleration(g1: FloatArray, g2: FloatArray, by: FloatArray) -> tuple[FloatArray, FloatArray]:
    return g2 * by, 0.5 * g1 * by


def _jerk(g1: FloatArray, g2: FloatArray, g3: FloatArray, by: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return g3 * by, 1.5 * g2 * by, 0.5 * g1 * by


def _control_row(control: ControlLimits, axis: int, g1: FloatArray, g2: FloatArray, factor: FloatArray) -> _Row:
    allowed = control.limit_volts[axis] * factor
    offset, friction = control.offset_volts[axis], control.coulomb_volts[axis]
    sign = np.sign(g1)
    # An axis that hardly moves may do so in either direction between the points.
    both = np.abs(g1) < _NO_DIRECTION
    up = allowed - offset - np.where(both, friction, sign * friction)
    down = allowed + offset + np.where(both, -friction, sign * friction)
    return _Row(
        limits=np.stack([up, down], axis=-1) / allowed[..., None],
        linear=_acceleration(g1, g2, control.inertia_volts_s2_mm[axis] / allowed),
        root=control.viscous_volts_s_mm[axis] * g1 / allowed,
    )


def _tracking_row(
    tracking: TrackingLimits, axis: int, g: tuple[FloatArray, FloatArray, FloatArray], factor: FloatArray
) -> _Row:
    allowed = tracking.limit_mm[axis] * factor
    return _Row(
        limits=np.ones((*factor.shape, 2)),
        linear=_acceleration(g[0], g[1], tracking.ka_s2[axis] / allowed),
        bend=_jerk(*g, tracking.kj_s3[axis] / allowed),
        root=tracking.kv_s[axis] * g[0] / allowed,
    )


def _stacked(rows: list[_Row], basis: FloatArray, weights_mm: FloatArray) -> Rows:
    """Rows of a problem; basis has shape (m, p, 3, 3)."""
    shape = (*weights_mm.shape, len(rows))
    coefficients, inverse_limits = np.zeros((*shape, ROW_SIZE)), np.empty((*shape, 2))
    for index, row in enumerate(rows):
        inverse_limits[:, :, index] = 1.0 / row.limits
        root = None if row.root is None else (row.root,)
        for place, part in ((LINE, row.linear), (BEND, row.bend), (ROOT, root)):
            for offset, values in enumerate(part or ()):
                coefficients[:, :, index, place + offset] = values
    inverse_limits[weights_mm == 0.0] = 0.0
    over_root = np.array([float(row.bend is not None) for row in rows])
    return Rows(np.ascontiguousarray(basis), weights_mm, coefficients, inverse_limits, over_root)


def release_start_state(rows: Rows) -> None:
    """Take the rows without q'' off the very start: a given state there cannot be chosen any more."""
    given = ~np.any(rows.coefficients[0, 0, :, BEND : BEND + 3], axis=-1)
    rows.inverse_limits[0, 0, given] = 0.0


def drop_repeated(rows: Rows) -> None:
    """Take off the ends of spans what the starts of the next ones say as well: rows without q'' where nothing jumps."""
    end, start = rows.coefficients[:-1, -1], rows.coefficients[1:, 0]
    # q and q' are continuous: what is left of such a row are its factors of q, q' and sqrt(q), and its limits.
    same = np.all(_close(end[..., [LINE, LINE + 1, ROOT]], start[..., [LINE, LINE + 1, ROOT]]), axis=-1)
    same &= np.all(_close(rows.inverse_limits[:-1, -1], rows.inverse_limits[1:, 0]), axis=-1)
    rows.inverse_limits[:-1, -1][same & (rows.over_root == 0.0)] = 0.0


def _close(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.abs(a - b) <= _SAME * np.abs(b))
