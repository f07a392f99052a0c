"""The optimisation problems of the dual-windowing thesis on one window: its LP (section 3.4) and its NLP (3.6).

The mesh is that of the other methods: quadratic B-splines, five evaluation points a span. Where the window starts or
ends at standstill, an element of constant jerk replaces the feedrate offset of the thesis, which would violate the
limits at 1 kHz set points. The limits are inequalities ``|quantity / limit| <= scale`` at the evaluation points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csc_array, csr_array, vstack

from feedopt_core.arrays import FloatArray
from feedopt_core.constraints.axis_geometry import AxisGeometry, q_limit
from feedopt_core.errors import ConfigError, SolverError
from feedopt_core.machine.limits import KinematicLimits, MotionLimits
from feedopt_core.planner.mesh import QuadraticSpline

_LEAST_FEED_MM_S = 1e-2
_FEASIBLE = 2e-4
"""Largest violation, as a part of the limit, that the solvers may leave; the margin of the limits covers it."""
_SQP: dict[str, Any] = {
    "qpsol": "osqp",
    "qpsol_options": {
        "error_on_fail": False,
        "osqp": {"verbose": False, "eps_abs": 1e-4, "eps_rel": 1e-4, "max_iter": 2000, "rho": 10.0, "polish": True},
    },
    "convexify_strategy": "regularize",
    "tol_du": 1e-3,
    "tol_pr": 1e-6,
    "print_header": False,
    "print_iteration": False,
    "print_status": False,
    "print_time": False,
}
_IPOPT: dict[str, Any] = {
    "print_time": False,
    "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 500, "tol": 1e-6},
}


@dataclass(frozen=True)
class EndCondition:
    """Condition on the first (or last) two control points.

    At standstill the inner one is ``ratio`` times the outer one, and the outer one is at most ``outer_limit``. In
    motion both are given by ``fixed``, the outer one first.
    """

    ratio: float
    outer_limit: float
    fixed: tuple[float, float] | None = None


@dataclass(frozen=True)
class ProgramSolution:
    """Control points, with the figures of the solver that found them."""

    control_points: FloatArray
    solver: str
    rows: int
    iterations: int


def load_casadi() -> Any:
    """The CasADi module. Raises ConfigError where it is not installed."""
    try:
        import casadi
    except ImportError as error:
        raise ConfigError(
            "method thesis needs CasADi, which is not installed: pip install -r requirements/run.txt"
        ) from error
    return casadi


class SplineMatrices:
    """Value, slope and bend of a spline at the evaluation points: sparse, shape (p m, m + 2) each."""

    # The stubs of scipy.sparse do not follow products of sparse arrays.
    value: Any
    slope: Any
    bend: Any

    def __init__(self, spline: QuadraticSpline, z: FloatArray) -> None:
        count = len(spline.widths_mm)
        columns = np.broadcast_to(np.arange(3)[:, None, None] + np.arange(count), (3, len(z), count))
        rows = np.broadcast_to(np.arange(len(z) * count).reshape(len(z), count), columns.shape)
        shape = (len(z) * count, count + 2)
        self.value, self.slope, self.bend = (
            csr_array((basis.ravel(), (rows.ravel(), columns.ravel())), shape=shape) for basis in spline.basis(z)
        )
        padded = np.concatenate([np.full(2, spline.knots_mm[0]), spline.knots_mm, np.full(2, spline.knots_mm[-1])])
        # Integral of each basis function: a third of its support.
        self.integral_mm = (padded[3:] - padded[:-3]) / 3.0


def linear_program(
    matrices: SplineMatrices,
    geometry: AxisGeometry,
    limits: KinematicLimits,
    scale: FloatArray,
    ends: tuple[EndCondition, EndCondition],
) -> ProgramSolution:
    """Control points of q that maximise its integral under velocity, acceleration and pseudo-jerk (eqs. 3-17 to 3-34).

    Args:
        matrices, geometry: at the evaluation points, p of each of m spans.
        limits: of the axes and the feed, finite.
        scale: factor on every limit, shape (p, m).
        ends: of q.

    Raises:
        SolverError: no q keeps the limits. This can happen where the window starts faster than they allow.
    """
    factor = scale.ravel()
    most = q_limit(geometry, limits).ravel() * factor**2
    g1, g2, g3 = (g.reshape(len(g), -1) for g in (geometry.g1, geometry.g2, geometry.g3))
    rows, bounds = [matrices.value], [most]
    for axis, limit in enumerate(limits.acceleration_mm_s2):
        acceleration = matrices.value.multiply(g2[axis][:, None]) + matrices.slope.multiply(0.5 * g1[axis][:, None])
        rows += [acceleration, -acceleration]
        bounds += [limit * factor] * 2
    upper = matrices.value @ _highs(matrices, rows, bounds, ends).control_points
    root = np.sqrt(np.maximum(upper, 0.0))
    for axis, limit in enumerate(limits.jerk_mm_s3):
        jerk = (
            matrices.value.multiply((root * g3[axis])[:, None])
            + matrices.slope.multiply((1.5 * root * g2[axis])[:, None])
            + matrices.bend.multiply((0.5 * root * g1[axis])[:, None])
        )
        rows += [jerk, -jerk]
        bounds += [limit * factor] * 2
    # The jerk rows were linearised with the root of this upper bound; they are safe only below it.
    rows.append(matrices.value)
    bounds.append(upper * (1.0 + 1e-9))
    return _highs(matrices, rows, bounds, ends)


def _highs(
    matrices: SplineMatrices, rows: list[Any], bounds: list[FloatArray], ends: tuple[EndCondition, EndCondition]
) -> ProgramSolution:
    count = matrices.value.shape[1]
    # Every row is divided by its limit, because the tolerances of HiGHS are absolute.
    right = np.concatenate(bounds)
    left = vstack(rows).tocsr().multiply(1.0 / right[:, None])
    low, high = np.full(count, _LEAST_FEED_MM_S**2), np.full(count, np.inf)
    equal = np.zeros((2, count))
    for row, (end, outer, inner) in enumerate(((ends[0], 0, 1), (ends[1], count - 1, count - 2))):
        if end.fixed is not None:
            low[[outer, inner]] = high[[outer, inner]] = end.fixed
        else:
            high[outer] = end.outer_limit
            equal[row, [inner, outer]] = 1.0 / end.outer_limit, -end.ratio / end.outer_limit
    result = linprog(
        -matrices.integral_mm / np.sum(matrices.integral_mm),
        A_ub=left,
        b_ub=np.ones(len(right)),
        A_eq=equal,
        b_eq=np.zeros(2),
        bounds=list(zip(low.tolist(), high.tolist(), strict=True)),
        method="highs",
    )
    if result.x is None or not result.success:
        raise SolverError(f"the linear program of the window has no solution: {result.message}")
    return ProgramSolution(np.asarray(result.x, dtype=np.float64), "lp", len(right), int(result.nit))


class NonlinearProgram:
    """Feedrate v(s) with the largest integral under control signal, tracking error and kinematic limits (eq. 3-37)."""

    def __init__(
        self,
        matrices: SplineMatrices,
        geometry: AxisGeometry,
        limits: MotionLimits,
        ends: tuple[EndCondition, EndCondition],
    ) -> None:
        """Set up for CasADi. Raises ConfigError where it is not installed."""
        self._casadi = casadi = load_casadi()
        # In units of the highest feed, so that all numbers in the solvers are of the order of one.
        feed = np.minimum(geometry.feed_limit_mm_s, limits.kinematic.feed_mm_s).ravel()
        self._unit_mm_s = float(np.max(feed))
        unknown = casadi.MX.sym("c", matrices.value.shape[1])
        c = self._unit_mm_s * unknown
        value, slope, bend = (
            casadi.mtimes(casadi.DM(csc_array(matrix)), c) for matrix in (matrices.value, matrices.slope, matrices.bend)
        )
        rows = [value / feed]
        for axis in range(len(limits.axis_names)):
            g1, g2, g3 = (g[axis].ravel() for g in (geometry.g1, geometry.g2, geometry.g3))
            v = g1 * value
            a = g2 * value**2 + g1 * value * slope
            j = g3 * value**3 + 3.0 * g2 * value**2 * slope + g1 * value * (slope**2 + value * bend)
            rows += _axis_rows(limits, axis, np.sign(g1), (v, a, j))
        self._quantities = len(rows)
        relations = [
            (inner - end.ratio * outer) / end.outer_limit
            for end, outer, inner in zip(ends, (c[0], c[-1]), (c[1], c[-2]), strict=True)
            if end.fixed is None
        ]
        self._relation_values = np.zeros(len(relations))
        self._row_count = len(rows) * len(feed) + len(relations)
        self._problem = {
            "x": unknown,
            "f": -casadi.dot(matrices.integral_mm / np.mean(matrices.integral_mm), unknown),
            "g": casadi.vertcat(*rows, *relations),
        }

    def solve(
        self, guess: FloatArray, scale: FloatArray, ends: tuple[EndCondition, EndCondition], sqp_iterations: int
    ) -> ProgramSolution:
        """Solve by SQP, or by the interior point where SQP fails.

        Args:
            guess: control points to start from.
            scale: factor on every limit at the evaluation points, shape (p, m).
            ends: those of the set-up, with limits that may have been lowered.
            sqp_iterations: largest number of SQP iterations.

        Raises:
            SolverError: both failed.
        """
        factor = np.tile(scale.ravel(), self._quantities)
        low, high = np.full(len(guess), _LEAST_FEED_MM_S), np.full(len(guess), np.inf)
        for end, outer, inner in ((ends[0], 0, 1), (ends[1], -1, -2)):
            if end.fixed is not None:
                low[[outer, inner]] = high[[outer, inner]] = end.fixed
            else:
                high[outer] = end.outer_limit
        bounds = {
            "x0": np.clip(guess, low, high) / self._unit_mm_s,
            "lbx": low / self._unit_mm_s,
            "ubx": high / self._unit_mm_s,
            "lbg": np.concatenate([-factor, self._relation_values]),
            "ubg": np.concatenate([factor, self._relation_values]),
        }
        sqp = _SQP | {"max_iter": sqp_iterations}
        for name, plugin, options in (("sqp_osqp", "sqpmethod", sqp), ("ipopt", "ipopt", _IPOPT)):
            solver = self._casadi.nlpsol("window", plugin, self._problem, options)
            answer = solver(**bounds)
            g = np.array(answer["g"], dtype=np.float64).ravel()
            violation = np.maximum(g - bounds["ubg"], bounds["lbg"] - g)
            # OSQP's multipliers are too coarse to prove an optimum, so every feasible result of the SQP is accepted.
            if float(np.max(violation)) <= _FEASIBLE:
                points = self._unit_mm_s * np.array(answer["x"], dtype=np.float64).ravel()
                return ProgramSolution(points, name, self._row_count, int(solver.stats()["iter_count"]))
        raise SolverError("neither SQP nor the interior point found a feedrate within the limits")


def _axis_rows(limits: MotionLimits, axis: int, sign: FloatArray, motion: tuple[Any, Any, Any]) -> list[Any]:
    """Every limited quantity of an axis divided by its limit, at the evaluation points."""
    v, a, j = motion
    kinematic, rows = limits.kinematic, list[Any]()
    for quantity, limit in (
        (v, kinematic.velocity_mm_s[axis]),
        (a, kinematic.acceleration_mm_s2[axis]),
        (j, kinematic.jerk_mm_s3[axis]),
    ):
        if np.isfinite(limit):
            rows.append(quantity / limit)
    if (control := limits.control) is not None:
        friction = control.offset_volts[axis] + control.coulomb_volts[axis] * sign
        signal = control.inertia_volts_s2_mm[axis] * a + control.viscous_volts_s_mm[axis] * v + friction
        rows.append(signal / control.limit_volts[axis])
    if (tracking := limits.tracking) is not None:
        error = tracking.kv_s[axis] * v + tracking.ka_s2[axis] * a + tracking.kj_s3[axis] * j
        rows.append(error / tracking.limit_mm[axis])
    return rows
