"""What the schema accepts, and what it says of everything else: source, key, index or axis, value, range and unit."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from feedopt_core.errors import ConfigError
from feedopt_core.schema import build, parameter


class Colour(Enum):
    """One of a few."""

    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Spring:
    """Given as a whole or not at all."""

    stiffness_n_mm: tuple[float, ...] = parameter("Stiffness.", unit="N/mm", per_axis=True, above=0.0)
    travel_mm: tuple[float, ...] = parameter("Travel.", unit="mm", per_axis=True)


@dataclass(frozen=True)
class Motor:
    """One an axis."""

    torque_nm: float = parameter("Torque.", unit="Nm", at_least=0.0, below=5.0)
    poles: int = parameter("Poles.", at_least=2)


@dataclass(frozen=True)
class Part:
    """One of several by name."""

    name: str = parameter("Name.", entry_name=True)
    mass_kg: float = parameter("Mass.", unit="kg", above=0.0)
    colour: Colour = parameter("Colour.", default=Colour.RED)


@dataclass(frozen=True)
class Thing:
    """A section with a field of every kind."""

    axis_names: tuple[str, ...] = parameter("Names of the axes.", names=True)
    motors: tuple[Motor, ...] = parameter("Motor of each axis.")
    spring: Spring | None = parameter("Springs.", default=None)
    length_mm: float = parameter("Length.", default=1.0, unit="mm", at_least=-2.0, at_most=8.0)
    matrix: tuple[tuple[float, ...], ...] | None = parameter("Rows.", default=None, per_axis=True)
    active: bool = parameter("Whether it works.", default=True, key="on")
    tags: tuple[str, ...] = parameter("Tags.", default=())
    parts: Mapping[str, Part] = parameter("Parts by name.", default_factory=dict)
    weights: Mapping[str, float] = parameter("Weights.", default_factory=dict, at_least=0.0)

    def __post_init__(self) -> None:
        if len(self.tags) > 2:
            raise ConfigError("more than two tags")


LEAST: dict[str, Any] = {"axis_names": ["A", "B"], "torque_nm": [1.0, 2], "poles": [2, 4]}


def test_the_least_that_must_be_given() -> None:
    assert build(Thing, LEAST, "f") == Thing(("A", "B"), (Motor(1.0, 2), Motor(2.0, 4)))


def test_everything_that_can_be_given() -> None:
    values = LEAST | {
        "stiffness_n_mm": [1, 2.5],
        "travel_mm": [-1.0, 0.0],
        "length_mm": 8,
        "matrix": [[1, 0], [0.5, 1.0, 2.0]],
        "on": False,
        "tags": ["t"],
        "parts": {"p": {"mass_kg": 3, "colour": "blue"}, "q": {"mass_kg": 0.5}},
        "weights": {"w": 0},
    }
    thing = build(Thing, values, "f")
    assert thing.spring == Spring((1.0, 2.5), (-1.0, 0.0))
    assert thing.matrix == ((1.0, 0.0), (0.5, 1.0, 2.0))
    assert thing.parts == {"p": Part("p", 3.0, Colour.BLUE), "q": Part("q", 0.5)}
    assert (thing.length_mm, thing.active, thing.tags, thing.weights) == (8.0, False, ("t",), {"w": 0.0})
    assert isinstance(thing.length_mm, float) and isinstance(thing.weights["w"], float)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length_m": 1.0}, "f: unknown key length_m; did you mean length_mm?"),
        ({"parts": {"p": {"mass_kg": 1.0, "color": "red"}}}, "f: unknown key parts.p.color; did you mean colour?"),
        ({"parts": {"p": {"mass_kg": 1.0, 7: 0}}}, "f: unknown key parts.p.7; known are mass_kg, colour"),
        ({"parts": {"p": {"mass_kg": 1.0, "name": "p"}}}, "f: unknown key parts.p.name; known are mass_kg, colour"),
        ({"parts": {"p": {}}}, "f: parts.p.mass_kg is missing: Mass. [kg]"),
        ({"parts": {"p": None}}, "f: parts.p is None, must be a mapping of keys to values"),
        ({"parts": ["p"]}, "f: parts is ['p'], must be a mapping of names to values"),
        ({"parts": {"p": {"mass_kg": 0.0}}}, "f: parts.p.mass_kg is 0.0 kg, must be above 0 kg"),
        (
            {"parts": {"p": {"mass_kg": 1.0, "colour": "green"}}},
            "f: parts.p.colour is 'green', must be one of red, blue",
        ),
        ({"stiffness_n_mm": [1.0, 1.0]}, "f: travel_mm is missing, to go with stiffness_n_mm: Travel. [mm]"),
        ({"length_mm": 8.5}, "f: length_mm is 8.5 mm, must be at most 8 mm"),
        ({"length_mm": -3}, "f: length_mm is -3.0 mm, must be at least -2 mm"),
        ({"length_mm": True}, "f: length_mm is True, must be a number"),
        ({"length_mm": float("nan")}, "f: length_mm is nan, must be finite"),
        ({"length_mm": 10**400}, "f: length_mm is inf, must be finite"),
        ({"length_mm": "1e-3"}, "f: length_mm is '1e-3', must be a number (YAML reads 1e-3 as text: write 1.0e-3)"),
        ({"length_mm": None}, "f: length_mm is None, must be a number"),
        ({"on": 1}, "f: on is 1, must be true or false"),
        ({"poles": [2, 4.0]}, "f: poles of axis B is 4.0, must be a whole number"),
        ({"poles": [2, True]}, "f: poles of axis B is True, must be a whole number"),
        ({"poles": [1, 4]}, "f: poles of axis A is 1, must be at least 2"),
        ({"torque_nm": [5.0, 1.0]}, "f: torque_nm of axis A is 5.0 Nm, must be below 5 Nm"),
        ({"torque_nm": [1.0]}, "f: torque_nm is [1.0], needs 2 values, one for each of A, B"),
        ({"torque_nm": 1.0}, "f: torque_nm is 1.0, needs 2 values, one for each of A, B"),
        ({"matrix": [[1.0], [1.0, "x"]]}, "f: matrix[1] of axis B is 'x', must be a number"),
        ({"matrix": [[1.0], 1.0]}, "f: matrix of axis B is 1.0, must be a list"),
        ({"tags": "t"}, "f: tags is 't', must be a list"),
        ({"tags": ["t", 3]}, "f: tags[1] is 3, must be text"),
        ({"tags": ["a", "b", "c"]}, "f: more than two tags"),
        ({"weights": {"w": -1.0}}, "f: weights.w is -1.0, must be at least 0"),
        ({"axis_names": []}, "f: axis_names is [], must be a list of names"),
        ({"axis_names": ["A", ""]}, "f: axis_names is ['A', ''], must be a list of names"),
        ({"axis_names": ["A", "A"]}, "f: axis_names is ['A', 'A'], must give every name once"),
    ],
)
def test_what_is_wrong_is_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        build(Thing, LEAST | change, "f")
    assert str(caught.value).startswith(message)


def test_missing_keys_are_named_together() -> None:
    with pytest.raises(ConfigError, match=r"^f: torque_nm, poles are missing$"):
        build(Thing, {"axis_names": ["A"]}, "f")
    with pytest.raises(ConfigError, match=r"^f: axis_names is missing: Names of the axes\.$"):
        build(Thing, {key: LEAST[key] for key in ("torque_nm", "poles")}, "f")


@pytest.mark.parametrize("values", [None, [1], "text", 3])
def test_a_section_must_be_a_mapping(values: object) -> None:
    with pytest.raises(ConfigError, match=r"^f: the section is .*, must be a mapping"):
        build(Thing, values, "f")


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
KEYS = st.sampled_from([*LEAST, "stiffness_n_mm", "travel_mm", "length_mm", "matrix", "on", "tags", "parts", "weights"])


@given(st.dictionaries(KEYS, anything, max_size=4))
def test_whatever_stands_in_a_file_is_taken_or_refused(change: dict[str, Any]) -> None:
    # No other error gets through.
    with suppress(ConfigError):
        thing = build(Thing, LEAST | change, "f")
        assert len(thing.motors) == len(thing.axis_names)
