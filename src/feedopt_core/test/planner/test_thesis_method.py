"""The thesis' own formulation: its conversion to q, its solvers and the switch between them, its plans."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from core_paths import drive_machine, line, spline, toolpath_of
from hypothesis import given, settings
from hypothesis import strategies as st

from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.errors import ConfigError
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.planner.mesh import QuadraticSpline
from feedopt_core.planner.method import StartState, Window, WindowPlan
from feedopt_core.planner.methods import make_method
from feedopt_core.planner.thesis import program as thesis_program
from feedopt_core.planner.thesis.method import squared

SPACING_MM = 2.0
MACHINE = replace(drive_machine(), acceleration_limit_mm_s2=(float("inf"),) * 2, jerk_limit_mm_s3=(float("inf"),) * 2)
CURVE = toolpath_of(spline([(0, 0), (3, 2), (7, 1), (10, 4)]))
# Far too few iterations to end anywhere near the limits.
HASTY_SQP = thesis_program._SQP | {
    "qpsol_options": {"error_on_fail": False, "osqp": {"verbose": False, "max_iter": 1}},
}
HASTY_IPOPT = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 0}}


def planned(toolpath: Toolpath, name: str = "thesis", window: Window | None = None) -> WindowPlan:
    return make_method(name, MACHINE, SPACING_MM).plan(toolpath, window or Window(0.0, toolpath.end_mm))


@pytest.fixture(scope="module")
def driven() -> WindowPlan:
    """The whole of CURVE."""
    return planned(CURVE)


def worst_ratio(toolpath: Toolpath, plan: WindowPlan) -> float:
    return audit_profile(toolpath, plan.profile, MACHINE).worst.ratio


@settings(max_examples=50, deadline=None)
@given(
    widths=st.lists(st.floats(0.05, 2.0), min_size=1, max_size=8),
    feeds=st.lists(st.floats(1.0, 200.0), min_size=10, max_size=10),
)
def test_square_is_exact_at_the_parts_and_smooth_between(widths: list[float], feeds: list[float]) -> None:
    knots = np.concatenate([[0.0], np.cumsum(widths)])
    basis, control = QuadraticSpline.on(knots), np.array(feeds[: len(widths) + 2])
    s_mm, q, slope, bend = squared(basis, control)
    h = np.diff(s_mm)
    scale = np.max(control) ** 2 / np.min(h)
    # The next element starts where the one before ends, in value and slope.
    np.testing.assert_allclose((q + (slope + 0.5 * bend * h) * h)[:-1], q[1:], rtol=0.0, atol=1e-11 * scale)
    np.testing.assert_allclose((slope + bend * h)[:-1], slope[1:], rtol=0.0, atol=1e-10 * scale / np.min(h))
    # Every other one starts at a part of a span, where q is the square of v.
    v0, v1, v2 = basis.start_of_spans(control)
    np.testing.assert_allclose(q[::4], v0**2, rtol=1e-12)
    x = 0.5 * np.array(widths)
    np.testing.assert_allclose(q[2::4], (v0 + (v1 + 0.5 * v2 * x) * x) ** 2, rtol=1e-9, atol=1e-9)


def test_square_between_the_parts_is_of_third_order() -> None:
    def error(spacing_mm: float) -> float:
        knots = np.arange(0.0, 8.0 + 0.5 * spacing_mm, spacing_mm)
        middle = np.concatenate([knots[:1], 0.5 * (knots[1:] + knots[:-1]), knots[-1:]])
        basis, control = QuadraticSpline.on(knots), 100.0 + 30.0 * np.sin(middle)
        s_mm, q, slope, bend = squared(basis, control)
        x = 0.4 * np.diff(s_mm)
        at = s_mm[:-1] + x
        v0, v1, v2 = basis.start_of_spans(control)
        span = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(v0) - 1)
        y = at - knots[span]
        exact = (v0[span] + (v1[span] + 0.5 * v2[span] * y) * y) ** 2
        return float(np.max(np.abs(q + (slope + 0.5 * bend * x) * x - exact)))

    assert error(0.25) <= 1.2 * error(0.5) / 8.0


def test_plan_holds_its_limits_and_is_close_to_the_optimum(driven: WindowPlan) -> None:
    best = planned(CURVE, "lp_nlp")
    assert driven.solver in {"sqp_osqp", "ipopt"}
    assert worst_ratio(CURVE, driven) <= 1.001
    # It maximises the integral of v: hardly faster than the minimum of time on the same mesh, and not far from it.
    assert 0.995 * best.profile.duration_s <= driven.profile.duration_s <= 1.05 * best.profile.duration_s


def test_interior_point_takes_over_where_sqp_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thesis_program, "_SQP", HASTY_SQP)
    plan = planned(CURVE)
    assert plan.solver == "ipopt"
    assert worst_ratio(CURVE, plan) <= 1.001


def test_linear_programme_answers_where_both_fail(driven: WindowPlan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thesis_program, "_SQP", HASTY_SQP)
    monkeypatch.setattr(thesis_program, "_IPOPT", HASTY_IPOPT)
    plan = planned(CURVE)
    assert plan.solver == "lp"
    assert worst_ratio(CURVE, plan) <= 1.001
    assert plan.profile.duration_s > driven.profile.duration_s


def test_window_goes_on_from_a_state_in_motion(driven: WindowPlan) -> None:
    profile = driven.profile
    at = int(np.searchsorted(profile.s_mm, 5.0))
    start = StartState(float(profile.q_mm2_s2[at]), float(profile.dq_ds_mm_s2[at]))
    begin_mm = float(profile.s_mm[at])
    plan = planned(CURVE, window=Window(begin_mm, CURVE.end_mm, start, profile[at:]))
    assert plan.profile.s_mm[0] == begin_mm
    assert plan.profile.q_mm2_s2[0] == pytest.approx(start.q_mm2_s2, rel=1e-9)
    assert plan.profile.dq_ds_mm_s2[0] == pytest.approx(start.dq_ds_mm_s2, rel=1e-6, abs=1e-6)
    assert worst_ratio(CURVE, plan) <= 1.001
    rest_s = profile.duration_s - float(profile.times_s[at])
    assert plan.profile.duration_s <= 1.01 * rest_s


def test_long_line_is_run_at_the_feed_limit() -> None:
    toolpath = toolpath_of([line(20.0, feed_limit_mm_s=40.0)])
    plan = planned(toolpath)
    assert float(np.max(plan.profile.states_at(np.linspace(0.0, plan.profile.duration_s, 2000)).v_mm_s)) <= 40.04
    assert 20.0 / 40.0 < plan.profile.duration_s < 20.0 / 40.0 + 0.2


def test_missing_casadi_is_named_with_the_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(ConfigError, match=r"needs CasADi.*requirements/run\.txt"):
        make_method("thesis", MACHINE, SPACING_MM)
