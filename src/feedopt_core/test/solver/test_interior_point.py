"""The banded interior point against general-purpose optimisers on small problems."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.optimize import LinearConstraint, linprog, minimize

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import SolverError
from feedopt_core.planner.mesh import QuadraticSpline
from feedopt_core.solver import banded_interior_point
from feedopt_core.solver.banded_interior_point import (
    FixedStart,
    StandstillEnd,
    TimeProblem,
    TimeSolution,
    minimise_time,
)
from feedopt_core.solver.interior_point_data import DOWN, ROW, UP, Rows
from feedopt_core.solver.interior_point_kernel import iterate

Z = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0
REST = StandstillEnd(ratio=3.0, outer_limit=40.0)


@dataclass(frozen=True)
class Straight:
    """A straight line with q <= q_max(s) and |dq/ds| <= slope_limit, no jerk limit: all rows are linear."""

    spline: QuadraticSpline
    q_max: FloatArray
    slope_limit: float

    @classmethod
    def of(cls, spans: int, q_max: float, slope_limit: float, dip: float = 0.0) -> Straight:
        spline = QuadraticSpline.on(np.linspace(0.0, float(spans), spans + 1))
        s = spline.knots_mm[:-1] + Z[:, None] * spline.widths_mm
        return cls(spline, q_max - dip * np.exp(-((s - 0.6 * spans) ** 2)), slope_limit)

    @property
    def rows(self) -> FloatArray:
        value, slope, _ = self.spline.basis(Z)
        return np.concatenate([value / self.q_max, slope / self.slope_limit, -slope / self.slope_limit], axis=1)

    def problem(self, start: FixedStart | StandstillEnd, end: StandstillEnd) -> TimeProblem:
        basis = np.stack(self.spline.basis(Z)).transpose(3, 2, 0, 1).copy()
        weights = np.outer(self.spline.widths_mm, BOOLE)
        # One-sided rows, three kinds a point: factors of q and q'.
        coefficients = np.zeros((*weights.shape, 3), ROW)
        coefficients["on_q"][:, :, 0] = 1.0 / self.q_max.T
        coefficients["on_slope"][:, :, 1:] = np.array([1.0, -1.0]) / self.slope_limit
        inverse_limits = np.broadcast_to([1.0, 0.0], (*coefficients.shape[:3], 2)).copy()
        return TimeProblem(Rows(basis, weights, coefficients, inverse_limits, np.zeros(3)), start, end)

    def time(self, control_points: FloatArray) -> float:
        q = local_products(self.spline.basis(Z)[0], control_points)
        return float(np.sum(BOOLE[:, None] * self.spline.widths_mm / np.sqrt(q)))


def local_products(coefficients: FloatArray, control_points: FloatArray) -> FloatArray:
    """``sum_l coefficients[l] c[k + l]``: shape (3, r, m) and (m + 2,) to (r, m)."""
    m = coefficients.shape[2]
    return np.asarray(sum(coefficients[i] * control_points[i : m + i] for i in range(3)))


def dense(rows: FloatArray) -> FloatArray:
    """Rows of shape (3, r, m) as a matrix on all control points."""
    _, count, spans = rows.shape
    matrix = np.zeros((count, spans, spans + 2))
    for k in range(spans):
        matrix[:, k, k : k + 3] = rows[:, :, k].T
    return matrix.reshape(count * spans, spans + 2)


def end_conditions(start: FixedStart | StandstillEnd, end: StandstillEnd, count: int) -> tuple[FloatArray, FloatArray]:
    """Equations A c = b of the ends."""
    rows, right = list[FloatArray](), list[float]()
    unit = np.eye(count)
    if isinstance(start, FixedStart):
        rows += [unit[0], unit[1]]
        right += [start.first, start.second]
    else:
        rows.append(start.ratio * unit[0] - unit[1])
        right.append(0.0)
    rows.append(end.ratio * unit[-1] - unit[-2])
    right.append(0.0)
    return np.array(rows), np.array(right)


def bounds(start: FixedStart | StandstillEnd, end: StandstillEnd, count: int) -> list[tuple[float, float]]:
    """Bounds of the control points."""
    limits = [(0.01, np.inf)] * count
    if isinstance(start, StandstillEnd):
        limits[0] = (0.01, start.outer_limit)
    limits[-1] = (0.01, end.outer_limit)
    return limits


def reference(straight: Straight, start: FixedStart | StandstillEnd, end: StandstillEnd, guess: FloatArray) -> float:
    """Least time by sequential quadratic programming on the dense problem (convex: the global minimum)."""
    equations, right = end_conditions(start, end, len(guess))
    result = minimize(
        straight.time,
        guess,
        method="SLSQP",
        bounds=bounds(start, end, len(guess)),
        constraints=[
            LinearConstraint(dense(straight.rows), -np.inf, 1.0),
            LinearConstraint(equations, right, right),
        ],
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert result.success, result.message
    return straight.time(np.asarray(result.x))


@pytest.mark.parametrize("start", [REST, FixedStart(100.0, 110.0), FixedStart(20.0, 10.0)])
@pytest.mark.parametrize("dip", [0.0, 180.0])
@pytest.mark.parametrize("slope_limit", [30.0, 90.0])
def test_least_time_is_that_of_a_general_optimiser(
    start: FixedStart | StandstillEnd, dip: float, slope_limit: float
) -> None:
    straight = Straight.of(12, q_max=250.0, slope_limit=slope_limit, dip=dip)
    guess = np.full(14, 15.0)
    solution = minimise_time(straight.problem(start, REST), guess, tolerance=1e-8)
    c = solution.control_points
    equations, right = end_conditions(start, REST, len(c))
    assert np.allclose(equations @ c, right, atol=1e-9)
    assert np.max(dense(straight.rows) @ c) <= 1.0 + 1e-8
    assert c[-1] <= REST.outer_limit * (1.0 + 1e-8)
    assert straight.time(c) == pytest.approx(reference(straight, start, REST, c), rel=1e-6)


def test_ramps_alone_are_the_vertex_of_a_linear_programme() -> None:
    """Only slopes bind: the largest q everywhere is the fastest too, and it is the simplex method's vertex."""
    straight = Straight.of(20, q_max=1e4, slope_limit=30.0)
    start = FixedStart(10.0, 12.0)
    solution = minimise_time(straight.problem(start, REST), np.full(22, 9.0), tolerance=1e-9)
    equations, right = end_conditions(start, REST, 22)
    matrix = dense(straight.rows)
    vertex = linprog(
        -np.ones(22),
        A_ub=matrix,
        b_ub=np.ones(len(matrix)),
        A_eq=equations,
        b_eq=right,
        bounds=bounds(start, REST, 22),
        method="highs",
    )
    assert vertex.success and vertex.x is not None
    assert np.allclose(solution.control_points, vertex.x, rtol=1e-5)


