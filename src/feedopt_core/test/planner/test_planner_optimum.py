"""The planner against motions whose least time is known, and against what scaling and symmetry demand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_motion import ONE_WINDOW, difference_ratios, plan_path
from core_paths import kinematic_machine, line, planar, polyline, spline
from hypothesis import given, settings
from hypothesis import strategies as st

from feedopt_core.constraints.stopping_distance import stopping_distance_mm
from feedopt_core.geometry.segments import SegmentKind
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.certificate import ALLOWED_RATIO

BENT = np.array([(0, 0), (20, -3), (31, 12), (14, 25), (-6, 17), (3, 40)], dtype=float)
MACHINE = kinematic_machine()


def least_time_s(length_mm: float, v: float, a: float, j: float) -> float:
    """Least time from standstill to standstill on a straight line: seven phases, fewer where v or a is not reached."""

    def ramp_s(peak: float) -> float:
        return peak / a + a / j if peak >= a**2 / j else 2.0 * float(np.sqrt(peak / j))

    if 2.0 * stopping_distance_mm(v, a, j) <= length_mm:
        return 2.0 * ramp_s(v) + (length_mm - 2.0 * stopping_distance_mm(v, a, j)) / v
    low, high = 0.0, v
    for _ in range(100):
        peak = 0.5 * (low + high)
        low, high = (peak, high) if 2.0 * stopping_distance_mm(peak, a, j) < length_mm else (low, peak)
    return 2.0 * ramp_s(low)


@pytest.mark.parametrize("length_mm", [5.0, 20.0, 61.0, 200.0])
def test_straight_move_takes_the_least_time(length_mm: float) -> None:
    planned = plan_path(MACHINE, [line(length_mm)])
    least = least_time_s(length_mm, 150.0, 500.0, 25000.0)
    assert least <= planned.motion_time_s <= 1.005 * least


@pytest.mark.parametrize("length_mm", [1e-5, 1e-3, 0.1, 1.0])
def test_move_shorter_than_the_knot_spacing_is_planned_too(length_mm: float) -> None:
    """Few elements, so the least time is approached less closely; the limits hold all the same."""
    planned = plan_path(MACHINE, [line(length_mm)])
    least = least_time_s(length_mm, 150.0, 500.0, 25000.0)
    assert least <= planned.motion_time_s <= 1.08 * least
    assert planned.fine_audit().holds


@pytest.mark.parametrize(("heading_rad", "share"), [(np.pi / 2.0, 1.0), (np.pi, 1.0), (np.pi / 4.0, np.sqrt(0.5))])
def test_direction_counts_by_its_share_of_the_axes(heading_rad: float, share: float) -> None:
    """On a diagonal both axes do a part, so the path may go faster than either axis; the feed limit stays."""
    planned = plan_path(MACHINE, [line(60.0, heading_rad)])
    least = least_time_s(60.0, 150.0, 500.0 / share, 25000.0 / share)
    assert least <= planned.motion_time_s <= 1.005 * least


def test_slow_axis_rules_its_direction() -> None:
    machine = kinematic_machine(velocity=(150.0, 30.0), acceleration=(500.0, 100.0), jerk=(25000.0, 4000.0))
    planned = plan_path(machine, [line(60.0, np.pi / 2.0)])
    least = least_time_s(60.0, 30.0, 100.0, 4000.0)
    assert least <= planned.motion_time_s <= 1.005 * least


def test_programmed_feed_is_reached_and_not_exceeded() -> None:
    planned = plan_path(MACHINE, [line(100.0, feed_limit_mm_s=40.0)])
    v = planned.setpoints().v_mm_s
    assert 0.999 * 40.0 < np.max(v) <= 40.0 * ALLOWED_RATIO
    least = least_time_s(100.0, 40.0, 500.0, 25000.0)
    assert least <= planned.motion_time_s <= 1.005 * least


def test_feed_that_changes_at_a_joint_holds_on_both_sides() -> None:
    segments = polyline([(0, 0), (40, 0), (80, 0)], exact_stop=False, feed_limits_mm_s=[80.0, 20.0])
    setpoints = plan_path(MACHINE, segments).setpoints()
    slow = setpoints.s_mm >= 40.0
    assert np.max(setpoints.v_mm_s[slow]) <= 20.0 * ALLOWED_RATIO
    assert np.max(setpoints.v_mm_s[~slow]) > 0.99 * 80.0


def turns(machine: Machine, radius_mm: float, count: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Set points (s, v) and worst ratio of some turns of a circle."""
    circle = planar(SegmentKind.ARC, 2.0 * np.pi * radius_mm * count, curvature=1.0 / radius_mm)
    planned = plan_path(machine, [circle])
    setpoints = planned.setpoints()
    return setpoints.s_mm, setpoints.v_mm_s, planned.fine_audit().worst.ratio


