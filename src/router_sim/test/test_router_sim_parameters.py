"""Parameter sections: what is accepted, and what is refused by name."""

from __future__ import annotations

import array
from dataclasses import fields
from typing import Any

import pytest

from feedopt_core.errors import ConfigError
from feedopt_core.schema import build, rule_of
from router_sim.parameters import AxisPlantParameters, ControllerKind, RouterSimParameters, ServoParameters

AXIS_KEYS = [quantity.name for quantity in (*fields(AxisPlantParameters), *fields(ServoParameters))]


def test_values_reach_their_axis(section: dict[str, Any]) -> None:
    parameters = build(RouterSimParameters, section, "test")
    assert parameters.axis_names == ("X", "Y")
    assert parameters.controller is ControllerKind.P_PI
    for axis in range(2):
        for name in AXIS_KEYS:
            owner = parameters.plants if name in AxisPlantParameters.__dataclass_fields__ else parameters.servos
            assert getattr(owner[axis], name) == section[name][axis]


def test_ros_arrays_are_accepted(section: dict[str, Any]) -> None:
    as_ros = {key: array.array("d", value) if key in AXIS_KEYS else value for key, value in section.items()}
    assert build(RouterSimParameters, as_ros, "test") == build(RouterSimParameters, section, "test")


def test_a_whole_number_is_a_float_too(section: dict[str, Any]) -> None:
    section["screw_pitch_mm"] = [10, 12]
    assert [plant.screw_pitch_mm for plant in build(RouterSimParameters, section, "test").plants] == [10.0, 12.0]


def test_every_quantity_is_documented() -> None:
    for quantity in (*fields(AxisPlantParameters), *fields(ServoParameters)):
        rule = rule_of(quantity)
        assert rule.doc and bool(rule.unit) != quantity.name.endswith("_ratio"), quantity.name


@pytest.mark.parametrize("key", ["substeps", "axis_names", *AXIS_KEYS])
def test_missing_key_is_named(section: dict[str, Any], key: str) -> None:
    del section[key]
    with pytest.raises(ConfigError, match=f"test: {key} is missing: "):
        build(RouterSimParameters, section, "test")


def test_unknown_key_is_named(section: dict[str, Any]) -> None:
    section["stiction_volts"] = [0.1, 0.1]
    with pytest.raises(ConfigError, match="test: unknown key stiction_volts; did you mean "):
        build(RouterSimParameters, section, "test")


@pytest.mark.parametrize("key", AXIS_KEYS)
def test_wrong_length_is_named(section: dict[str, Any], key: str) -> None:
    section[key] = section[key][:1]
    with pytest.raises(ConfigError, match=f"^test: {key} .*2 values, one for each of X, Y"):
        build(RouterSimParameters, section, "test")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), True, "1.0", None, [1.0]])
@pytest.mark.parametrize("key", AXIS_KEYS)
def test_value_that_is_no_finite_number_is_named(section: dict[str, Any], key: str, value: object) -> None:
    section[key] = [section[key][0], value]
    with pytest.raises(ConfigError, match=f"^test: {key} of axis Y "):
        build(RouterSimParameters, section, "test")


SIGNED = {
    "offset_volts",
    "model_offset_volts",
    "error_velocity_gain_s",
    "error_acceleration_gain_s2",
    "error_jerk_gain_s3",
}


@pytest.mark.parametrize("key", [key for key in AXIS_KEYS if key not in SIGNED])
def test_negative_value_is_named(section: dict[str, Any], key: str) -> None:
    section[key] = [section[key][0], -0.5]
    with pytest.raises(ConfigError, match=f"^test: {key} of axis Y is -0.5.*, must be (at least|above) "):
        build(RouterSimParameters, section, "test")


@pytest.mark.parametrize("key", sorted(SIGNED))
def test_signed_quantities_may_be_negative(section: dict[str, Any], key: str) -> None:
    section[key] = [section[key][0], -1.0e-9]
    build(RouterSimParameters, section, "test")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("controller", "pid", "controller is 'pid', must be one of p_pi, adaptive_sliding_mode"),
        ("axis_names", "XY", "axis_names is 'XY', must be a list of names"),
        ("axis_names", ["X", "X"], "must give every name once"),
        ("substeps", 0, "substeps is 0"),
        ("substeps", 10.0, "substeps is 10.0, must be a whole number"),
        ("seed", -1, "seed is -1"),
        ("seed", True, "seed is True, must be a whole number"),
        ("servo_period_s", 0.0, "servo_period_s is 0.0"),
        ("servo_period_s", 1, "servo_period_s is 1.0 s, must be at most 0.01 s"),
        ("mode_inertia_ratio", [0.2, 1.0], "mode_inertia_ratio of axis Y is 1.0, must be below 1"),
        ("static_friction_ratio", [0.9, 1.0], "static_friction_ratio of axis X is 0.9, must be at least 1"),
    ],
)
def test_impossible_value_is_named(section: dict[str, Any], key: str, value: object, message: str) -> None:
    section[key] = value
    with pytest.raises(ConfigError, match=message):
        build(RouterSimParameters, section, "test")


def test_mode_too_fast_for_the_substeps_names_the_substeps_needed(section: dict[str, Any]) -> None:
    section.update(mode_frequency_hz=[60.0, 300.0], mode_inertia_ratio=[0.0, 0.5], substeps=2)
    with pytest.raises(ConfigError, match="mode of axis Y needs at least 9"):
        build(RouterSimParameters, section, "test")
    section["substeps"] = 9
    build(RouterSimParameters, section, "test")
