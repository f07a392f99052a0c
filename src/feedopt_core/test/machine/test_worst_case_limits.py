"""Kinematic limits that keep control signal and tracking error in the worst case, and stopping distances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_paths import drive_machine, kinematic_machine
from hypothesis import assume, given
from hypothesis import strategies as st

from feedopt_core.constraints.stopping_distance import longest_stop_mm, stopping_distance_mm
from feedopt_core.errors import InfeasibleLimitsError
from feedopt_core.machine.derived_limits import attainable_limits, braking_limits, derived_limits, ramp_limits
from feedopt_core.machine.limits import KinematicLimits, MotionLimits
from feedopt_core.machine.machine_file import DriveModel, Machine, TrackingModel, load_machine

SHIPPED = ("case_a", "router_experiment", "router_heng", "router_simulation")


def worst_control_volts(machine: Machine, limits: KinematicLimits, axis: int) -> float:
    """Largest control signal of an axis anywhere within its limits: every sign of v and a."""
    drive = machine.drive
    assert drive is not None
    v, a = limits.velocity_mm_s[axis], limits.acceleration_mm_s2[axis]
    signals = (
        abs(
            drive.inertia_volts_s2_mm[axis] * sa * a
            + drive.viscous_volts_s_mm[axis] * sv * v
            + drive.offset_volts[axis]
            + drive.coulomb_volts[axis] * sv
        )
        for sv in (-1.0, 1.0)
        for sa in (-1.0, 1.0)
    )
    return float(max(signals))


def worst_error_mm(machine: Machine, limits: KinematicLimits, axis: int) -> float:
    """Largest tracking error of an axis anywhere within its limits: every sign of v, a and j."""
    tracking = machine.tracking
    assert tracking is not None
    v, a, j = limits.velocity_mm_s[axis], limits.acceleration_mm_s2[axis], limits.jerk_mm_s3[axis]
    parts = tracking.tracking_kv_s[axis] * v, tracking.tracking_ka_s2[axis] * a, tracking.tracking_kj_s3[axis] * j
    return float(sum(abs(part) for part in parts))


def one_axis_less(machine: Machine, limits: KinematicLimits) -> None:
    """No limit grows, none vanishes."""
    for low, high in (
        (limits.velocity_mm_s, machine.velocity_limit_mm_s),
        (limits.acceleration_mm_s2, machine.acceleration_limit_mm_s2),
        (limits.jerk_mm_s3, machine.jerk_limit_mm_s3),
    ):
        assert np.all(low > 0.0) and np.all(low <= np.array(high))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_machines_hold_their_drive_limits(name: str) -> None:
    machine = load_machine(name)
    limits = derived_limits(machine)
    one_axis_less(machine, limits)
    for axis in range(len(machine.axis_names)):
        if machine.control_limit_volts is not None:
            assert worst_control_volts(machine, limits, axis) <= machine.control_limit_volts[axis] * (1.0 + 1e-12)
        if machine.tracking_error_limit_mm is not None:
            assert worst_error_mm(machine, limits, axis) <= machine.tracking_error_limit_mm[axis] * (1.0 + 1e-12)


GAIN = st.one_of(st.just(0.0), st.floats(1e-6, 1e-1))
SIGNED = st.tuples(st.sampled_from([-1.0, 1.0]), GAIN).map(lambda pair: pair[0] * pair[1])


@given(
    control=st.floats(0.5, 20.0),
    error=st.floats(1e-3, 1.0),
    drive=st.tuples(GAIN, GAIN, st.floats(-0.4, 0.4), st.floats(0.0, 0.4)),
    tracking=st.tuples(SIGNED, SIGNED, SIGNED),
)
def test_no_motion_within_the_limits_breaks_a_drive_limit(
    control: float,
    error: float,
    drive: tuple[float, float, float, float],
    tracking: tuple[float, float, float],
) -> None:
    inertia, viscous, offset, coulomb = drive
    kv, ka, kj = tracking
    assume(abs(offset) + coulomb < 0.95 * control)
    machine = replace(
        kinematic_machine(),
        control_limit_volts=(control,) * 2,
        drive=DriveModel((inertia,) * 2, (viscous,) * 2, (offset,) * 2, (coulomb,) * 2),
        tracking_error_limit_mm=(error,) * 2,
        tracking=TrackingModel((1e-3 * kv,) * 2, (1e-3 * ka,) * 2, (1e-5 * kj,) * 2),
    )
    limits = derived_limits(machine)
    one_axis_less(machine, limits)
    assert worst_control_volts(machine, limits, 0) <= control * (1.0 + 1e-9)
    assert worst_error_mm(machine, limits, 0) <= error * (1.0 + 1e-9)


def test_limits_that_need_no_lowering_stay() -> None:
    machine = drive_machine(control_volts=1e3, tracking_error_mm=1e3)
    limits = derived_limits(machine)
    assert np.array_equal(limits.velocity_mm_s, machine.velocity_limit_mm_s)
    assert np.array_equal(limits.acceleration_mm_s2, machine.acceleration_limit_mm_s2)
    assert np.array_equal(limits.jerk_mm_s3, machine.jerk_limit_mm_s3)


def test_control_limit_that_binds_is_used_up() -> None:
    """Velocity stays, acceleration gives way until m a + b v + |c| + d = u."""
    machine = drive_machine(control_volts=9.5, tracking_error_mm=1e3)
    limits = derived_limits(machine)
    assert limits.velocity_mm_s[1] == 150.0
    expected = (9.5 - 4.67e-2 * 150.0 - 0.148 - 0.241) / 2.13e-3
    assert limits.acceleration_mm_s2[1] == pytest.approx(expected, rel=1e-12)
    assert worst_control_volts(machine, limits, 1) == pytest.approx(9.5, rel=1e-12)


def test_velocity_gives_way_where_it_would_leave_no_acceleration() -> None:
    machine = drive_machine(control_volts=5.0, tracking_error_mm=1e3)
    limits = derived_limits(machine)
    assert limits.velocity_mm_s[0] < 150.0
    assert limits.acceleration_mm_s2[0] > 300.0


@pytest.mark.parametrize(("offset", "coulomb"), [(0.4, 0.2), (-0.4, 0.2), (0.0, 0.7), (0.6, 0.0)])
def test_friction_above_the_control_limit_is_infeasible(offset: float, coulomb: float) -> None:
    machine = drive_machine(control_volts=0.5, offset_volts=offset, coulomb_volts=coulomb)
    with pytest.raises(InfeasibleLimitsError, match=r"axis X, control at .*: friction and offset need") as caught:
        derived_limits(machine)
    assert (caught.value.quantity, caught.value.axis) == ("control", "X")
    assert caught.value.ratio == pytest.approx((abs(offset) + coulomb) / 0.5)


def simulated_stop_mm(v: float, a: float, j: float) -> float:
    """Distance of the stop found by stepping jerk, acceleration and velocity in time (exact within each step)."""
    ramp = min(a / j, np.sqrt(v / j))
    plateau = max(0.0, v / (j * ramp) - ramp)
    distance, acceleration = 0.0, 0.0
    for jerk, duration in ((-j, ramp), (0.0, plateau), (j, ramp)):
        steps = 50
        dt = duration / steps
        for _ in range(steps):
            distance += v * dt + acceleration * dt**2 / 2.0 + jerk * dt**3 / 6.0
            v += acceleration * dt + jerk * dt**2 / 2.0
            acceleration += jerk * dt
    assert abs(v) < 1e-6 and abs(acceleration) < 1e-6
    return distance


@given(v=st.floats(0.1, 500.0), a=st.floats(50.0, 5000.0), j=st.floats(1e3, 5e5))
def test_stopping_distance_is_that_of_the_simulated_stop(v: float, a: float, j: float) -> None:
    assert stopping_distance_mm(v, a, j) == pytest.approx(simulated_stop_mm(v, a, j), rel=1e-9)


def test_stopping_distance_has_no_step_between_its_two_forms() -> None:
    a, j = 500.0, 25000.0
    v = a**2 / j
    below, above = stopping_distance_mm(v * (1.0 - 1e-12), a, j), stopping_distance_mm(v, a, j)
    assert below == pytest.approx(above, rel=1e-10)


def test_longest_stop_is_that_of_the_weakest_axis() -> None:
    machine = kinematic_machine(feed=100.0, velocity=(150.0, 50.0), acceleration=(500.0, 20.0), jerk=(25000.0, 1000.0))
    expected = max(stopping_distance_mm(100.0, 500.0, 25000.0), stopping_distance_mm(50.0, 20.0, 1000.0))
    assert longest_stop_mm(KinematicLimits.of(machine)) == expected


def test_kinematic_limits_alone_are_what_is_attained_and_braked_with() -> None:
    machine = kinematic_machine(feed=100.0, velocity=(150.0, 50.0), acceleration=(500.0, 20.0), jerk=(25000.0, 1000.0))
    limits = MotionLimits.of(machine)
    for found in (attainable_limits(limits), braking_limits(limits), ramp_limits(limits)):
        assert found.velocity_mm_s.tolist() == [100.0, 50.0], "an axis is no faster than the feed"
        assert found.acceleration_mm_s2.tolist() == [500.0, 20.0]
        assert found.jerk_mm_s3.tolist() == [25000.0, 1000.0]


def test_drives_bound_what_the_machine_file_leaves_open() -> None:
    infinite = (float("inf"),) * 2
    machine = replace(
        drive_machine(),
        feed_limit_mm_s=1e4,
        velocity_limit_mm_s=infinite,
        acceleration_limit_mm_s2=infinite,
        jerk_limit_mm_s3=infinite,
    )
    limits = MotionLimits.of(machine)
    reach, braking, ramp = attainable_limits(limits), braking_limits(limits), ramp_limits(limits)
    assert reach.velocity_mm_s[0] == pytest.approx((10.0 - 0.148 - 0.241) / 4.67e-2)
    assert reach.acceleration_mm_s2[0] == pytest.approx(0.02 / 1.99e-5)
    assert reach.jerk_mm_s3[0] == pytest.approx(0.02 / 5.2e-8)
    # Braking: acceleration and jerk at once stay within the error, and the torque is left for it.
    assert 1.99e-5 * braking.acceleration_mm_s2[0] + 5.2e-8 * braking.jerk_mm_s3[0] == pytest.approx(0.02)
    assert 2.13e-3 * braking.acceleration_mm_s2[0] <= 10.0 - 0.148 + 0.241
    assert ramp.acceleration_mm_s2[0] == pytest.approx(0.4 * reach.acceleration_mm_s2[0])
    one_axis_less(machine, derived_limits(machine))
