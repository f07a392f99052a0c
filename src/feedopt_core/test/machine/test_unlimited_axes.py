"""Machine files that leave limits of velocity, acceleration or jerk to the drive and tracking models."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml
from core_paths import kinematic_machine

from feedopt_core.audit.quantities import AxisMotion, kinematic_rows
from feedopt_core.audit.setpoints import audit_setpoints
from feedopt_core.errors import ConfigError
from feedopt_core.machine.machine_file import load_machine, parse_machine

KINEMATIC = ("velocity_limit_mm_s", "acceleration_limit_mm_s2", "jerk_limit_mm_s3")


def machine_text(**changes: Any) -> str:
    """A machine with both models and no kinematic limit but the feed; a change to None removes a key."""
    keys: dict[str, Any] = {
        "name": "bench",
        "axis_names": ["X", "Y"],
        "coordinate": ["x", "y"],
        "feed_limit_mm_s": 150.0,
        "control_limit_volts": [10.0, 10.0],
        "inertia_volts_s2_mm": [0.002, 0.002],
        "viscous_volts_s_mm": [0.04, 0.04],
        "offset_volts": [0.0, 0.0],
        "coulomb_volts": [0.1, 0.1],
        "tracking_error_limit_mm": [0.02, 0.02],
        "tracking_kv_s": [1.0e-5, 1.0e-5],
        "tracking_ka_s2": [1.0e-5, 1.0e-5],
        "tracking_kj_s3": [5.0e-8, 5.0e-8],
    } | changes
    section = {key: value for key, value in keys.items() if value is not None}
    return yaml.safe_dump({"/**": {"ros__parameters": {"machine": section}}})


def test_limits_that_are_not_given_are_infinite() -> None:
    machine = parse_machine(machine_text(), "bench.yaml")
    for key in KINEMATIC:
        assert getattr(machine, key) == (math.inf, math.inf)


def test_acceleration_of_the_thesis_router_is_limited_by_its_models_alone() -> None:
    machine = load_machine("router_simulation")
    assert machine.velocity_limit_mm_s == (150.0, 150.0)
    assert machine.control_limit_volts == (10.0, 10.0)
    assert machine.tracking_error_limit_mm == (0.02, 0.02)
    assert machine.planned_tracking_error_mm == (0.0155, 0.02)
    assert machine.acceleration_limit_mm_s2 == (math.inf, math.inf)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"tracking_kj_s3": [5.0e-8, 0.0]}, "nothing bounds the jerk of axis Y: give jerk_limit_mm_s3"),
        ({"tracking_kj_s3": [-5.0e-8, 5.0e-8]}, "nothing bounds the jerk of axis X"),
        (
            {"inertia_volts_s2_mm": [0.0, 0.002], "tracking_ka_s2": [0.0, 1.0e-5]},
            "nothing bounds the acceleration of axis X: give acceleration_limit_mm_s2",
        ),
    ],
)
def test_axis_without_any_bound_is_named_with_the_key(changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ConfigError, match=rf"^bench\.yaml: {complaint}"):
        parse_machine(machine_text(**changes), "bench.yaml")


@pytest.mark.parametrize(
    "changes",
    [
        {"inertia_volts_s2_mm": [0.0, 0.0]},
        {"tracking_ka_s2": [0.0, 0.0]},
        {"tracking_kj_s3": [0.0, 0.0], "jerk_limit_mm_s3": [1e5, 1e5]},
        {"inertia_volts_s2_mm": [0.0, 0.0], "tracking_ka_s2": [0.0, 0.0], "acceleration_limit_mm_s2": [5e2, 5e2]},
    ],
)
def test_one_bound_is_enough(changes: dict[str, Any]) -> None:
    assert parse_machine(machine_text(**changes), "bench.yaml").name == "bench"


def test_machine_without_models_needs_acceleration_and_jerk_limits() -> None:
    models = [key for key in yaml.safe_load(machine_text())["/**"]["ros__parameters"]["machine"] if "_volts" in key]
    models += ["tracking_error_limit_mm", "tracking_kv_s", "tracking_ka_s2", "tracking_kj_s3"]
    bare: dict[str, Any] = dict.fromkeys(models)
    with pytest.raises(ConfigError, match="nothing bounds the acceleration of axis X"):
        parse_machine(machine_text(**bare), "bench.yaml")
    with pytest.raises(ConfigError, match="nothing bounds the jerk of axis X"):
        parse_machine(machine_text(**bare, acceleration_limit_mm_s2=[1e3, 1e3]), "bench.yaml")
    given = parse_machine(machine_text(**bare, acceleration_limit_mm_s2=[1e3, 1e3], jerk_limit_mm_s3=[1e4] * 2), "b")
    assert given.velocity_limit_mm_s == (math.inf, math.inf)


def test_infinity_cannot_be_written() -> None:
    with pytest.raises(ConfigError, match="jerk_limit_mm_s3 of axis X is inf, must be finite"):
        parse_machine(machine_text(jerk_limit_mm_s3=[math.inf, 1.0]), "bench.yaml")


def test_quantity_without_a_limit_has_no_audit_row() -> None:
    machine = replace(kinematic_machine(), jerk_limit_mm_s3=(math.inf,) * 2, velocity_limit_mm_s=(math.inf, 100.0))
    ones = np.ones((2, 3))
    rows = kinematic_rows("fine", machine, AxisMotion(50.0 * ones, 100.0 * ones, 1e9 * ones, ones[0], ones[0]))
    assert [(row.quantity, row.axis) for row in rows] == [
        ("velocity", "Y"),
        ("acceleration", "X"),
        ("acceleration", "Y"),
    ]
    position = np.linspace([0.0, 0.0], [1.0, 1.0], 20)
    quantities = {row.quantity for row in audit_setpoints(position, position[:, 0], 1e-3, machine).rows}
    assert quantities == {"velocity", "acceleration"}
