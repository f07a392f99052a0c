"""The drive against closed forms: step response, friction, stiction, belt mode, backlash, encoder."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from router_sim.parameters import AxisPlantParameters
from router_sim.plant import AxisPlant, Encoder

PERIOD_S = 0.001
M, B, C, D_PLUS, D_MINUS = 2.0e-3, 4.5e-2, 0.15, 0.25, 0.2
DRIVE = AxisPlantParameters(
    inertia_volts_s2_mm=M,
    viscous_volts_s_mm=B,
    offset_volts=C,
    coulomb_positive_volts=D_PLUS,
    coulomb_negative_volts=D_MINUS,
    saturation_volts=10.0,
    static_friction_ratio=1.0,
    stribeck_velocity_mm_s=2.0,
    ripple_volts=0.0,
    lead_error_mm=0.0,
    screw_pitch_mm=10.0,
    backlash_mm=0.0,
    mode_frequency_hz=60.0,
    mode_damping_ratio=0.02,
    mode_inertia_ratio=0.0,
    encoder_resolution_mm=0.0,
    encoder_noise_mm=0.0,
)


def moving(
    parameters: AxisPlantParameters, velocity_mm_s: float, period_s: float = PERIOD_S, substeps: int = 10
) -> AxisPlant:
    plant = AxisPlant(parameters, period_s, substeps)
    plant.velocity_mm_s = velocity_mm_s
    return plant


def trajectory(plant: AxisPlant, volts: float, periods: int) -> np.ndarray:
    """Position and velocity after each period, shape (periods, 2)."""
    rows = []
    for _ in range(periods):
        plant.advance(volts)
        rows.append((plant.position_mm, plant.velocity_mm_s))
    return np.array(rows)


@pytest.mark.parametrize("volts", [5.0, -5.0])
def test_voltage_step_is_the_exact_exponential(volts: float) -> None:
    plant = AxisPlant(DRIVE, PERIOD_S, 10)
    found = trajectory(plant, volts, 500)
    t = PERIOD_S * np.arange(1, 501)
    terminal = (volts - C - (D_PLUS if volts > 0.0 else -D_MINUS)) / B
    tau = M / B
    assert found[:, 1] == pytest.approx(terminal * (1.0 - np.exp(-t / tau)), rel=1e-12, abs=1e-12)
    assert found[:, 0] == pytest.approx(terminal * (t - tau * (1.0 - np.exp(-t / tau))), rel=1e-12, abs=1e-9)


@pytest.mark.parametrize("velocity", [0.1, 150.0, -0.1, -150.0])
def test_constant_velocity_needs_viscous_offset_and_coulomb(velocity: float) -> None:
    friction = D_PLUS if velocity > 0.0 else -D_MINUS
    plant = moving(DRIVE, velocity)
    found = trajectory(plant, B * velocity + C + friction, 1000)
    assert found[:, 1] == pytest.approx(velocity, rel=1e-12)
    assert found[-1, 0] == pytest.approx(velocity * 1.0, rel=1e-9)


@given(velocity=st.floats(0.01, 300.0), towards_plus=st.booleans())
def test_free_deceleration_stops_where_and_when_the_closed_form_says(velocity: float, towards_plus: bool) -> None:
    friction = D_PLUS if towards_plus else D_MINUS
    sign = 1.0 if towards_plus else -1.0
    stop_s = M / B * math.log1p(B * velocity / friction)
    distance_mm = M / B * velocity - friction / B * stop_s
    plant = moving(DRIVE, sign * velocity)
    periods = math.ceil(stop_s / PERIOD_S) + 1
    found = trajectory(plant, C, periods)
    moving_periods = np.count_nonzero(found[:, 1])
    assert moving_periods in (math.ceil(stop_s / PERIOD_S) - 1, math.floor(stop_s / PERIOD_S))
    assert found[-1, 0] == pytest.approx(sign * distance_mm, rel=1e-9, abs=1e-12)
    stopped_at = plant.position_mm
    trajectory(plant, C, 100)
    assert (plant.position_mm, plant.velocity_mm_s) == (stopped_at, 0.0)


@given(velocity=st.floats(-2.0, 2.0), volts=st.floats(-10.0, 10.0))
def test_a_period_is_the_same_in_one_piece_or_in_a_hundred(velocity: float, volts: float) -> None:
    whole = moving(DRIVE, velocity)
    parts = moving(DRIVE, velocity, period_s=PERIOD_S / 100.0)
    whole.advance(volts)
    trajectory(parts, volts, 100)
    assert whole.position_mm == pytest.approx(parts.position_mm, abs=1e-12)
    assert whole.velocity_mm_s == pytest.approx(parts.velocity_mm_s, abs=1e-9)


def test_reversal_inside_a_period_stops_and_leaves_in_closed_form() -> None:
    velocity, volts, tau = 0.5, -6.0, M / B
    braking, leaving = (volts - C - D_PLUS) / B, (volts - C + D_MINUS) / B
    stop_s = tau * math.log((velocity - braking) / -braking)
    assert 0.0 < stop_s < PERIOD_S
    rest_s = PERIOD_S - stop_s
    plant = moving(DRIVE, velocity)
    plant.advance(volts)
    assert plant.velocity_mm_s == pytest.approx(leaving * (1.0 - math.exp(-rest_s / tau)), rel=1e-9)
    gone = braking * stop_s + velocity * tau
    back = leaving * (rest_s - tau * (1.0 - math.exp(-rest_s / tau)))
    assert plant.position_mm == pytest.approx(gone + back, rel=1e-9)


@given(share=st.floats(-1.0, 1.0), ratio=st.sampled_from([1.0, 1.4]))
def test_axis_at_rest_sticks_within_breakaway(share: float, ratio: float) -> None:
    plant = AxisPlant(replace(DRIVE, static_friction_ratio=ratio), PERIOD_S, 10)
    plant.reset(12.5)
    breakaway = ratio * (D_PLUS if share > 0.0 else D_MINUS)
    trajectory(plant, C + share * breakaway * (1.0 - 1e-12), 20)
    assert (plant.position_mm, plant.velocity_mm_s) == (12.5, 0.0)


@pytest.mark.parametrize(("sign", "breakaway"), [(1.0, 1.4 * D_PLUS), (-1.0, 1.4 * D_MINUS)])
def test_axis_leaves_beyond_breakaway(sign: float, breakaway: float) -> None:
    plant = AxisPlant(replace(DRIVE, static_friction_ratio=1.4), PERIOD_S, 10)
    plant.advance(C + sign * breakaway * 1.0001)
    assert plant.velocity_mm_s * sign > 0.0


def test_stribeck_friction_is_coulomb_friction_at_speed_and_static_friction_near_rest() -> None:
    plant = moving(replace(DRIVE, static_friction_ratio=1.4), 50.0)
    plant.advance(B * 50.0 + C + D_PLUS)
    assert plant.velocity_mm_s == pytest.approx(50.0, abs=1e-9)
    creeping = moving(replace(DRIVE, static_friction_ratio=1.4), 2.0)
    needed = B * 2.0 + C + D_PLUS * (1.0 + 0.4 * math.exp(-1.0))
    creeping.advance(needed)
    assert creeping.velocity_mm_s == pytest.approx(2.0, abs=1e-9)


def test_amplifier_saturates() -> None:
    beyond, at_limit = AxisPlant(DRIVE, PERIOD_S, 10), AxisPlant(DRIVE, PERIOD_S, 10)
    assert np.array_equal(trajectory(beyond, 1e3, 50), trajectory(at_limit, 10.0, 50))


def test_coupled_substeps_converge_with_second_order(unmodelled: dict[str, Any]) -> None:
    drive = replace(DRIVE, **{key: value[0] for key, value in unmodelled.items()})
    # Starts and stays in motion: a stop would make the comparison hinge on the substep in which it falls.
    ends = []
    for substeps in (10, 20, 40, 1280):
        plant = moving(drive, 3.0, substeps=substeps)
        trajectory(plant, C + D_PLUS + 0.4, 300)
        ends.append(plant.position_mm)
    errors = np.abs(np.array(ends[:3]) - ends[3])
    assert errors[0] < 1e-4
    assert 3.5 < errors[0] / errors[1] < 4.5 and 3.5 < errors[1] / errors[2] < 4.5


def test_belt_mode_rings_at_its_frequency_and_damping_with_the_motor_held() -> None:
    frequency_hz, damping, amplitude_mm = 50.0, 0.02, 0.01
    held = replace(
        DRIVE,
        mode_inertia_ratio=0.3,
        mode_frequency_hz=frequency_hz,
        mode_damping_ratio=damping,
        static_friction_ratio=50.0,
    )
    plant = AxisPlant(held, PERIOD_S, 200)
    plant.screw_position_mm = amplitude_mm
    found = []
    for _ in range(100):
        plant.advance(C)
        found.append(plant.screw_position_mm)
    assert plant.position_mm == 0.0
    t = PERIOD_S * np.arange(1, 101)
    natural = 2.0 * math.pi * frequency_hz
    damped = natural * math.sqrt(1.0 - damping**2)
    expected = np.exp(-damping * natural * t) * (np.cos(damped * t) + damping * natural / damped * np.sin(damped * t))
    assert found == pytest.approx(amplitude_mm * expected, abs=1e-4 * amplitude_mm)


def test_drive_with_belt_mode_is_passive() -> None:
    ratio, frequency_hz = 0.3, 50.0
    plant = AxisPlant(
        replace(DRIVE, mode_inertia_ratio=ratio, mode_frequency_hz=frequency_hz, offset_volts=0.0), PERIOD_S, 10
    )
    plant.velocity_mm_s, plant.screw_velocity_mm_s = 100.0, -50.0
    stiffness = ratio * M * (2.0 * math.pi * frequency_hz) ** 2
    energies = []
    for _ in range(500):
        stretch = plant.position_mm - plant.screw_position_mm
        kinetic = (1.0 - ratio) * plant.velocity_mm_s**2 + ratio * plant.screw_velocity_mm_s**2
        energies.append(0.5 * (M * kinetic + stiffness * stretch**2))
        plant.advance(0.0)
    assert np.all(np.diff(energies) <= 0.0)
    assert energies[-1] < 0.01 * energies[0]


def test_belt_mode_leaves_the_total_inertia_unchanged() -> None:
    rigid = AxisPlant(DRIVE, PERIOD_S, 10)
    belted = AxisPlant(replace(DRIVE, mode_inertia_ratio=0.3, mode_damping_ratio=0.7), PERIOD_S, 10)
    apart_mm = trajectory(rigid, 5.0, 1000)[-1] - trajectory(belted, 5.0, 1000)[-1]
    # After the transient both run at terminal velocity; viscous friction acts on the motor, so equal momentum
    # means equal distance of the motor.
    assert apart_mm == pytest.approx([0.0, 0.0], abs=1e-3)


def test_ripple_adds_to_breakaway_with_the_screw_angle() -> None:
    drive = replace(DRIVE, ripple_volts=0.1)
    for position_mm, breakaway in ((2.5, D_PLUS + 0.1), (7.5, D_PLUS - 0.1), (5.0, D_PLUS)):
        plant = AxisPlant(drive, PERIOD_S, 10)
        plant.reset(position_mm)
        plant.advance(C + 0.999 * breakaway)
        assert plant.velocity_mm_s == 0.0
        plant.advance(C + 1.001 * breakaway)
        assert plant.velocity_mm_s > 0.0


def test_lead_error_moves_the_tool_and_not_the_motor() -> None:
    plant, plain = AxisPlant(replace(DRIVE, lead_error_mm=0.02), PERIOD_S, 10), AxisPlant(DRIVE, PERIOD_S, 10)
    for _ in range(300):
        plant.advance(5.0)
        plain.advance(5.0)
        assert plant.position_mm == plain.position_mm
        angle = 2.0 * math.pi * plant.position_mm / 10.0
        assert plant.tool_position_mm - plant.position_mm == pytest.approx(0.02 * math.sin(angle), abs=1e-12)


def test_backlash_is_lost_motion_of_its_width() -> None:
    play_mm = 0.05
    plant = AxisPlant(replace(DRIVE, backlash_mm=play_mm), PERIOD_S, 10)
    trajectory(plant, 5.0, 50)
    assert plant.position_mm - plant.tool_position_mm == pytest.approx(0.5 * play_mm, abs=1e-12)
    while plant.velocity_mm_s > 0.0:
        plant.advance(-5.0)
    turning_mm, held_mm = plant.position_mm, plant.tool_position_mm
    while plant.tool_position_mm == held_mm:
        before_mm = plant.position_mm
        plant.advance(-5.0)
    # The tool follows within the period in which the motor has crossed the play.
    assert turning_mm - before_mm < play_mm + 1e-3 and turning_mm - plant.position_mm > play_mm - 1e-3
    assert plant.tool_position_mm - plant.position_mm == pytest.approx(0.5 * play_mm, abs=1e-12)


@given(position=st.floats(-1e3, 1e3))
def test_reading_stands_on_the_encoder_grid_within_half_a_count(position: float) -> None:
    count_mm = 1.0 / 384.0
    reading = Encoder(count_mm, 0.0, "1 0").measure(position)
    assert reading == round(reading / count_mm) * count_mm
    assert abs(reading - position) <= 0.5 * count_mm * (1.0 + 1e-9)


def test_noise_has_its_deviation_and_follows_its_seed() -> None:
    encoder, other = Encoder(0.0, 0.002, "1 0"), Encoder(0.0, 0.002, "1 1")
    readings = np.array([encoder.measure(5.0) for _ in range(20_000)])
    assert readings.mean() == pytest.approx(5.0, abs=5.0 * 0.002 / math.sqrt(20_000))
    assert readings.std() == pytest.approx(0.002, rel=5.0 / math.sqrt(2 * 20_000))
    assert not np.array_equal(readings[:10], [other.measure(5.0) for _ in range(10)])
    encoder.reset()
    assert readings[:100].tolist() == [encoder.measure(5.0) for _ in range(100)]