@pytest.mark.parametrize(
    ("radius_mm", "acceleration", "jerk", "steady"),
    [
        (5.0, 500.0, 5e5, np.sqrt(500.0 * 5.0)),
        (5.0, 1e5, 25000.0, np.cbrt(25000.0 * 5.0**2)),
    ],
)
def test_circle_is_travelled_at_its_limit(radius_mm: float, acceleration: float, jerk: float, steady: float) -> None:
    """Constant feed sqrt(a r) (or cbrt(j r^2)) is possible, so the plan must not be slower, and its limit is used."""
    machine = kinematic_machine(1e4, (1e4,) * 2, (acceleration,) * 2, (jerk,) * 2)
    s, v, worst = turns(machine, radius_mm, 4.0)
    circumference = 2.0 * np.pi * radius_mm
    inner = (s > circumference) & (s < 3.0 * circumference)
    mean = (s[inner][-1] - s[inner][0]) / (0.001 * (np.count_nonzero(inner) - 1))
    assert mean >= 0.999 * steady
    assert 0.999 < worst <= ALLOWED_RATIO
    if acceleration < 1e5:
        # Where the tangent lies along an axis, the other one carries the whole of v^2 / r.
        quarter = np.abs((s / circumference * 4.0 + 0.5) % 1.0 - 0.5) < 0.01
        assert np.max(v[inner & quarter]) <= steady * 1.002


def test_feed_below_every_limit_of_a_circle_is_constant() -> None:
    radius = 10.0
    feed = 0.9 * min(np.sqrt(500.0 * radius), np.cbrt(25000.0 * radius**2))
    s, v, _ = turns(kinematic_machine(feed=feed), radius, 2.0)
    inner = (s > 10.0) & (s < s[-1] - 10.0)
    assert np.allclose(v[inner], feed, rtol=2e-3)


@pytest.fixture(scope="module")
def bent_time_s() -> float:
    return plan_path(MACHINE, spline(BENT)).motion_time_s


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_scaling_path_and_limits_alike_keeps_the_time(factor: float, bent_time_s: float) -> None:
    machine = kinematic_machine(150.0 * factor, (150.0 * factor,) * 2, (500.0 * factor,) * 2, (25000.0 * factor,) * 2)
    parameters = replace(ONE_WINDOW, knot_spacing_mm=0.25 * factor)
    # As close as the duality gap at which a solve ends.
    assert plan_path(machine, spline(factor * BENT), parameters).motion_time_s == pytest.approx(bent_time_s, rel=1e-5)


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_scaling_time_scales_the_motion(factor: float, bent_time_s: float) -> None:
    """v, a, j in new units of time: the same motion, faster by the factor."""
    machine = kinematic_machine(
        150.0 * factor, (150.0 * factor,) * 2, (500.0 * factor**2,) * 2, (25000.0 * factor**3,) * 2
    )
    assert plan_path(machine, spline(BENT)).motion_time_s * factor == pytest.approx(bent_time_s, rel=1e-6)


def test_reversed_path_takes_the_same_time(bent_time_s: float) -> None:
    assert plan_path(MACHINE, spline(BENT[::-1])).motion_time_s == pytest.approx(bent_time_s, rel=1e-5)


def test_swapped_and_mirrored_axes_take_the_same_time(bent_time_s: float) -> None:
    assert plan_path(MACHINE, spline(BENT[:, ::-1])).motion_time_s == pytest.approx(bent_time_s, rel=1e-6)
    assert plan_path(MACHINE, spline(BENT * [-1.0, 1.0])).motion_time_s == pytest.approx(bent_time_s, rel=1e-6)


def test_shifted_path_takes_the_same_time(bent_time_s: float) -> None:
    assert plan_path(MACHINE, spline(BENT + np.array([1e4, -1e4]))).motion_time_s == pytest.approx(
        bent_time_s, rel=1e-5
    )


def test_finer_knots_converge() -> None:
    times = [
        plan_path(MACHINE, spline(BENT), replace(ONE_WINDOW, knot_spacing_mm=spacing)).motion_time_s
        for spacing in (0.5, 0.25, 0.125)
    ]
    assert times[1] == pytest.approx(times[2], rel=2e-3)
    assert times[0] == pytest.approx(times[2], rel=1e-2)


@settings(max_examples=6)
@given(
    which=st.sampled_from(["feed", "velocity", "acceleration", "jerk"]),
    factor=st.floats(1.05, 4.0),
)
def test_looser_limit_is_never_slower(bent_time_s: float, which: str, factor: float) -> None:
    looser = {
        "feed": kinematic_machine(feed=150.0 * factor),
        "velocity": kinematic_machine(velocity=(150.0 * factor, 150.0)),
        "acceleration": kinematic_machine(acceleration=(500.0, 500.0 * factor)),
        "jerk": kinematic_machine(jerk=(25000.0 * factor, 25000.0)),
    }[which]
    assert plan_path(looser, spline(BENT)).motion_time_s <= 1.001 * bent_time_s


def test_tighter_limits_are_slower(bent_time_s: float) -> None:
    for machine in (kinematic_machine(acceleration=(250.0, 250.0)), kinematic_machine(feed=30.0)):
        assert plan_path(machine, spline(BENT)).motion_time_s > 1.05 * bent_time_s


def test_set_points_use_the_limits_and_hold_them() -> None:
    ratios = difference_ratios(plan_path(MACHINE, spline(BENT)).setpoints().position_mm, MACHINE)
    assert max(ratios.values()) <= ALLOWED_RATIO
    assert ratios["acceleration"] > 0.99
    assert ratios["jerk"] > 0.9
