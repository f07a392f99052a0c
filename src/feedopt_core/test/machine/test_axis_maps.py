"""Axis maps that mix tool coordinates: the H-bot, by hand and on the fan contour."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import yaml
from core_motion import difference_ratios

from feedopt_core.config_files import find_config
from feedopt_core.errors import ConfigError
from feedopt_core.machine.machine_file import Machine, load_machine, parse_machine
from feedopt_core.motion.certificate import ALLOWED_RATIO
from feedopt_core.pipeline.plan_program import plan_program
from feedopt_core.planner.stream_planner import PlannerParameters

BELT_MM_PER_RAD = 28.0 / 5.0


def with_map(axis_map: Any, names: tuple[str, ...] = ("M1", "M2"), **more: Any) -> Machine:
    section = {
        "name": "bench",
        "axis_names": list(names),
        "axis_map": axis_map,
        "feed_limit_mm_s": 1000.0,
        "velocity_limit_mm_s": [100.0] * len(names),
        "acceleration_limit_mm_s2": [1000.0] * len(names),
        "jerk_limit_mm_s3": [20000.0] * len(names),
    } | more
    return parse_machine(yaml.safe_dump({"/**": {"ros__parameters": {"machine": section}}}), "bench.yaml")


def test_hbot_motors_turn_by_sum_and_difference() -> None:
    machine = load_machine("hbot")
    tool_mm = np.array([3.0, 5.0])
    assert np.array_equal(machine.axis_matrix() @ tool_mm, [8.0, -2.0])
    np.testing.assert_allclose(machine.tool_matrix() @ [8.0, -2.0], tool_mm, rtol=1e-15)
    assert machine.dimensions == 2


def test_hbot_limits_are_those_of_the_motor() -> None:
    machine = load_machine("hbot")
    assert machine.velocity_limit_mm_s == pytest.approx((314.0 * BELT_MM_PER_RAD,) * 2)
    assert machine.acceleration_limit_mm_s2 == pytest.approx((1700.0 * BELT_MM_PER_RAD,) * 2)
    assert machine.jerk_limit_mm_s3 == pytest.approx((51500.0 * BELT_MM_PER_RAD,) * 2)


def test_tool_position_of_a_gantry_is_the_mean_of_its_motors() -> None:
    machine = load_machine("router_heng")
    np.testing.assert_allclose(machine.tool_matrix() @ [1.0, 3.0, 5.0, 7.0], [2.0, 5.0, 7.0], rtol=1e-14)


# From standstill to standstill along x both belts move by the same distance; along the diagonal x = y only the first
# one moves, by twice its projection; so the feed is scaled by 1, and by 1 / sqrt 2.
@pytest.mark.parametrize(("direction", "belt_per_mm"), [((1.0, 0.0), 1.0), ((1.0, 1.0), math.sqrt(2.0))])
def test_line_takes_the_time_of_the_busiest_belt(
    tmp_path: Any, direction: tuple[float, float], belt_per_mm: float
) -> None:
    machine = with_map([[1.0, 1.0], [1.0, -1.0]])
    end_mm = 200.0 * np.array(direction) / math.hypot(*direction)
    program = tmp_path / "line.csv"
    program.write_text("".join(f"{x!r},{y!r}\n" for x, y in np.linspace([0.0, 0.0], end_mm, 5).tolist()))
    plan = plan_program(program, machine, PlannerParameters())
    v, a, j = (limit / belt_per_mm for limit in (100.0, 1000.0, 20000.0))
    exact_s = 200.0 / v + v / a + a / j
    assert plan.audit.holds
    assert exact_s <= plan.motion_time_s <= 1.003 * exact_s
    expected = end_mm @ machine.axis_matrix().T
    np.testing.assert_allclose(plan.setpoints.position_mm[-1], expected, atol=1e-9)


def test_fan_contour_on_the_hbot_holds_every_motor_limit() -> None:
    machine = load_machine("hbot")
    plan = plan_program(find_config("programs", "fan_contour", ".csv"), machine, PlannerParameters())
    assert plan.audit.holds
    assert max(difference_ratios(plan.setpoints.position_mm, machine).values()) <= ALLOWED_RATIO
    tool_mm = plan.setpoints.position_mm @ machine.tool_matrix().T
    np.testing.assert_allclose(tool_mm, plan.setpoints.tool_mm[:, :2], atol=1e-9)


@pytest.mark.parametrize(
    ("axis_map", "complaint"),
    [
        ([[1.0, 1.0]], "axis_map is [[1.0, 1.0]], needs 2 values, one for each of M1, M2"),
        ([[1.0, 1.0], [1.0]], "axis_map of axis M2 is"),
        ([[1.0], [1.0]], "axis_map of axis M1 is [1.0], must be 2 or 3 factors"),
        ([[1.0, 1.0], 1.0], "axis_map of axis M2 is 1.0, must be a list"),
        ([[1.0, "1e0"], [1.0, -1.0]], "axis_map[1] of axis M1 is '1e0', must be a number"),
        ([[1.0, math.nan], [1.0, -1.0]], "axis_map[1] of axis M1 is nan, must be finite"),
        ([[1.0, 0.0], [1.0, 0.0]], "no axis follows coordinate y"),
        ([[1.0, 1.0], [2.0, 2.0]], "axis_map has dependent rows"),
    ],
)
def test_impossible_map_is_named(axis_map: Any, complaint: str) -> None:
    with pytest.raises(ConfigError) as caught:
        with_map(axis_map)
    assert complaint in str(caught.value)


def test_map_and_coordinate_exclude_each_other() -> None:
    with pytest.raises(ConfigError, match="give either coordinate or axis_map"):
        with_map([[1.0, 0.0], [0.0, 1.0]], coordinate=["x", "y"])
