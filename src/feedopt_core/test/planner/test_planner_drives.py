"""The planner under control signal and tracking error themselves: known optima, scaling, fallbacks, fan contour."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from core_motion import ONE_WINDOW, PERIOD_S, PlannedPath, plan_path
from core_paths import INFINITY, drive_machine, kinematic_machine, line, spline, toolpath_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.quantities import AxisMotion, control_signal, tracking_error
from feedopt_core.config_files import config_directory
from feedopt_core.errors import InfeasibleLimitsError, SolverError
from feedopt_core.machine.machine_file import DriveModel, Machine, TrackingModel, load_machine
from feedopt_core.motion.certificate import ALLOWED_RATIO
from feedopt_core.planner.method import Window
from feedopt_core.planner.methods import METHOD_NAMES, make_method
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner
from feedopt_core.planner.time_optimal import window_solve
from feedopt_core.solver.banded_interior_point import TimeSolution, minimise_time

BENT = np.array([(0, 0), (20, -3), (31, 12), (14, 25), (-6, 17), (3, 40)], dtype=float)
FREE = (INFINITY, INFINITY)
LP = replace(ONE_WINDOW, method="lp")


def free_drives(control_volts: float = 10.0, tracking_error_mm: float = 0.02, offset_volts: float = 0.148) -> Machine:
    """Machine that only its drives limit."""
    machine = drive_machine(control_volts, tracking_error_mm, offset_volts=offset_volts)
    return replace(
        machine,
        feed_limit_mm_s=400.0,
        velocity_limit_mm_s=FREE,
        acceleration_limit_mm_s2=FREE,
        jerk_limit_mm_s3=FREE,
    )


def torque_machine(jerk: float) -> Machine:
    """One drive model, no tracking model; the jerk limit is far away."""
    machine = replace(free_drives(), tracking=None, tracking_error_limit_mm=None)
    return replace(machine, feed_limit_mm_s=1e4, jerk_limit_mm_s3=(jerk, jerk))


def least_torque_time_s(length_mm: float) -> float:
    """Full torque one way, then the other: v approaches its end exponentially on either branch."""
    m, b, c, d, u = 2.13e-3, 4.67e-2, 0.148, 0.241, 10.0
    tau, forward, backward = m / b, (u - c - d) / b, (u + c + d) / b

    def branches(t: float) -> tuple[float, float]:
        peak = forward * (1.0 - np.exp(-t / tau))
        braking = tau * np.log1p(peak / backward)
        return braking, forward * t - tau * peak + tau * peak - backward * braking

    t = brentq(lambda t: branches(t)[1] - length_mm, 1e-4, 100.0)
    return float(t + branches(t)[0])


@pytest.mark.parametrize("length_mm", [5.0, 40.0, 150.0])
def test_straight_move_takes_the_least_time_the_torque_allows(length_mm: float) -> None:
    planned = plan_path(torque_machine(1e7), [line(length_mm)])
    least = least_torque_time_s(length_mm)
    assert least <= planned.motion_time_s <= 1.01 * least
    assert planned.fine_audit().worst.ratio == pytest.approx(1.0, abs=1e-3)


def least_tracking_time_s(length_mm: float) -> float:
    """e = +E, -E, +E: three linear motions from standstill to standstill; their durations solve three equations."""
    kv, ka, kj, limit = 4.49e-5, 1.99e-5, 5.2e-8, 0.02
    matrix = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, -kv / kj, -ka / kj, limit / kj], [0, 0, 0, 0]], dtype=float)
    flipped = matrix * np.array([1.0, 1.0, 1.0, -1.0])

    def end(durations: FloatArray) -> FloatArray:
        first, second, third = np.abs(durations)
        state = expm(matrix * third) @ expm(flipped * second) @ expm(matrix * first) @ np.array([0.0, 0.0, 0.0, 1.0])
        return np.asarray((state[:3] - [length_mm, 0.0, 0.0]) * [1.0, 1e-2, 1e-4])

    guess = np.sqrt(length_mm / 1000.0)
    durations, _, found, message = fsolve(end, [guess, guess, 1e-3], full_output=True, xtol=1e-12)
    assert found == 1, message
    return float(np.sum(np.abs(durations)))


@pytest.mark.parametrize("length_mm", [2.0, 20.0])
def test_straight_move_takes_the_least_time_the_tracking_error_allows(length_mm: float) -> None:
    machine = replace(free_drives(), drive=None, control_limit_volts=None, feed_limit_mm_s=1e4)
    planned = plan_path(machine, [line(length_mm)], replace(ONE_WINDOW, knot_spacing_mm=length_mm / 100.0))
    least = least_tracking_time_s(length_mm)
    assert least <= planned.motion_time_s <= 1.008 * least
    assert planned.fine_audit().worst.ratio == pytest.approx(1.0, abs=1e-3)


def test_without_drive_models_both_methods_are_one() -> None:
    machine = kinematic_machine()
    direct, derived = plan_path(machine, spline(BENT)), plan_path(machine, spline(BENT), LP)
    assert direct.motion_time_s == derived.motion_time_s
    assert [chunk.figures.solver for chunk in direct.chunks + derived.chunks] == ["nlp", "lp"]


@pytest.fixture(scope="module")
def bent() -> PlannedPath:
    return plan_path(free_drives(), spline(BENT))


def test_drive_limits_are_used_and_held_at_1_khz(bent: PlannedPath) -> None:
    """Finite differences of the set points alone, with the standstill before and after them."""
    position = bent.setpoints().position_mm
    position = np.concatenate([np.repeat(position[:1], 4, axis=0), position, np.repeat(position[-1:], 4, axis=0)])
    v, a, j = (np.diff(position, n, axis=0).T / PERIOD_S**n for n in (1, 2, 3))
    # All three at the instants of the third differences.
    velocity, acceleration = v[:, 1:-1], 0.5 * (a[:, 1:] + a[:, :-1])
    motion = AxisMotion(velocity, acceleration, j, np.zeros(j.shape[1]), np.zeros(j.shape[1]))
    machine = bent.machine
    assert machine.drive is not None and machine.tracking is not None
    control, error = np.abs(control_signal(machine.drive, motion)), np.abs(tracking_error(machine.tracking, motion))
    assert np.max(control) <= 10.0 * ALLOWED_RATIO
    assert 0.98 * 0.02 <= np.max(error) <= 0.02 * ALLOWED_RATIO


def test_direct_limits_are_faster_than_derived_ones(bent: PlannedPath) -> None:
    derived = plan_path(free_drives(), spline(BENT), LP)
    assert bent.motion_time_s < 0.95 * derived.motion_time_s
    assert derived.fine_audit().holds


@settings(max_examples=6)
@given(control=st.floats(1.0, 2.0), error=st.floats(1.0, 3.0))
def test_looser_drive_limits_are_never_slower(bent: PlannedPath, control: float, error: float) -> None:
    looser = plan_path(free_drives(10.0 * control, 0.02 * error), spline(BENT))
    assert looser.motion_time_s <= 1.0005 * bent.motion_time_s


def scaled(machine: Machine, factor: float) -> Machine:
    """The same machine in another unit of length: signals keep their values, errors are lengths."""
    drive = machine.drive
    assert drive is not None and machine.tracking_error_limit_mm is not None
    return replace(
        machine,
        feed_limit_mm_s=factor * machine.feed_limit_mm_s,
        drive=replace(
            drive,
            inertia_volts_s2_mm=tuple(value / factor for value in drive.inertia_volts_s2_mm),
            viscous_volts_s_mm=tuple(value / factor for value in drive.viscous_volts_s_mm),
        ),
        tracking_error_limit_mm=tuple(factor * value for value in machine.tracking_error_limit_mm),
    )


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_another_unit_of_length_gives_the_same_time(bent: PlannedPath, factor: float) -> None:
    parameters = replace(ONE_WINDOW, knot_spacing_mm=0.25 * factor)
    other = plan_path(scaled(free_drives(), factor), spline(factor * BENT), parameters)
    assert other.motion_time_s == pytest.approx(bent.motion_time_s, rel=1e-4)


def test_reversed_path_takes_the_same_time_where_the_drives_are_symmetric() -> None:
    """Torque alone: braking is then the mirror image of accelerating but for friction, which always helps braking.

    So friction is left out, and viscous friction with it.
    """
    machine = torque_machine(1e5)
    assert machine.drive is not None
    frictionless = replace(
        machine, drive=DriveModel(machine.drive.inertia_volts_s2_mm, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    )
    there, back = (plan_path(frictionless, spline(points)) for points in (BENT, BENT[::-1]))
    assert there.motion_time_s == pytest.approx(back.motion_time_s, rel=1e-4)


def test_mirrored_path_takes_the_same_time_without_offset() -> None:
    machine = free_drives(offset_volts=0.0)
    first, mirrored = plan_path(machine, spline(BENT)), plan_path(machine, spline(BENT * [-1.0, 1.0]))
    assert first.motion_time_s == pytest.approx(mirrored.motion_time_s, rel=1e-5)


def failing(times: int) -> Callable[..., TimeSolution]:
    """The optimiser, failing for so many problems; each problem is tried from up to three guesses."""
    problems = list[object]()

    def solve(problem: object, *args: object, **kwargs: object) -> TimeSolution:
        if not problems or problems[-1] is not problem:
            problems.append(problem)
        if len(problems) <= times:
            raise SolverError("no convergence, for the test")
        return minimise_time(problem, *args, **kwargs)  # type: ignore[arg-type]

    return solve


@pytest.mark.parametrize(("failures", "solver"), [(0, "nlp"), (1, "nlp_robust"), (3, "nlp_robust")])
def test_failing_solver_is_replaced_and_named(monkeypatch: pytest.MonkeyPatch, failures: int, solver: str) -> None:
    """The fast one fails first, then both tries of the plan under derived limits."""
    method = make_method("lp_nlp", free_drives(), 0.5)
    monkeypatch.setattr(window_solve, "minimise_time", failing(failures))
    toolpath = toolpath_of([line(30.0)])
    assert method.plan(toolpath, Window(0.0, 30.0)).solver == solver


def test_plan_a_hair_beyond_its_limits_is_taken_where_no_repair_works(monkeypatch: pytest.MonkeyPatch) -> None:
    method, toolpath = make_method("lp_nlp", free_drives(), 0.5), toolpath_of([line(30.0)])
    expected = method.plan(toolpath, Window(0.0, 30.0))
    solves = list[object]()

    def once(*args: object, **kwargs: object) -> TimeSolution:
        solves.append(args)
        if len(solves) > 1:
            raise SolverError("no room for a repair, for the test")
        return minimise_time(*args, **kwargs)  # type: ignore[arg-type]

    def beyond(ratio: float) -> Callable[..., FloatArray]:
        return lambda solve, profile: np.full(len(profile[solve.spline_elements].kind), ratio)

    monkeypatch.setattr(window_solve, "minimise_time", once)
    monkeypatch.setattr(window_solve.WindowSolve, "limit_ratios", beyond(1.0007))
    plan = method.plan(toolpath, Window(0.0, 30.0))
    assert plan.solver == "nlp" and plan.profile.duration_s == expected.profile.duration_s
    solves.clear()
    monkeypatch.setattr(window_solve.WindowSolve, "limit_ratios", beyond(1.0009))
    with pytest.raises(SolverError):
        method.plan(toolpath, Window(0.0, 30.0))


def test_plan_under_derived_limits_is_taken_where_both_solvers_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    method = make_method("lp_nlp", free_drives(), 0.5)
    toolpath = toolpath_of([line(30.0)])
    expected = make_method("lp", free_drives(), 0.5).plan(toolpath, Window(0.0, 30.0))

    def only_kinematic(problem: window_solve.TimeProblem, *args: FloatArray, **kwargs: bool) -> TimeSolution:
        # Five kinds of rows: velocity, and acceleration and jerk of two axes.
        if np.any(problem.rows.coefficients["on_root"] != 0.0):
            raise SolverError("no convergence, for the test")
        return minimise_time(problem, *args, **kwargs)

    monkeypatch.setattr(window_solve, "minimise_time", only_kinematic)
    plan = method.plan(toolpath, Window(0.0, 30.0))
    assert plan.solver == "lp"
    assert plan.profile.duration_s == expected.profile.duration_s


@pytest.mark.parametrize("method", ["lp", "lp_nlp", "oneshot"])
def test_friction_above_the_control_limit_is_refused_at_once(method: str) -> None:
    with pytest.raises(InfeasibleLimitsError, match=r"axis X, control at .*: friction and offset need") as caught:
        make_method(method, free_drives(control_volts=0.3), 0.25)
    assert (caught.value.quantity, caught.value.axis, caught.value.ratio > 1.0) == ("control", "X", True)


def test_one_shot_waits_for_the_whole_path() -> None:
    parameters = PlannerParameters(method="oneshot", knot_spacing_mm=2.0, commitment_mm=5.0, look_ahead_mm=5.0)
    planner = StreamPlanner(free_drives(), parameters)
    segments = spline([(6.0 * k, 5.0 * np.sin(0.9 * k)) for k in range(22)])
    assert len(segments) > 1
    for segment in segments[:-1]:
        planner.add_segment(segment)
        assert planner.next_chunk() is None
    planner.add_segment(segments[-1])
    chunk = planner.next_chunk()
    assert chunk is not None and chunk.last and planner.finished
    assert chunk.s_commit_mm == chunk.s_stop_mm


def test_methods_have_names() -> None:
    assert set(METHOD_NAMES) >= {"lp", "lp_nlp", "oneshot", "thesis"}
    assert [make_method(name, kinematic_machine(), 0.25).name for name in ("lp", "lp_nlp")] == ["lp", "lp_nlp"]


def fan_machine() -> Machine:
    """The thesis' simulation study: drive and tracking models of table 3-1, 10 V, 0.02 mm, nothing else."""
    machine = load_machine("router_simulation")
    return replace(machine, velocity_limit_mm_s=FREE, jerk_limit_mm_s3=FREE, tracking_error_reserve_mm=None)


