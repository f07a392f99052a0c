"""The whole router: conventions, determinism, unmodelled effects, refusals."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from reference_moves import circle

from feedopt_core.schema import build
from router_sim.parameters import RouterSimParameters
from router_sim.router import AxisStates, SetpointError, SimulatedRouter

COUNT_MM = 1.0 / 384.0


def router(section: dict[str, Any], **changes: Any) -> SimulatedRouter:
    return SimulatedRouter(build(RouterSimParameters, {**section, **changes}, "test"))


def column(states: list[AxisStates], name: str) -> np.ndarray:
    return np.array([getattr(state, name) for state in states])


def test_first_state_is_the_rest_it_was_reset_to(section: dict[str, Any]) -> None:
    simulated = router(section)
    simulated.reset([3.0, -4.0])
    state = simulated.step([3.0, -4.0], [0.0, 0.0], [0.0, 0.0])
    assert state == AxisStates(
        reference_mm=(3.0, -4.0),
        position_mm=(3.0, -4.0),
        velocity_mm_s=(0.0, 0.0),
        tool_position_mm=(3.0, -4.0),
        tracking_error_mm=(0.0, 0.0),
        control_signal_volts=(0.148, 0.0119),
        saturated=(False, False),
    )


def test_state_is_that_of_the_instant_of_its_set_point(section: dict[str, Any]) -> None:
    simulated = router(section)
    simulated.reset([0.0, 0.0])
    state = simulated.step([1.0, 0.0], [0.0, 0.0], [0.0, 0.0])
    assert state.position_mm == (0.0, 0.0) and state.tracking_error_mm == (1.0, 0.0)
    assert state.control_signal_volts[0] == 10.0 and state.saturated == (True, False)
    assert simulated.step([1.0, 0.0], [0.0, 0.0], [0.0, 0.0]).position_mm[0] > 0.0


def test_states_are_consistent_and_readings_stand_on_the_grid(section: dict[str, Any]) -> None:
    move = circle(13.0, 6.0)
    states = move.run(router(section, encoder_resolution_mm=[COUNT_MM, 2.0 * COUNT_MM], encoder_noise_mm=[1e-3, 1e-3]))
    reference, position = column(states, "reference_mm"), column(states, "position_mm")
    assert np.array_equal(reference, move.position_mm)
    assert np.array_equal(column(states, "tracking_error_mm"), reference - position)
    grid = np.array([COUNT_MM, 2.0 * COUNT_MM])
    assert np.array_equal(position, np.round(position / grid) * grid)
    assert np.array_equal(column(states, "saturated"), np.abs(column(states, "control_signal_volts")) >= 10.0)


@pytest.mark.parametrize("controller", ["p_pi", "adaptive_sliding_mode"])
def test_the_same_seed_gives_the_same_bytes(
    section: dict[str, Any], unmodelled: dict[str, Any], controller: str
) -> None:
    changes = {**unmodelled, "encoder_noise_mm": [5e-4, 5e-4], "controller": controller}
    move = circle(5.0, 10.0)
    simulated = router(section, **changes)
    first = pickle.dumps(move.run(simulated))
    assert pickle.dumps(move.run(simulated)) == first
    assert pickle.dumps(move.run(router(section, **changes))) == first
    assert pickle.dumps(move.run(router(section, **changes, seed=2))) != first


def test_axes_are_independent(section: dict[str, Any], unmodelled: dict[str, Any]) -> None:
    section.update(unmodelled)
    move = circle(13.0, 6.0)
    both = move.run(router(section))
    alone = {key: value[:1] if isinstance(value, list) else value for key, value in section.items()}
    simulated = router(alone)
    for row, states in zip(
        zip(move.position_mm, move.velocity_mm_s, move.acceleration_mm_s2, strict=True), both, strict=True
    ):
        state = simulated.step(*(values[:1].tolist() for values in row))
        assert state.position_mm[0] == states.position_mm[0]
        assert state.control_signal_volts[0] == states.control_signal_volts[0]


def test_encoder_counts_blur_the_error_law_by_two_counts_at_most(section: dict[str, Any]) -> None:
    move = circle(45.0, 3.3)
    states = move.run(router(section, encoder_resolution_mm=[COUNT_MM, COUNT_MM]))
    law = move.quasi_static_error_mm(
        section["error_velocity_gain_s"], section["error_acceleration_gain_s2"], section["error_jerk_gain_s3"]
    )
    deviation = np.abs(column(states, "tracking_error_mm") - law)
    assert 0.25 * COUNT_MM < deviation.max() < 2.0 * COUNT_MM


@pytest.mark.parametrize(
    ("effect", "seen_by"),
    [
        ("static_friction_ratio", "tracking_error_mm"),
        ("ripple_volts", "tracking_error_mm"),
        ("mode_inertia_ratio", "tracking_error_mm"),
        ("lead_error_mm", "tool_position_mm"),
        ("backlash_mm", "tool_position_mm"),
    ],
)
def test_each_unmodelled_effect_shows(
    section: dict[str, Any], unmodelled: dict[str, Any], effect: str, seen_by: str
) -> None:
    move = circle(13.0, 6.0)
    plain = column(move.run(router(section)), seen_by)
    changed = column(move.run(router(section, **{effect: unmodelled[effect]})), seen_by)
    assert np.all(np.abs(changed - plain).max(axis=0) > 1e-4)


def test_motor_encoder_sees_neither_lead_error_nor_backlash(
    section: dict[str, Any], unmodelled: dict[str, Any]
) -> None:
    move = circle(5.0, 10.0)
    plain = column(move.run(router(section)), "position_mm")
    changes = {key: unmodelled[key] for key in ("lead_error_mm", "backlash_mm")}
    assert np.array_equal(column(move.run(router(section, **changes)), "position_mm"), plain)


def test_halving_the_substep_changes_the_trajectory_by_less_than_a_tenth_of_a_micrometre(
    section: dict[str, Any], unmodelled: dict[str, Any]
) -> None:
    move = circle(13.0, 6.0)
    coarse, fine = (
        column(move.run(router(section, **unmodelled, substeps=substeps)), "tool_position_mm") for substeps in (10, 20)
    )
    assert np.abs(coarse - fine).max() < 1e-4


@pytest.mark.parametrize(
    ("position", "velocity", "acceleration", "message"),
    [
        ([1.0], [0.0, 0.0], [0.0, 0.0], "1 values of position_mm, the simulated router has the axes X, Y"),
        ([1.0, 1.0], [0.0] * 3, [0.0, 0.0], "3 values of velocity_mm_s"),
        ([1.0, 1.0], [0.0, 0.0], [0.0, float("nan")], "axis Y has acceleration_mm_s2 nan"),
        ([float("inf"), 1.0], [0.0, 0.0], [0.0, 0.0], "axis X has position_mm inf"),
    ],
)
def test_bad_set_point_is_refused_and_moves_nothing(
    section: dict[str, Any], position: list[float], velocity: list[float], acceleration: list[float], message: str
) -> None:
    simulated = router(section)
    with pytest.raises(SetpointError, match=message):
        simulated.step(position, velocity, acceleration)
    assert simulated.step([0.0, 0.0], [0.0, 0.0], [0.0, 0.0]).position_mm == (0.0, 0.0)
