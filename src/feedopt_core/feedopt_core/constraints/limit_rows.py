"""The limits at the points of a mesh, as two-sided rows for the interior point.

Each row is one of these quantities divided by its limit, with A = g2 q + g1 q'/2 and
W = g3 q + 3/2 g2 q' + 1/2 g1 q'' (both are linear in the control points):

    velocity      q <= q_limit
    acceleration  A
    jerk          sqrt(q) W
    control       inertia A + viscous g1 sqrt(q), offset and friction moved into the limits
    tracking      kv g1 sqrt(q) + ka A + kj sqrt(q) W
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from feedopt_core.arrays import FloatArray, RecordArray, record
from feedopt_core.compiled import compiled
from feedopt_core.constraints.axis_geometry import AxisGeometry, q_limit
from feedopt_core.machine.limits import MotionLimits
from feedopt_core.solver.interior_point_data import DOWN, ROW, UP, Rows

_VELOCITY = 0
"""Index of the velocity row among the rows of a point."""
_NO_DIRECTION = 1e-9
"""Where an axis moves less than this part of the path's motion its direction is open: friction tightens both sides."""
_SAME = 1e-6
"""Relative difference up to which two numbers count as equal."""


class _Recipe(NamedTuple):
    """A limit of one axis: factors of A, sqrt(q) W and g1 sqrt(q), and the constant part, all divided by the limit."""

    axis: int
    acceleration: float = 0.0
    jerk: float = 0.0
    velocity: float = 0.0
    offset: float = 0.0
    friction: float = 0.0


_RECIPE = record(axis="i8", acceleration="f8", jerk="f8", velocity="f8", offset="f8", friction="f8")
"""A :class:`_Recipe` for compiled code."""


def limit_rows(
    geometry: AxisGeometry,
    limits: MotionLimits,
    basis: tuple[FloatArray, FloatArray, FloatArray],
    weights_mm: FloatArray,
    scale: FloatArray,
) -> Rows:
    """Rows of all limits at p points of each of m spans: first velocity, then for each kind of limit one row an axis.

    Args:
        geometry: at the points, shape (n_axes, p, m).
        limits: of the machine.
        basis: q, q', q'' of the local basis functions, shape (3, p, m) each.
        weights_mm: quadrature weights, shape (p, m); a point of weight 0 gets no rows.
        scale: factor on every limit at the points, shape (p, m), at most 1.
    """
    recipes = np.array(_recipes(limits), _RECIPE)
    shape = (*weights_mm.T.shape, 1 + len(recipes))
    coefficients, inverse_limits = np.zeros(shape, ROW), np.zeros((*shape, 2))
    inverse_bound = 1.0 / (q_limit(geometry, limits.kinematic) * scale**2)
    factors = (weights_mm > 0.0) / scale
    _fill(coefficients, inverse_limits, geometry.g1, geometry.g2, geometry.g3, inverse_bound, factors, recipes)
    over_root = np.concatenate([[0.0], recipes["jerk"] != 0.0])
    local = np.ascontiguousarray(np.stack(basis).transpose(3, 2, 0, 1))
    return Rows(local, np.ascontiguousarray(weights_mm.T), coefficients, inverse_limits, over_root)


def _recipes(limits: MotionLimits) -> list[_Recipe]:
    kinematic, control, tracking = limits.kinematic, limits.control, limits.tracking
    axes = range(len(kinematic.axis_matrix))
    acceleration = 1.0 / _lowest_of_alike(kinematic.acceleration_mm_s2, kinematic.axis_matrix)
    jerk = 1.0 / _lowest_of_alike(kinematic.jerk_mm_s3, kinematic.axis_matrix)
    recipes = [_Recipe(axis, acceleration=acceleration[axis]) for axis in axes if acceleration[axis] > 0.0]
    if control is not None:
        recipes += [
            _Recipe(
                axis,
                acceleration=control.inertia_volts_s2_mm[axis] / control.limit_volts[axis],
                velocity=control.viscous_volts_s_mm[axis] / control.limit_volts[axis],
                offset=control.offset_volts[axis] / control.limit_volts[axis],
                friction=control.coulomb_volts[axis] / control.limit_volts[axis],
            )
            for axis in axes
        ]
    recipes += [_Recipe(axis, jerk=jerk[axis]) for axis in axes if jerk[axis] > 0.0]
    if tracking is not None:
        recipes += [
            _Recipe(
                axis,
                acceleration=tracking.ka_s2[axis] / tracking.limit_mm[axis],
                jerk=tracking.kj_s3[axis] / tracking.limit_mm[axis],
                velocity=tracking.kv_s[axis] / tracking.limit_mm[axis],
            )
            for axis in axes
        ]
    return recipes


