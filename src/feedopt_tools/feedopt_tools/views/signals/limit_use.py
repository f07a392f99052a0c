"""Utilisation of each limit along the path, and which limit binds where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_tools.views.signals.signals import RunSignals

NEAR_RATIO = 0.95
"""A limit binds from this utilisation on. A sampled jerk stays a little below its limit."""
NONE = -1
_QUANTITY_NAMES = {
    "velocity": "velocity",
    "acceleration": "acceleration",
    "jerk": "jerk",
    "control_signal": "control signal",
    "tracking_error": "tracking error",
}


@dataclass(frozen=True)
class Limit:
    """One limit of the run.

    Attributes:
        key: ``feedrate``, ``velocity``, ``acceleration``, ``jerk``, ``control_signal`` or ``tracking_error``.
        axis: place of the axis in the machine file; None for the feedrate along the path.
        label: such as ``X jerk``.
    """

    key: str
    axis: int | None
    label: str


@dataclass(frozen=True)
class LimitUse:
    """Use of every limit at the set points.

    Attributes:
        limits: all limits of the run, k of them.
        ratio: planned value over limit, shape (n, k).
        closest_ratio: the largest ratio, shape (n,); 0 without any limit.
        active: index of the limit that binds, shape (n,); :data:`NONE` where all are below :data:`NEAR_RATIO`.
    """

    limits: tuple[Limit, ...]
    ratio: FloatArray
    closest_ratio: FloatArray
    active: IntArray

    def stretches(self) -> list[tuple[int, int, int]]:
        """Stretches of one binding limit: first row, last row, index of the limit."""
        edges = np.flatnonzero(np.diff(self.active)) + 1
        firsts = np.concatenate([[0], edges]).tolist()
        lasts = np.concatenate([edges - 1, [len(self.active) - 1]]).tolist()
        return [(first, last, int(self.active[first])) for first, last in zip(firsts, lasts, strict=True)]

    def shares(self, weight: FloatArray) -> list[tuple[str, float]]:
        """Share of a weight, such as path length, on which each limit binds; largest first, ``none`` last.

        Args:
            weight: of each set point, shape (n,), not negative.
        """
        total = float(np.sum(weight))
        if total <= 0.0:
            return []
        parts = [(limit.label, float(np.sum(weight[self.active == k])) / total) for k, limit in enumerate(self.limits)]
        parts.sort(key=lambda part: -part[1])
        return [*parts, ("none", float(np.sum(weight[self.active == NONE])) / total)]


def limit_use_of(signals: RunSignals) -> LimitUse:
    """Utilisation of the limits by the plan: kinematics of the set points, and the machine's drive models."""
    limits, columns = list[Limit](), list[FloatArray]()
    feed_limit = feed_limit_of(signals)
    if feed_limit is not None:
        limits.append(Limit("feedrate", None, "feedrate"))
        columns.append(signals.feedrate_mm_s / feed_limit)
    for key, name in _QUANTITY_NAMES.items():
        quantity = signals.quantities[key]
        if quantity.commanded is None or quantity.planned_limit is None:
            continue
        for axis, limit in enumerate(quantity.planned_limit):
            if np.isfinite(limit) and limit > 0.0:
                limits.append(Limit(key, axis, f"{signals.run.axis_names[axis]} {name}"))
                columns.append(np.abs(quantity.commanded[:, axis]) / limit)
    count = len(signals.t_s)
    ratio = np.stack(columns, axis=1) if columns else np.zeros((count, 0))
    closest: FloatArray = np.max(ratio, axis=1, initial=0.0)
    active: IntArray = np.full(count, NONE, dtype=np.int64)
    if columns:
        near: NDArray[np.bool_] = closest >= NEAR_RATIO
        active[near] = np.argmax(ratio[near], axis=1)
    return LimitUse(tuple(limits), ratio, closest, active)


def feed_limit_of(signals: RunSignals) -> FloatArray | None:
    """Lower of programmed and machine feed limit at the set points, mm/s; None if neither is known."""
    machine = signals.feed_limit_mm_s if np.isfinite(signals.feed_limit_mm_s) else np.inf
    programmed = np.full(len(signals.t_s), np.inf) if signals.programmed_mm_s is None else signals.programmed_mm_s
    limit = np.minimum(programmed, machine)
    return limit if np.all(np.isfinite(limit)) else None if not np.any(np.isfinite(limit)) else limit


def path_weight_mm(signals: RunSignals) -> FloatArray:
    """Path length represented by each set point, shape (n,), mm."""
    return np.asarray(np.gradient(signals.s_mm)) if len(signals.s_mm) > 1 else np.zeros(len(signals.s_mm))
