"""Compares recorded with replayed messages: count, order and every field, within stated tolerances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from feedopt_tools.replay.columns import Columns

IGNORED = ("stamp", "lateness_s", "solve_time_s", "audit_time_s")
"""Fields that depend on the clock only. A field named stamp is ignored at any depth of a message."""
DEFAULT_RATIO = 1e-9
# A measured rounding error is not reproducible: it may be up to twice as large, or vanish.
_ROUNDING = {"/toolpath.map_error_mm": 1.0}
_PLACES = ("tick", "source_line", "s_start_mm", "s_mm")


@dataclass(frozen=True)
class Tolerances:
    """How far numbers may differ, relative to the largest value of their field in the recording.

    Attributes:
        ratios: by ``/topic`` or ``/topic.field``; the longer name wins. Whole numbers, texts and flags must agree
            unless their very field is named.
    """

    ratios: Mapping[str, float] = field(default_factory=dict)

    def ratio(self, topic: str, name: str, *, whole: bool) -> float:
        """Tolerance of one field."""
        full = f"{topic}.{name}"
        own = self.ratios.get(full, _ROUNDING.get(full))
        if own is not None or whole:
            return own or 0.0
        return self.ratios.get(topic, DEFAULT_RATIO)


@dataclass(frozen=True)
class Difference:
    """One value that differs from the recorded one.

    Attributes:
        index: message, from 0; ``element`` of its array, from 0, or -1.
        tolerance_ratio: difference divided by its tolerance; infinity where no tolerance applies.
        place: where on the path and in the program.
    """

    topic: str
    field: str
    index: int
    element: int
    recorded: str
    replayed: str
    tolerance_ratio: float
    place: str


@dataclass(frozen=True)
class TopicComparison:
    """One topic of one bag.

    Attributes:
        recorded, replayed: numbers of messages.
        differences: the first of each field and the largest of each field, in order of messages.
        differing: number of values that differ, by field.
        unrecorded: fields that the bag does not have; they were not compared.
    """

    topic: str
    recorded: int
    replayed: int
    differences: tuple[Difference, ...]
    differing: Mapping[str, int]
    unrecorded: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """No message is missing and every field agrees."""
        return self.recorded == self.replayed and not self.differing

    @property
    def largest(self) -> Difference | None:
        """The difference with the largest ratio to its tolerance."""
        return max(self.differences, key=lambda difference: difference.tolerance_ratio, default=None)


def compare_topic(
    topic: str, recorded: Columns, replayed: Columns, tolerances: Tolerances, *, ignored: tuple[str, ...] = IGNORED
) -> TopicComparison:
    """Compare the messages of one topic one by one, in order.

    Args:
        topic: its name.
        recorded, replayed: the messages.
        tolerances: allowed differences.
        ignored: fields that are not compared.
    """
    found: list[Difference] = []
    differing: dict[str, int] = {}
    names = [name for name in replayed.values if not _is_ignored(name, ignored)]
    for name in names:
        if name not in recorded.values:
            continue
        differences = list(_differences(topic, name, recorded, replayed, tolerances))
        if differences:
            differing[name] = len(differences)
            largest = max(differences, key=lambda difference: difference.tolerance_ratio)
            found += [differences[0]] if largest is differences[0] else [differences[0], largest]
    # Without recorded messages no field can be missing in the recording.
    unrecorded = tuple(name for name in names if recorded.count and name not in recorded.values)
    found.sort(key=lambda difference: difference.index)
    return TopicComparison(topic, recorded.count, replayed.count, tuple(found), differing, unrecorded)


def _is_ignored(name: str, ignored: tuple[str, ...]) -> bool:
    return any(part.removesuffix("[]") in ignored for part in name.split("."))


def _differences(
    topic: str, name: str, recorded: Columns, replayed: Columns, tolerances: Tolerances
) -> Iterator[Difference]:
    count = min(recorded.count, replayed.count)
    was, now = recorded.values[name][:count], replayed.values[name][:count]
    scale = _scale(was)
    for index in _suspects(was, now):
        a, b = np.atleast_1d(np.asarray(was[index])), np.atleast_1d(np.asarray(now[index]))
        place = _place(recorded, index)
        if a.shape != b.shape:
            texts = f"{a.size} values", f"{b.size} values"
            yield Difference(topic, name, index, -1, *texts, float("inf"), place)
            continue
        ratios = _tolerance_ratios(a, b, tolerances, topic, name, scale)
        if not np.any(ratios > 1.0):
            continue
        element = int(np.argmax(ratios))
        shown = element if np.ndim(was[index]) else -1
        yield Difference(
            topic,
            name,
            index,
            shown,
            str(a[element]),
            str(b[element]),
            float(ratios[element]),
            _place(recorded, index, shown),
        )


def _suspects(was: list[Any], now: list[Any]) -> Iterator[int]:
    """Indices of messages whose value is not exactly the recorded one. Values of one shape are compared at once."""
    try:
        a, b = np.asarray(was), np.asarray(now)
    except ValueError:
        a = b = np.empty(0, dtype=object)
    if a.dtype != object and a.shape == b.shape and len(a) == len(was):
        unequal = a != b
        yield from np.flatnonzero(unequal.reshape(len(a), -1).any(axis=1)).tolist()
        return
    for index, (x, y) in enumerate(zip(was, now, strict=True)):
        if np.shape(x) != np.shape(y) or np.any(np.asarray(x) != np.asarray(y)):
            yield index


def _scale(values: list[Any]) -> float:
    """Largest finite absolute value of a field; 0 if it holds no numbers."""
    largest = 0.0
    for value in values:
        numbers = np.asarray(value)
        if numbers.dtype.kind in "fiu" and numbers.size:
            finite = np.abs(numbers[np.isfinite(numbers)].astype(np.float64))
            largest = max(largest, float(np.max(finite, initial=0.0)))
    return largest


def _tolerance_ratios(a: Any, b: Any, tolerances: Tolerances, topic: str, name: str, scale: float) -> Any:
    """Difference divided by its tolerance, element by element; infinity where the values must be equal."""
    if a.dtype.kind not in "fiu" or b.dtype.kind not in "fiu":
        return np.where(a == b, 0.0, np.inf)
    whole = a.dtype.kind in "iu"
    allowed = tolerances.ratio(topic, name, whole=whole) * scale
    x, y = a.astype(np.float64), b.astype(np.float64)
    same = (x == y) | (np.isnan(x) & np.isnan(y))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.abs(x - y) / allowed
    return np.where(same, 0.0, np.where(np.isnan(ratios), np.inf, ratios))


def _place(columns: Columns, index: int, element: int = -1) -> str:
    parts = [f"message {columns.find('sequence', index) or index + 1}"]
    for name in _PLACES:
        value = columns.find(name, index)
        if value is None:
            continue
        if np.ndim(value) == 0:
            parts.append(f"{name} {value:.6g}" if isinstance(value, float) else f"{name} {value}")
        elif 0 <= element < len(value):
            parts.append(f"{name} {value[element]:.6g} there")
    return ", ".join(parts)