def test_the_guess_does_not_matter() -> None:
    straight = Straight.of(12, q_max=250.0, slope_limit=60.0, dip=150.0)
    results = [
        minimise_time(straight.problem(REST, REST), guess, tolerance=1e-8).control_points
        for guess in (np.full(14, 1.0), np.full(14, 240.0), np.full(14, 5000.0))
    ]
    for other in results[1:]:
        assert np.allclose(other, results[0], rtol=1e-4)


def test_restart_under_lowered_limits_comes_to_the_same_optimum_sooner() -> None:
    before = Straight.of(40, q_max=250.0, slope_limit=60.0, dip=150.0)
    restart = minimise_time(before.problem(REST, REST), np.full(42, 20.0)).restart
    lowered = replace(before, q_max=before.q_max * np.where(np.arange(40) % 9 == 4, 0.98, 1.0))
    cold = minimise_time(lowered.problem(REST, REST), np.full(42, 20.0), tolerance=1e-7)
    warm = minimise_time(lowered.problem(REST, REST), restart, tolerance=1e-7)
    assert np.allclose(warm.control_points, cold.control_points, rtol=1e-3)
    assert lowered.time(warm.control_points) == pytest.approx(lowered.time(cold.control_points), rel=1e-6)
    assert warm.iterations < cold.iterations


