"""Parameters and files checked against frozen dataclasses: the one place where this is done.

A dataclass says what a section of a file holds. Its fields are declared with :func:`parameter`, which keeps doc, unit
and allowed range beside the type, and :func:`build` fills it from the mapping that YAML gives. The type says how a
field is read:

- ``bool, int, float, str``, an ``Enum``: one value; a whole number counts as a float, true and false never as numbers
- ``tuple[T, ...]``: a list; with ``per_axis`` one entry for each of the ``axis_names`` of the same section
- ``Mapping[str, T]``: a mapping; where T is a dataclass, each value is a section of its own
- ``X | None`` with a dataclass X: the keys of X stand beside the others, as a whole or not at all
- ``tuple[X, ...]`` with a dataclass X: the keys of X stand beside the others, each a list with one entry an axis

The last two keep sections flat, because ROS parameters know lists but no nested records (docs/decisions/0016).
"""

from __future__ import annotations

import math
import operator
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from difflib import get_close_matches
from enum import Enum
from types import NoneType, UnionType
from typing import Any, ClassVar, Protocol, TypeAlias, TypeGuard, TypeVar

from feedopt_core.errors import ConfigError


class DataclassInstance(Protocol):
    """Any dataclass, for the type checker."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


T = TypeVar("T", bound=DataclassInstance)
_DataclassType: TypeAlias = type[DataclassInstance]

_AXIS_NAMES = "axis_names"
_KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


@dataclass(frozen=True)
class Rule:
    """What a field says beside its type.

    Attributes:
        doc: what it is, one sentence.
        unit: its unit, empty for counts, ratios and names.
        at_least, above, at_most, below: bounds of every number in it; None where open.
        choices: the texts allowed; empty: any.
        key: its key in the file; empty: the name of the field.
        per_axis: a list with one entry for each of the axis names.
        names: a list of at least one name; none is empty and none stands there twice.
        entry_name: not a key, but the name of the entry itself in the mapping that holds it.
    """

    doc: str = ""
    unit: str = ""
    at_least: float | None = None
    above: float | None = None
    at_most: float | None = None
    below: float | None = None
    choices: tuple[str, ...] = ()
    key: str = ""
    per_axis: bool = False
    names: bool = False
    entry_name: bool = False

    def violation(self, value: float) -> str:
        """Bound that a number violates, such as ``above 0 mm``; empty where it is allowed."""
        for bound, phrase, holds in (
            (self.at_least, "at least", operator.ge),
            (self.above, "above", operator.gt),
            (self.at_most, "at most", operator.le),
            (self.below, "below", operator.lt),
        ):
            if bound is not None and not holds(value, bound):
                return f"{phrase} {self.with_unit(f'{bound:g}' if isinstance(bound, float) else str(bound))}"
        return ""

    def with_unit(self, number: str) -> str:
        """A number with the unit behind it."""
        return f"{number} {self.unit}" if self.unit else number


def parameter(doc: str, *, default: Any = MISSING, default_factory: Any = MISSING, **rule: Any) -> Any:
    """Field of a dataclass for :func:`build`.

    Args:
        doc: what it is, one sentence.
        default, default_factory: its default; without one it must be given.
        rule: unit, range and the like, see :class:`Rule`.
    """
    return field(default=default, default_factory=default_factory, metadata={"rule": Rule(doc, **rule)})


def rule_of(entry: Field[Any]) -> Rule:
    """Rule of a field; an empty one where it was not declared with :func:`parameter`."""
    rule = entry.metadata.get("rule")
    return rule if isinstance(rule, Rule) else Rule()


def build(cls: type[T], values: Any, source: str) -> T:
    """Fill and check a dataclass.

    Args:
        cls: the dataclass; a ConfigError of its ``__post_init__`` is passed on with the source in front.
        values: the mapping, as YAML or ROS gives it.
        source: file, or whatever else the values come from; stands in front of every message.

    Raises:
        ConfigError: an unknown, missing or impossible value; names source, key, axis or index, what was found, what
            is allowed, and the unit.
    """
    return _section(cls, values, _Place(source))


@dataclass(frozen=True)
class _Place:
    """Where a value stands; ``path`` is dotted, ``axes`` are those of the section."""

    source: str
    path: str = ""
    axis: str = ""
    axes: tuple[str, ...] = ()

    def __str__(self) -> str:
        axis = f" of axis {self.axis}" if self.axis else ""
        return f"{self.source}: {self.path or 'the section'}{axis}"

    def key(self, name: str) -> _Place:
        return replace(self, path=f"{self.path}.{name}" if self.path else name)

    def entry(self, index: int) -> _Place:
        return replace(self, path=f"{self.path}[{index}]")


@dataclass(frozen=True)
class _Key:
    """One key of a section: the field it fills, without the None of an optional one."""

    name: str
    kind: Any
    rule: Rule
    required: bool


def _section(cls: type[T], values: Any, place: _Place, entry_name: str = "") -> T:
    if not isinstance(values, Mapping):
        raise ConfigError(f"{place} is {values!r}, must be a mapping of keys to values")
    known = _known_keys(cls)
    for key in values:
        if key not in known:
            near = get_close_matches(str(key), known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            raise ConfigError(f"{place.source}: unknown key {place.key(str(key)).path}; {hint}")
    return _filled(cls, values, place, entry_name)


def _filled(cls: type[T], values: Mapping[str, Any], place: _Place, entry_name: str = "", beside: str = "") -> T:
    """Fill a dataclass from a mapping that holds keys of others too; ``beside``: key that makes this group needed."""
    keys = _keys(cls)
    _refuse_missing([key for key in keys.values() if key.required and not _group_of(key.kind)], values, place, beside)
    if _AXIS_NAMES in keys and _AXIS_NAMES in values:
        place = replace(place, axes=_list(values[_AXIS_NAMES], str, keys[_AXIS_NAMES].rule, place.key(_AXIS_NAMES)))
    filled: dict[str, Any] = {}
    for name, key in keys.items():
        group = _group_of(key.kind)
        if key.rule.entry_name:
            filled[name] = entry_name
        elif group and typing.get_origin(key.kind) is tuple:
            filled[name] = _axis_group(group, values, place)
        elif group:
            given = [inner for inner in _known_keys(group) if inner in values]
            filled[name] = _filled(group, values, place, beside=given[0]) if given else None
        elif key.name in values:
            filled[name] = _value(values[key.name], key.kind, key.rule, place.key(key.name))
    try:
        return cls(**filled)
    except ConfigError as error:
        raise ConfigError(f"{place if place.path else place.source}: {error}") from error


def _axis_group(cls: _DataclassType, values: Mapping[str, Any], place: _Place) -> tuple[Any, ...]:
    """One dataclass for each axis, from keys that hold one entry an axis."""
    keys = _keys(cls)
    _refuse_missing(list(keys.values()), values, place)
    columns = {
        name: _list(values[key.name], key.kind, replace(key.rule, per_axis=True), place.key(key.name))
        for name, key in keys.items()
    }
    return tuple(cls(**{name: column[i] for name, column in columns.items()}) for i in range(len(place.axes)))


def _refuse_missing(required: list[_Key], values: Mapping[str, Any], place: _Place, beside: str = "") -> None:
    missing = [key for key in required if key.name not in values]
    if not missing:
        return
    names = ", ".join(place.key(key.name).path for key in missing)
    verb, doc = ("is", missing[0].rule.doc) if len(missing) == 1 else ("are", "")
    unit = f" [{missing[0].rule.unit}]" if doc and missing[0].rule.unit else ""
    reason = f", to go with {beside}" if beside else ""
    raise ConfigError(f"{place.source}: {names} {verb} missing{reason}{f': {doc}{unit}' if doc else ''}")


def _value(value: Any, kind: Any, rule: Rule, place: _Place) -> Any:
    origin = typing.get_origin(kind)
    if origin is tuple:
        return _list(value, typing.get_args(kind)[0], rule, place)
    if origin is Mapping:
        if not isinstance(value, Mapping):
            raise ConfigError(f"{place} is {value!r}, must be a mapping of names to values")
        inner = typing.get_args(kind)[1]
        named = [(str(name), entry, place.key(str(name))) for name, entry in value.items()]
        if _is_dataclass_type(inner):
            return {name: _section(inner, entry, where, name) for name, entry, where in named}
        return {name: _value(entry, inner, rule, where) for name, entry, where in named}
    if issubclass(kind, Enum):
        return kind(_scalar(value, str, replace(rule, choices=tuple(member.value for member in kind)), place))
    return _scalar(value, kind, rule, place)


def _list(value: Any, element: Any, rule: Rule, place: _Place) -> tuple[Any, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        wanted = _axes_wanted(place.axes) if rule.per_axis else f"must be a list{' of names' if rule.names else ''}"
        raise ConfigError(f"{place} is {value!r}, {wanted}")
    inner = replace(rule, per_axis=False, names=False)
    if rule.per_axis:
        if len(value) != len(place.axes):
            raise ConfigError(f"{place} is {list(value)!r}, {_axes_wanted(place.axes)}")
        places = [replace(place, axis=axis) for axis in place.axes]
    else:
        places = [place.entry(i) for i in range(len(value))]
    if rule.names and (not value or not all(isinstance(name, str) and name for name in value)):
        raise ConfigError(f"{place} is {list(value)!r}, must be a list of names")
    if rule.names and len(set(value)) != len(value):
        raise ConfigError(f"{place} is {list(value)!r}, must give every name once")
    return tuple(_value(item, element, inner, where) for item, where in zip(value, places, strict=True))


def _axes_wanted(axes: tuple[str, ...]) -> str:
    return f"needs {len(axes)} {'value' if len(axes) == 1 else 'values'}, one for each of {', '.join(axes)}"


def _scalar(value: Any, kind: type[Any], rule: Rule, place: _Place) -> Any:
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        try:
            value = float(value)
        except OverflowError:
            value = math.inf
    if rule.choices and value not in rule.choices:
        raise ConfigError(f"{place} is {value!r}, must be one of {', '.join(rule.choices)}")
    # To Python a bool is a whole number; in a file it is a mistake.
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        hint = " (YAML reads 1e-3 as text: write 1.0e-3)" if kind is float and isinstance(value, str) else ""
        raise ConfigError(f"{place} is {value!r}, must be {_KINDS[kind]}{hint}")
    if kind is float and not math.isfinite(value):
        raise ConfigError(f"{place} is {value!r}, must be finite")
    if kind in (int, float) and (violation := rule.violation(value)):
        raise ConfigError(f"{place} is {rule.with_unit(repr(value))}, must be {violation}")
    return value


def _keys(cls: _DataclassType) -> dict[str, _Key]:
    """Keys of a dataclass by the name of the field each fills."""
    types = typing.get_type_hints(cls)
    found = {}
    for entry in fields(cls):
        kind, rule = types[entry.name], rule_of(entry)
        optional = entry.default is not MISSING or entry.default_factory is not MISSING or rule.entry_name
        if typing.get_origin(kind) in (UnionType, typing.Union):
            kind = next(choice for choice in typing.get_args(kind) if choice is not NoneType)
        found[entry.name] = _Key(rule.key or entry.name, kind, rule, not optional)
    return found


def _group_of(kind: Any) -> _DataclassType | None:
    """Dataclass whose keys stand beside the others: that of a field, or of one entry an axis."""
    inner = typing.get_args(kind)[0] if typing.get_origin(kind) is tuple else kind
    return inner if _is_dataclass_type(inner) else None


def _is_dataclass_type(kind: Any) -> TypeGuard[_DataclassType]:
    return isinstance(kind, type) and is_dataclass(kind)


def _known_keys(cls: _DataclassType) -> list[str]:
    """Every key that may stand in the section of a dataclass, those of its groups included."""
    known: list[str] = []
    for key in _keys(cls).values():
        group = _group_of(key.kind)
        if group:
            known += _known_keys(group)
        elif not key.rule.entry_name:
            known.append(key.name)
    return known
