"""Machine files: what is refused, by key and axis, and what loads."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from feedopt_core.config_files import config_directory, find_config
from feedopt_core.errors import ConfigError
from feedopt_core.machine.machine_file import load_machine, machine_path, parse_machine

SHIPPED = ("case_a", "case_b", "hbot", "router_experiment", "router_heng", "router_simulation")
DRIVE_KEYS = ("inertia_volts_s2_mm", "viscous_volts_s_mm", "offset_volts", "coulomb_volts")
TRACKING_KEYS = ("tracking_kv_s", "tracking_ka_s2", "tracking_kj_s3")
MODEL_KEYS = (*DRIVE_KEYS, *TRACKING_KEYS)
DRIVE_LIMITS = ("control_limit_volts", "tracking_error_limit_mm")
LIMITS = ("velocity_limit_mm_s", "acceleration_limit_mm_s2", "jerk_limit_mm_s3")


def section(**changes: Any) -> dict[str, Any]:
    """Keys of a good machine of two axes with a drive model; a change to None removes a key."""
    keys: dict[str, Any] = {
        "name": "bench",
        "axis_names": ["X", "Y"],
        "coordinate": ["x", "y"],
        "feed_limit_mm_s": 150.0,
    }
    keys |= {key: [100.0, 200.0] for key in (*LIMITS, *DRIVE_LIMITS)}
    keys |= {key: [0.1, 0.2] for key in MODEL_KEYS}
    keys |= changes
    return {key: value for key, value in keys.items() if value is not None}


def text(keys: dict[str, Any]) -> str:
    return yaml.safe_dump({"/**": {"ros__parameters": {"machine": keys}}})


def refusal(keys: dict[str, Any]) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_machine(text(keys), "bench.yaml")
    return str(caught.value)


@pytest.fixture
def fresh_location() -> Iterator[None]:
    """The configuration folder is looked up anew in the test, and again after it."""
    config_directory.cache_clear()
    yield
    config_directory.cache_clear()


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_machine_loads_and_round_trips(name: str) -> None:
    machine = load_machine(name)
    assert machine.name == name
    assert machine.yaml_text == machine_path(name).read_text(encoding="utf-8")
    assert parse_machine(machine.yaml_text, "again") == machine


def test_every_shipped_machine_is_tested() -> None:
    assert sorted(path.stem for path in (config_directory() / "machines").glob("*.yaml")) == sorted(SHIPPED)


def test_machine_loads_by_path_from_anywhere(tmp_path: Path) -> None:
    path = tmp_path / "elsewhere.yaml"
    path.write_text(text(section()), encoding="utf-8")
    assert load_machine(str(path)).axis_names == ("X", "Y")


def test_values_arrive_with_their_axis() -> None:
    machine = parse_machine(text(section(offset_volts=[-0.5, 0.0])), "bench.yaml")
    assert machine.velocity_limit_mm_s == (100.0, 200.0)
    assert machine.drive is not None
    assert machine.drive.offset_volts == (-0.5, 0.0)
    assert machine.control_limit_volts == (100.0, 200.0)


def test_tracking_coefficients_may_have_either_sign() -> None:
    machine = parse_machine(text(section(tracking_kj_s3=[-1.0e-8, 0.0])), "bench.yaml")
    assert machine.tracking is not None
    assert machine.tracking.tracking_kj_s3 == (-1.0e-8, 0.0)


def test_machine_without_models_has_none_of_them() -> None:
    machine = parse_machine(text(section(**dict.fromkeys((*MODEL_KEYS, *DRIVE_LIMITS)))), "bench.yaml")
    assert machine.drive is None
    assert machine.control_limit_volts is None
    assert machine.tracking is None
    assert machine.tracking_error_limit_mm is None


def test_reserve_of_the_tracking_error_leaves_something_to_the_plan() -> None:
    machine = parse_machine(text(section(tracking_error_reserve_mm=[25.0, 0.0])), "bench.yaml")
    assert machine.planned_tracking_error_mm == (75.0, 200.0)
    assert "of axis Y is 200 mm, which leaves nothing" in refusal(section(tracking_error_reserve_mm=[25.0, 200.0]))
    assert "of axis X is -1.0 mm, must be at least 0 mm" in refusal(section(tracking_error_reserve_mm=[-1.0, 0.0]))


def test_each_model_may_stand_alone() -> None:
    drive_only = parse_machine(
        text(section(**dict.fromkeys((*TRACKING_KEYS, "tracking_error_limit_mm")))), "bench.yaml"
    )
    assert drive_only.drive is not None
    assert drive_only.tracking is None
    tracking_only = parse_machine(text(section(**dict.fromkeys((*DRIVE_KEYS, "control_limit_volts")))), "bench.yaml")
    assert tracking_only.tracking is not None
    assert tracking_only.drive is None


def test_gantry_repeats_the_row_of_its_coordinate() -> None:
    machine = load_machine("router_heng")
    assert machine.axis_names == ("Xr", "Xl", "Y", "Z")
    assert machine.dimensions == 3
    assert np.array_equal(machine.axis_matrix(), [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


@pytest.mark.parametrize("key", ["name", "axis_names", "feed_limit_mm_s"])
def test_missing_key_is_named(key: str) -> None:
    assert refusal(section(**{key: None})).startswith(f"bench.yaml: {key} is missing: ")


@pytest.mark.parametrize("key", [*MODEL_KEYS, *DRIVE_LIMITS])
def test_model_is_complete_or_absent(key: str) -> None:
    assert f"{key} is missing, to go with " in refusal(section(**{key: None}))


def test_unknown_key_is_named() -> None:
    message = refusal(section(acceleration_limit_mm_s=[1.0, 1.0]))
    assert message == "bench.yaml: unknown key acceleration_limit_mm_s; did you mean acceleration_limit_mm_s2?"


@pytest.mark.parametrize("key", [*LIMITS, *DRIVE_LIMITS])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_limit_must_be_above_zero(key: str, value: float) -> None:
    assert re.search(rf"{key} of axis Y is {value} \S+, must be above 0 ", refusal(section(**{key: [1.0, value]})))


@pytest.mark.parametrize("key", [key for key in DRIVE_KEYS if key != "offset_volts"])
def test_drive_coefficient_must_not_be_negative(key: str) -> None:
    assert re.search(rf"{key} of axis X is -0.1 \S+, must be at least 0 V", refusal(section(**{key: [-0.1, 0.2]})))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("key", [*LIMITS, *DRIVE_LIMITS, *MODEL_KEYS])
def test_value_must_be_finite(key: str, value: float) -> None:
    assert f"{key} of axis Y is {value!r}, must be finite" in refusal(section(**{key: [1.0, value]}))


@pytest.mark.parametrize("value", ["1e-3", "fast", True, None, [1.0]])
@pytest.mark.parametrize("key", [*LIMITS, *DRIVE_LIMITS, *MODEL_KEYS])
def test_value_must_be_a_number(key: str, value: object) -> None:
    assert f"{key} of axis X is {value!r}, must be a number" in refusal(section(**{key: [value, 1.0]}))


@pytest.mark.parametrize("value", [[1.0], [1.0, 2.0, 3.0], 1.0, "1.0, 2.0", []])
@pytest.mark.parametrize("key", [*LIMITS, "offset_volts", "control_limit_volts"])
def test_row_needs_one_value_an_axis(key: str, value: object) -> None:
    assert f"{key} is {value!r}, needs 2 values, one for each of X, Y" in refusal(section(**{key: value}))


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        (0, "is 0.0 mm/s, must be above 0 mm/s"),
        (-1.5, "must be above 0 mm/s"),
        (float("nan"), "must be finite"),
        ("150", "must be a number"),
        (True, "must be a number"),
        ([150.0], "must be a number"),
    ],
)
def test_feed_limit_must_be_a_positive_number(value: object, complaint: str) -> None:
    message = refusal(section(feed_limit_mm_s=value))
    assert "feed_limit_mm_s is " in message
    assert complaint in message


@pytest.mark.parametrize("value", [[], "XY", [1, 2], ["X", ""], {"X": 1}])
def test_axis_names_must_be_names(value: object) -> None:
    assert f"axis_names is {value!r}, must be a list of names" in refusal(section(axis_names=value))


def test_axis_name_twice_is_refused() -> None:
    assert "axis_names is ['X', 'X'], must give every name once" in refusal(section(axis_names=["X", "X"]))


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        (["x", "a"], "coordinate of axis Y is 'a', must be one of x, y, z"),
        ([True, "y"], "coordinate of axis X is True, must be one of x, y, z"),
        (["x"], "needs 2 values, one for each of X, Y"),
        ("xy", "needs 2 values, one for each of X, Y"),
        (["x", "x"], "no axis follows coordinate y"),
        (["x", "z"], "no axis follows coordinate y"),
        (["y", "z"], "no axis follows coordinate x"),
    ],
)
def test_impossible_coordinate_is_named(value: object, complaint: str) -> None:
    assert complaint in refusal(section(coordinate=value))


@pytest.mark.parametrize(
    "document", ["", "[]", "7", "machine: {}", "/**: {ros__parameters: {}}", "/**: [1]", "just text"]
)
def test_file_without_the_section_is_refused(document: str) -> None:
    with pytest.raises(ConfigError, match=r"bench\.yaml: has no section"):
        parse_machine(document, "bench.yaml")


@pytest.mark.parametrize("content", ["null", "[1, 2]", "text"])
def test_section_must_be_a_mapping(content: str) -> None:
    with pytest.raises(ConfigError, match=r"the section is .*, must be a mapping"):
        parse_machine(f"/**: {{ros__parameters: {{machine: {content}}}}}", "bench.yaml")


def test_text_that_is_not_yaml_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"bench\.yaml: not valid YAML"):
        parse_machine("a: [1, 2\nb: }", "bench.yaml")


def test_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "binary.yaml"
    path.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ConfigError, match=r"binary\.yaml: cannot be read"):
        load_machine(str(path))


@pytest.mark.parametrize("name", ["no_such_machine", "", "../graph", "case_a/", "machines/case_a"])
def test_unknown_machine_lists_the_known_ones(name: str) -> None:
    with pytest.raises(ConfigError, match="neither a file nor one of the names in machines: case_a, case_b"):
        load_machine(name)


def test_name_longer_than_any_file_name_is_unknown() -> None:
    with pytest.raises(ConfigError, match=r"File name too long|neither a file nor one of the names"):
        load_machine("a" * 300)


def test_integer_beyond_all_floats_is_refused() -> None:
    assert "feed_limit_mm_s is" in refusal(section(feed_limit_mm_s=10**400))


def test_configuration_of_an_installed_workspace_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh_location: None
) -> None:
    share = tmp_path / "prefix" / "share" / "feedopt_config"
    (share / "machines").mkdir(parents=True)
    (share / "graph.yaml").write_text("{}", encoding="utf-8")
    (share / "machines" / "mine.yaml").write_text(text(section()), encoding="utf-8")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'other'}:{tmp_path / 'prefix'}")
    assert config_directory() == share
    assert find_config("machines", "mine") == share / "machines" / "mine.yaml"


def test_configuration_of_the_source_tree_needs_no_installation(
    monkeypatch: pytest.MonkeyPatch, fresh_location: None
) -> None:
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert (config_directory() / "machines" / "case_a.yaml").is_file()