def solve_and_count(
    straight: Straight, monkeypatch: pytest.MonkeyPatch, **thresholds: float
) -> tuple[TimeSolution, list[int]]:
    """A solution from standstill to standstill, and the number of sides that counted in each run of iterations."""
    sizes = list[int]()

    def counted(*arguments: Any) -> tuple[int, int, float, float, float]:
        sizes.append(arguments[4])
        return iterate(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(banded_interior_point, "iterate", counted)
        for name, value in thresholds.items():
            patch.setattr(banded_interior_point, name, value)
        guess = np.full(len(straight.spline.widths_mm) + 2, 20.0)
        return minimise_time(straight.problem(REST, REST), guess, tolerance=1e-8), sizes


def test_few_rows_count_near_the_optimum_and_all_are_obeyed(monkeypatch: pytest.MonkeyPatch) -> None:
    straight = Straight.of(40, q_max=250.0, slope_limit=60.0, dip=150.0)
    solution, sizes = solve_and_count(straight, monkeypatch)
    assert sizes[0] == solution.row_count and len(sizes) == 2 and sizes[1] < 0.6 * sizes[0]
    assert np.max(dense(straight.rows) @ solution.control_points) <= 1.0 + 1e-8


@pytest.mark.parametrize("selections", [5, 1])
def test_optimum_on_too_few_rows_is_taken_up_again_on_more(monkeypatch: pytest.MonkeyPatch, selections: int) -> None:
    straight = Straight.of(40, q_max=250.0, slope_limit=60.0, dip=150.0)
    expected, _ = solve_and_count(straight, monkeypatch)
    solution, sizes = solve_and_count(
        straight, monkeypatch, _NEAR=0.02, _AT_A_LIMIT=np.inf, _AROUND=1, _SELECTIONS=selections
    )
    assert len(sizes) > 2 and sizes[1] < sizes[2]
    assert np.max(dense(straight.rows) @ solution.control_points) <= 1.0 + 1e-8
    assert straight.time(solution.control_points) == pytest.approx(straight.time(expected.control_points), rel=1e-7)


def test_points_without_a_weight_are_left_out() -> None:
    """Their rows may say anything; limits they have none."""
    straight = Straight.of(12, q_max=250.0, slope_limit=60.0)
    problem = straight.problem(REST, REST)
    expected = minimise_time(problem, np.full(14, 20.0))
    wider = Rows(*(np.concatenate([part, part[:, -1:]], axis=1) for part in problem.rows[:4]), problem.rows.over_root)
    wider.weights_mm[:, -1], wider.inverse_limits[:, -1] = 0.0, 0.0
    wider.coefficients[:, -1] = np.nan
    found = minimise_time(replace(problem, rows=wider), np.full(14, 20.0))
    np.testing.assert_array_equal(found.control_points, expected.control_points)


def test_result_counts_its_rows() -> None:
    straight = Straight.of(12, q_max=250.0, slope_limit=60.0)
    solution = minimise_time(straight.problem(REST, REST), np.full(14, 20.0))
    assert solution.row_count == straight.rows.shape[1] * 12 + 2
    assert 0 < solution.iterations < 60


def test_start_above_the_limit_has_no_solution() -> None:
    straight = Straight.of(12, q_max=250.0, slope_limit=60.0)
    with pytest.raises(SolverError, match="largest violation"):
        minimise_time(straight.problem(FixedStart(400.0, 400.0), REST), np.full(14, 20.0))


@pytest.mark.parametrize("q", [0.0, -1.0, np.nan])
def test_guess_without_motion_has_no_solution(q: float) -> None:
    straight = Straight.of(12, q_max=250.0, slope_limit=60.0)
    with pytest.raises(SolverError):
        minimise_time(straight.problem(REST, REST), np.full(14, q))


def test_too_fast_to_brake_has_no_solution() -> None:
    """From q = 200 a slope of 5 over 12 mm cannot reach standstill."""
    straight = Straight.of(12, q_max=250.0, slope_limit=5.0)
    with pytest.raises(SolverError):
        minimise_time(straight.problem(FixedStart(200.0, 200.0), REST), np.full(14, 20.0))


def test_iterations_may_run_out() -> None:
    straight = Straight.of(12, q_max=250.0, slope_limit=60.0, dip=150.0)
    with pytest.raises(SolverError, match="no convergence after 2 iterations over 14 control points"):
        minimise_time(straight.problem(REST, REST), np.full(14, 20.0), max_iterations=2)


def test_local_products_are_the_dense_product() -> None:
    rng = np.random.default_rng(3)
    rows, c = rng.normal(size=(3, 4, 7)), rng.normal(size=9)
    assert np.allclose(local_products(rows, c).ravel(), dense(rows) @ c, atol=1e-14)


def test_basis_is_that_of_a_general_b_spline() -> None:
    knots = np.array([0.0, 0.3, 1.0, 1.1, 2.7, 4.0])
    spline = QuadraticSpline.on(knots)
    c = np.random.default_rng(5).uniform(1.0, 9.0, 7)
    oracle = BSpline(np.concatenate([[0.0, 0.0], knots, [4.0, 4.0]]), c, 2)
    z = np.array([0.0, 0.2, 0.9])
    s = knots[:-1] + z[:, None] * np.diff(knots)
    for order, basis in enumerate(spline.basis(z)):
        assert np.allclose(local_products(basis, c), oracle(s, nu=order), atol=1e-12)
    for order, values in enumerate(spline.start_of_spans(c)):
        assert np.allclose(values, oracle(knots[:-1], nu=order), atol=1e-12)


def driven_rows(spline: QuadraticSpline, geometry: tuple[float, float, float]) -> Rows:
    """One axis with torque 1.5 A + 2 g1 sqrt(q) and tracking error 0.4 A + 0.1 g1 sqrt(q) + 0.05 sqrt(q) W."""
    g1, g2, g3 = geometry
    basis = np.stack(spline.basis(Z)).transpose(3, 2, 0, 1).copy()
    coefficients = np.zeros((*basis.shape[:2], 3), ROW)
    inverse_limits = np.zeros((*basis.shape[:2], 3, 2))
    velocity, torque, error = (coefficients[:, :, row] for row in range(3))
    velocity["on_q"] = 1.0
    inverse_limits[:, :, 0, UP] = 1.0 / 250.0
    torque["on_q"], torque["on_slope"], torque["on_root"] = 1.5 * g2, 0.75 * g1, 2.0 * g1
    inverse_limits[:, :, 1, UP], inverse_limits[:, :, 1, DOWN] = 1.0 / 40.0, 1.0 / 44.0
    error["on_q"], error["on_slope"], error["on_root"] = 0.4 * g2, 0.2 * g1, 0.1 * g1
    error["on_root_q"], error["on_root_slope"], error["on_root_bend"] = 0.05 * g3, 0.075 * g2, 0.025 * g1
    inverse_limits[:, :, 2] = 1.0 / 6.0
    weights = np.outer(spline.widths_mm, BOOLE)
    return Rows(basis, weights, coefficients, inverse_limits, np.array([0.0, 0.0, 1.0]))


def slack(rows: Rows, control_points: FloatArray) -> FloatArray:
    """1 - row for every side with a limit, from the definition of a row."""
    c = np.stack([control_points[i : len(rows.basis) + i] for i in range(3)], axis=-1)
    # Shape (3, m, p, 1).
    q, q_slope, q_bend = np.einsum("mpxi,mi->xmp", rows.basis, c)[..., None]
    row = rows.coefficients
    by_root = row["on_root"] + row["on_root_q"] * q + row["on_root_slope"] * q_slope + row["on_root_bend"] * q_bend
    y = row["on_q"] * q + row["on_slope"] * q_slope + np.sqrt(q) * by_root
    sides = 1.0 - y[..., None] * [1.0, -1.0] * rows.inverse_limits
    return np.asarray(sides[rows.inverse_limits > 0.0])


@pytest.mark.parametrize("geometry", [(1.0, 0.0, 0.0), (0.8, 0.1, -0.01), (-0.9, 0.05, 0.0)])
def test_nonlinear_rows_hold_and_give_the_time_of_a_general_optimiser(geometry: tuple[float, float, float]) -> None:
    """Sequential quadratic programming under the rows themselves, started slower, comes to the same time."""
    straight = Straight.of(12, q_max=250.0, slope_limit=1.0)
    rows = driven_rows(straight.spline, geometry)
    solution = minimise_time(TimeProblem(rows, REST, REST), np.full(14, 15.0), tolerance=1e-8)
    c = solution.control_points
    assert np.min(slack(rows, c)) >= -1e-8
    assert np.count_nonzero(slack(rows, c) < 1e-4) >= 8, "limits bind nearly everywhere"
    equations, right = end_conditions(REST, REST, 14)
    oracle = minimize(
        straight.time,
        0.97 * c,
        method="SLSQP",
        bounds=bounds(REST, REST, 14),
        constraints=[
            {"type": "ineq", "fun": lambda x: slack(rows, x)},
            LinearConstraint(equations, right, right),
        ],
        options={"ftol": 1e-10, "maxiter": 300},
    )
    assert oracle.success, oracle.message
    assert straight.time(np.asarray(oracle.x)) == pytest.approx(straight.time(c), rel=1e-5)
