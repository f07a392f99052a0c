"""What a plan promises by the quasi-static models holds on the simulated servos, which know nothing of those models."""

from __future__ import annotations

import numpy as np
import pytest

from feedopt_core.config.locate import config_directory
from feedopt_core.config.machine import load_machine
from feedopt_core.feedrate.planner import PlannerParameters
from feedopt_core.plan import plan_program
from router_sim.machine_file import load_router_parameters
from router_sim.router import SimulatedRouter

PERIOD_S = 0.001
SETTLING_TICKS = 200


@pytest.mark.parametrize("method", ["lp", "lp_nlp"])
@pytest.mark.parametrize("name", ["router_simulation", "router_experiment"])
def test_fan_contour_stays_within_the_tracking_error_limit_without_saturation(name: str, method: str) -> None:
    machine, parameters = load_machine(name), load_router_parameters(name)
    program = config_directory() / "programs" / "fan_contour.csv"
    position_mm = plan_program(program, machine, PlannerParameters(method=method)).setpoints.position_mm
    position_mm = np.concatenate([position_mm, np.repeat(position_mm[-1:], SETTLING_TICKS, axis=0)])
    velocity_mm_s = np.gradient(position_mm, PERIOD_S, axis=0)
    acceleration_mm_s2 = np.gradient(velocity_mm_s, PERIOD_S, axis=0)
    router = SimulatedRouter(parameters)
    router.reset(position_mm[0])
    states = [router.step(*rows) for rows in zip(position_mm, velocity_mm_s, acceleration_mm_s2, strict=True)]
    error_mm = np.max(np.abs([state.tracking_error_mm for state in states]), axis=0)
    assert machine.tracking_error_limit_mm is not None
    assert np.all(error_mm <= machine.tracking_error_limit_mm), error_mm
    assert not any(saturated for state in states for saturated in state.saturated)
    # It is tight: a plan that wasted the limit would pass as well.
    assert np.max(error_mm / machine.tracking_error_limit_mm) > 0.75
