"""Knots of the feed profile: joints, bends, standstill."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_paths import kinematic_machine, spline, toolpath_of

from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.limits import MotionLimits
from feedopt_core.motion.profile import FeedProfile
from feedopt_core.planner.mesh import GROWTH, SPARE_GROWTH, KnotSpacing, graded_knots
from feedopt_core.planner.method import Window
from feedopt_core.planner.time_optimal.window_solve import WindowSolve, continued_knots

NOISE = np.column_stack([0.05 * np.arange(120), 1e-3 * np.sin(37.0 * np.arange(120) ** 2)])
ZIGZAG = np.array([(1.0 * k, 3.0 * (k % 2)) for k in range(14)])
PARTS = ("kind", "q_mm2_s2", "dq_ds_mm_s2", "d2q_ds2_per_s2", "jerk_mm_s3")
GENTLE = np.array([(20.0 * k, 2.0 * (k % 3)) for k in range(8)])


def window(toolpath: Toolpath, start_mm: float, element_mm: float | None = 0.01) -> np.ndarray:
    spacing = KnotSpacing(toolpath, 0.25)
    return graded_knots(start_mm, toolpath.end_mm, spacing, start_element_mm=element_mm, end_element_mm=0.01)


@pytest.mark.parametrize("points", [NOISE, ZIGZAG, GENTLE])
def test_every_joint_outside_the_elements_at_rest_is_a_knot(points: np.ndarray) -> None:
    toolpath = toolpath_of(spline(points))
    knots = window(toolpath, 0.0)
    joints = toolpath.joints_mm(0.0, toolpath.end_mm)
    inside = joints[(joints > knots[1]) & (joints < knots[-2])]
    assert len(inside) >= len(points) - 4
    assert np.all(np.isin(inside, knots))
    assert np.all(np.diff(knots) > 0.0)
    assert knots[0] == 0.0
    assert knots[-1] == toolpath.end_mm


def test_element_at_rest_ends_at_the_first_joint() -> None:
    toolpath = toolpath_of(spline(NOISE))
    knots = window(toolpath, 0.0, element_mm=5.0)
    assert knots[1] <= toolpath.joints_mm(0.0, 1.0)[1]


def test_knots_are_denser_where_the_path_bends() -> None:
    toolpath = toolpath_of(spline(ZIGZAG))
    knots = window(toolpath, 0.0)
    middle, widths = knots[:-1] + 0.5 * np.diff(knots), np.diff(knots)
    bend = toolpath.bend_length_mm(middle)
    assert np.min(bend) < 0.2
    assert np.all(widths <= 0.6 * bend + 1e-3)
    assert np.all(np.diff(knots) <= 0.25 * (1.0 + 1e-9))


def test_spacing_grows_from_rest_by_one_factor() -> None:
    toolpath = toolpath_of(spline(GENTLE))
    widths = np.diff(window(toolpath, 0.0))
    growing = widths[: int(np.argmax(widths > 0.19))]
    assert growing[0] == pytest.approx(0.01)
    assert np.allclose(growing[1:] / growing[:-1], GROWTH)


def test_window_that_starts_in_motion_has_the_knots_of_the_one_before() -> None:
    """A state left at a knot is then a state of the same spline: the stop behind it stays feasible."""
    toolpath = toolpath_of(spline(GENTLE))
    before = window(toolpath, 0.0)
    start = before[len(before) // 2]
    after = window(toolpath, float(start), element_mm=None)
    assert np.allclose(after, before[len(before) // 2 :], atol=1e-9)


def test_knots_of_the_stop_before_go_on_in_its_first_half() -> None:
    toolpath = toolpath_of(spline(GENTLE))
    knots = window(toolpath, 3.0, element_mm=None)
    split = np.unique(np.concatenate([knots[knots < 40.0], [10.03, 35.03]]))
    count = len(split) - 1
    flat = np.zeros(count)
    guess = FeedProfile(np.zeros(count, dtype=np.int64), split, np.full(count, 100.0), flat, flat, flat)
    joints = toolpath.joints_mm(3.0, toolpath.end_mm)
    continued = continued_knots(knots, guess, joints)
    assert 10.03 in continued and 35.03 not in continued
    assert np.all(np.diff(continued) > 0.0) and np.array_equal(continued[[0, -1]], knots[[0, -1]])
    assert set(knots.tolist()) <= set(continued.tolist())
    # On knots that do not fit, neither a sliver nor a joint that is lost.
    shifted = np.concatenate([[3.0], knots[knots < 40.0][1:] + 0.249])
    odd = replace(guess, **{field: getattr(guess, field)[: len(shifted) - 1] for field in PARTS}, s_mm=shifted)
    continued = continued_knots(knots, odd, joints)
    assert np.min(np.diff(continued[continued < 100.0])) > 0.05
    assert set(joints[(joints > 25.0) & (joints < toolpath.end_mm)].tolist()) <= set(continued.tolist())


@pytest.mark.parametrize(("radius_mm", "left_out"), [(60.0, True), (1.0, False)])
def test_points_are_left_out_where_the_path_hardly_bends(radius_mm: float, left_out: bool) -> None:
    angle = np.linspace(0.0, 1.5 * np.pi, 40)
    toolpath = toolpath_of(spline(radius_mm * np.column_stack([np.cos(angle), np.sin(angle)])))
    machine = kinematic_machine()
    solve = WindowSolve(MotionLimits.of(machine), toolpath, Window(0.0, toolpath.end_mm), window(toolpath, 0.0))
    middle = solve.weights_mm[:, solve.weights_mm.shape[1] // 2]
    assert np.array_equal(middle == 0.0, [False, left_out, False, left_out, False])
    np.testing.assert_allclose(solve.weights_mm.sum(axis=0), solve.spline.widths_mm)
    assert np.all(solve.weights_mm[:, :8] > 0.0), "next to standstill all of them count"


def test_stop_held_in_reserve_has_fewer_knots_at_its_end_alone() -> None:
    toolpath = toolpath_of(spline(GENTLE))
    spacing, end_mm = KnotSpacing(toolpath, 0.25), toolpath.end_mm
    full = graded_knots(0.0, end_mm, spacing, start_element_mm=0.001, end_element_mm=0.001)
    spare = graded_knots(0.0, end_mm, spacing, start_element_mm=0.001, end_element_mm=0.001, spare_end=True)
    assert len(spare) < len(full) - 5
    assert np.array_equal(spare[:50], full[:50])
    widths = np.diff(spare)[::-1]
    growing = widths[: int(np.argmax(widths > 0.1))]
    assert np.allclose(growing[1:] / growing[:-1], SPARE_GROWTH)