def _lowest_of_alike(limits: FloatArray, axis_matrix: FloatArray) -> FloatArray:
    """Limits of the axes, shape (n_axes,), infinite where another axis makes the same motion under the lowest limit.

    The two drives of a gantry are an example. One row then stands for all axes of this motion.
    """
    lowest = limits.copy()
    for axis, row in enumerate(axis_matrix):
        alike = np.flatnonzero(np.all(axis_matrix == row, axis=1))
        if axis != alike[np.argmin(limits[alike])]:
            lowest[axis] = np.inf
    return lowest


@compiled
def _fill(
    coefficients: RecordArray,
    inverse_limits: FloatArray,
    g1: FloatArray,
    g2: FloatArray,
    g3: FloatArray,
    inverse_bound: FloatArray,
    factors: FloatArray,
    recipes: RecordArray,
) -> None:
    """Fill in the rows at all points.

    Args:
        coefficients, inverse_limits: those of :class:`Rows`, all zero; filled where there is a limit.
        g1, g2, g3: geometry, shape (n_axes, p, m).
        inverse_bound: one over the largest q, shape (p, m).
        factors: one over the factor on the limits, 0 at points without limits, shape (p, m).
        recipes: of type _RECIPE, shape (n - 1,).
    """
    points, spans = factors.shape
    for k in range(spans):
        for p in range(points):
            factor = factors[p, k]
            if factor == 0.0:
                continue
            coefficients[k, p, _VELOCITY].on_q, inverse_limits[k, p, _VELOCITY, UP] = inverse_bound[p, k], 1.0
            for i in range(len(recipes)):
                recipe = recipes[i]
                axis = recipe.axis
                d1, d2, d3 = g1[axis, p, k], g2[axis, p, k], g3[axis, p, k]
                if d1 == 0.0 and d2 == 0.0 and d3 == 0.0:
                    # An axis that stands still needs no limit.
                    continue
                on_a, on_j, on_v = recipe.acceleration * factor, recipe.jerk * factor, recipe.velocity * factor
                offset, friction = recipe.offset * factor, recipe.friction * factor
                row, inverse = coefficients[k, p, i + 1], inverse_limits[k, p, i + 1]
                row.on_q, row.on_slope = on_a * d2, 0.5 * on_a * d1
                row.on_root_q, row.on_root_slope, row.on_root_bend = on_j * d3, 1.5 * on_j * d2, 0.5 * on_j * d1
                row.on_root = on_v * d1
                # An axis that hardly moves may move in either direction between the points.
                both = abs(d1) < _NO_DIRECTION
                forwards = friction if both else np.sign(d1) * friction
                backwards = friction if both else -forwards
                inverse[UP], inverse[DOWN] = 1.0 / (1.0 - offset - forwards), 1.0 / (1.0 + offset - backwards)


def release_start_state(rows: Rows) -> None:
    """Remove the rows without q'' at the start of the window: q and q' are given there and cannot change any more."""
    rows.inverse_limits[0, 0, rows.over_root == 0.0] = 0.0


def drop_repeated(rows: Rows) -> None:
    """Remove rows at the end of a span that the start of the next span repeats: no q'', equal factors and limits."""
    _drop_repeated(rows.coefficients, rows.inverse_limits, rows.over_root)


@compiled
def _drop_repeated(coefficients: RecordArray, inverse_limits: FloatArray, over_root: FloatArray) -> None:
    last = coefficients.shape[1] - 1
    for k in range(len(coefficients) - 1):
        for i in range(len(over_root)):
            if over_root[i] > 0.0:
                continue
            # q and q' are continuous at a knot, so two rows are equal if their factors of q, q' and sqrt(q), and their
            # limits are.
            end, start = coefficients[k, last, i], coefficients[k + 1, 0, i]
            same = _close(end.on_q, start.on_q) and _close(end.on_slope, start.on_slope)
            same = same and _close(end.on_root, start.on_root)
            for side in (UP, DOWN):
                same = same and _close(inverse_limits[k, last, i, side], inverse_limits[k + 1, 0, i, side])
            if same:
                inverse_limits[k, last, i] = 0.0


@compiled
def _close(a: float, b: float) -> bool:
    return abs(a - b) <= _SAME * abs(b)
