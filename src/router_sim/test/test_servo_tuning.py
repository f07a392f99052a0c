"""Feed-forward gains against the error transfer function and against the simulated loop."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_moves import Move, circle

from feedopt_core.schema import build
from router_sim.parameters import RouterSimParameters, ServoParameters
from router_sim.router import SimulatedRouter
from router_sim.servo_tuning import FeedForwardGains, feed_forward_gains

PERIOD_S = 0.001
SERVO = ServoParameters(
    model_inertia_volts_s2_mm=2.0e-3,
    model_viscous_volts_s_mm=4.5e-2,
    model_offset_volts=0.1,
    model_coulomb_positive_volts=0.2,
    model_coulomb_negative_volts=0.2,
    velocity_filter_s=0.001,
    in_position_window_mm=0.0,
    position_gain_per_s=80.0,
    velocity_gain_volts_s_mm=0.4,
    velocity_integral_per_s=60.0,
    error_velocity_gain_s=5.0e-5,
    error_acceleration_gain_s2=1.0e-5,
    error_jerk_gain_s3=5.0e-8,
    sliding_bandwidth_rad_s=100.0,
    sliding_gain_volts_s_rad=1.0,
    adaptation_gain_volts_rad=100.0,
    disturbance_limit_volts=5.0,
    transmission_mm_rad=1.6977,
)


def error_transfer(servo: ServoParameters, gains: FeedForwardGains, s: complex) -> complex:
    """Tracking error over reference at the sampling instants, for a reference exp(s t); docs/simulated_router.md."""
    m, b = servo.model_inertia_volts_s2_mm, servo.model_viscous_volts_s_mm
    z = cmath.exp(s * PERIOD_S)
    decay = math.exp(-b / m * PERIOD_S)
    # Pulse transfer function of 1/(s (m s + b)) from a table of z transforms, by partial fractions.
    drive = (PERIOD_S / (z - 1.0) - m / b * (1.0 - decay) / (z - decay)) / b
    retained = math.exp(-PERIOD_S / servo.velocity_filter_s) if servo.velocity_filter_s > 0.0 else 0.0
    estimate = (1.0 - 1.0 / z) / PERIOD_S * (1.0 - retained) / (1.0 - retained / z)
    loop = servo.velocity_gain_volts_s_mm * (1.0 + servo.velocity_integral_per_s * PERIOD_S / (1.0 - 1.0 / z))
    forward = gains.viscous_volts_s_mm * s + gains.inertia_volts_s2_mm * s**2
    forward += gains.jerk_volts_s3_mm * s**2 * (1.0 - 1.0 / z) / PERIOD_S
    open_loop = 1.0 / drive + loop * (estimate - gains.velocity_ratio * s) - forward
    return open_loop / (1.0 / drive + loop * (servo.position_gain_per_s + estimate))


def error_coefficients(servo: ServoParameters, gains: FeedForwardGains, count: int) -> np.ndarray:
    """First Maclaurin coefficients of the error transfer function, from Cauchy's integral on a circle around 0."""
    radius, points = 10.0, 64
    circle_values = [
        error_transfer(servo, gains, radius * cmath.exp(2.0j * math.pi * (k + 0.5) / points)) for k in range(points)
    ]
    turned = np.fft.fft(circle_values) / points * np.exp(-1.0j * math.pi * np.arange(points) / points)
    return (turned.real / radius ** np.arange(points))[:count]


@given(
    kv=st.floats(-2e-4, 2e-4),
    ka=st.floats(-2e-5, 2e-5),
    kj=st.floats(-1e-7, 1e-7),
    filter_s=st.sampled_from([0.0, 0.001, 0.002]),
    inertia=st.floats(5e-4, 5e-3),
    viscous=st.floats(5e-3, 0.1),
)
def test_error_series_has_the_wanted_coefficients_and_no_snap_term(
    kv: float, ka: float, kj: float, filter_s: float, inertia: float, viscous: float
) -> None:
    servo = replace(
        SERVO,
        model_inertia_volts_s2_mm=inertia,
        model_viscous_volts_s_mm=viscous,
        velocity_gain_volts_s_mm=200.0 * inertia,
        velocity_filter_s=filter_s,
        error_velocity_gain_s=kv,
        error_acceleration_gain_s2=ka,
        error_jerk_gain_s3=kj,
    )
    found = error_coefficients(servo, feed_forward_gains(servo, PERIOD_S), 5)
    assert found == pytest.approx([0.0, kv, ka, kj, 0.0], abs=1e-12)


def test_error_of_a_servo_tuned_to_none_is_of_fifth_order() -> None:
    servo = replace(SERVO, error_velocity_gain_s=0.0, error_acceleration_gain_s2=0.0, error_jerk_gain_s3=0.0)
    gains = feed_forward_gains(servo, PERIOD_S)
    ratio = abs(error_transfer(servo, gains, 4.0j)) / abs(error_transfer(servo, gains, 2.0j))
    assert ratio == pytest.approx(2.0**5, rel=0.02)


def simulated_error(section: dict[str, Any], move: Move) -> tuple[np.ndarray, np.ndarray]:
    states = move.run(SimulatedRouter(build(RouterSimParameters, section, "test")))
    law = (section[key] for key in ("error_velocity_gain_s", "error_acceleration_gain_s2", "error_jerk_gain_s3"))
    return np.array([state.tracking_error_mm for state in states]), move.quasi_static_error_mm(*law)


@pytest.mark.parametrize(("radius_mm", "rate_rad_s"), [(60.0, 2.5), (13.0, 6.0), (5.0, 10.0)])
def test_simulated_error_follows_the_law_without_coulomb_friction(
    section: dict[str, Any], radius_mm: float, rate_rad_s: float
) -> None:
    for key in ("coulomb_positive_volts", "coulomb_negative_volts"):
        section[key] = section[f"model_{key}"] = [0.0, 0.0]
    simulated, law = simulated_error(section, circle(radius_mm, rate_rad_s))
    assert np.abs(law).max(axis=0).min() > 3e-3
    assert np.all(np.abs(simulated - law).max(axis=0) < 0.01 * np.abs(law).max(axis=0))


def test_coulomb_friction_shows_at_reversals_only(section: dict[str, Any]) -> None:
    simulated, law = simulated_error(section, circle(60.0, 2.5))
    rms = np.sqrt(np.mean((simulated - law) ** 2, axis=0))
    assert np.all(rms < 0.01 * np.abs(law).max(axis=0))
    assert np.all(np.abs(simulated - law).max(axis=0) < 0.05 * np.abs(law).max(axis=0))


def test_each_coefficient_is_needed_to_predict_the_simulated_error(section: dict[str, Any]) -> None:
    move = circle(13.0, 6.0)
    simulated, law = simulated_error(section, move)
    for key, derivative in (
        ("error_velocity_gain_s", move.velocity_mm_s),
        ("error_acceleration_gain_s2", move.acceleration_mm_s2),
        ("error_jerk_gain_s3", move.jerk_mm_s3),
    ):
        without = law - np.array(section[key]) * derivative
        assert np.all(np.abs(simulated - without).std(axis=0) > np.abs(simulated - law).std(axis=0)), key