def test_fan_contour_is_within_half_a_percent_of_the_reference() -> None:
    text = (config_directory() / "programs" / "fan_contour.csv").read_text(encoding="utf-8")
    points = np.array([[float(value) for value in row.split(",")] for row in text.splitlines()[1:]])
    segments = spline(points)
    windowed = plan_path(fan_machine(), segments, PlannerParameters())
    reference = plan_path(fan_machine(), segments, PlannerParameters(method="oneshot"))
    derived = plan_path(fan_machine(), segments, PlannerParameters(method="lp"))
    assert len(windowed.chunks) > 2 and len(reference.chunks) == 1
    assert reference.motion_time_s <= windowed.motion_time_s <= 1.005 * reference.motion_time_s
    assert windowed.motion_time_s < 0.8 * derived.motion_time_s
    for planned in (windowed, reference, derived):
        assert planned.fine_audit().worst.ratio <= ALLOWED_RATIO
    assert {chunk.figures.solver for chunk in windowed.chunks} == {"nlp"}


def test_plan_leaves_the_reserve_of_the_tracking_error_to_the_servo() -> None:
    machine = replace(fan_machine(), tracking_error_reserve_mm=(0.005, 0.0))
    for method in ("lp", "lp_nlp"):
        planned = plan_path(machine, spline(BENT), PlannerParameters(method=method))
        rows = [row for row in planned.fine_audit().rows if row.quantity == "tracking_error"]
        assert [row.limit for row in rows] == pytest.approx([0.015, 0.02])
        assert max(row.ratio for row in rows) <= ALLOWED_RATIO
        without = plan_path(fan_machine(), spline(BENT), PlannerParameters(method=method))
        assert planned.motion_time_s > without.motion_time_s


def test_tracking_model_of_either_sign_is_planned() -> None:
    """A servo with feed-forward may lead instead of lag: negative kv."""
    machine = free_drives()
    tracking = TrackingModel((-4.49e-5,) * 2, (1.99e-5,) * 2, (5.2e-8,) * 2)
    planned = plan_path(replace(machine, tracking=tracking), spline(BENT))
    assert planned.fine_audit().holds
