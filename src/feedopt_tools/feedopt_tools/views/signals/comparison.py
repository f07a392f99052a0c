"""Compares two runs: the curves of both over time and over arc length, and their difference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_recorder.run_folder import BAG_NAME
from feedopt_tools.errors import ViewError
from feedopt_tools.views.signals.limit_use import path_weight_mm
from feedopt_tools.views.signals.scene import RunScene
from feedopt_tools.views.signals.signals import RunSignals

_LEAST_STEP_MM = 1e-6
_LENGTHS_AGREE = 1e-3
_LEAST_SHARE = 0.01
_AXIS_KEYS = ("tracking_error", "control_signal", "velocity", "acceleration", "jerk")


@dataclass(frozen=True)
class Overlay:
    """Values of both runs at common times or arc lengths, shape (n,) each; NaN after the end of a run."""

    at: FloatArray
    first: FloatArray
    second: FloatArray

    @property
    def difference(self) -> FloatArray:
        """Values of the second run minus those of the first."""
        return self.second - self.first


@dataclass(frozen=True)
class ComparedCurve:
    """One curve of both runs.

    Attributes:
        key: such as ``feed`` or ``tracking_error/X``.
        title: with its unit.
        over_time: at common motion times, s.
        over_path: at common arc lengths, mm.
        limit: of the first run; infinity without one.
    """

    key: str
    title: str
    over_time: Overlay
    over_path: Overlay
    limit: float


@dataclass(frozen=True)
class Comparison:
    """Two runs.

    Attributes:
        first, second: the runs.
        names: of the runs; always different.
        curves: the curves that both runs have.
        reached_s: time at which each arc length is reached; the difference is the time lost by the second run.
        remark: warning if the paths differ in length; otherwise empty.
    """

    first: RunScene
    second: RunScene
    names: tuple[str, str]
    curves: tuple[ComparedCurve, ...]
    reached_s: Overlay
    remark: str


def compare(first: RunScene, second: RunScene) -> Comparison:
    """Compare two runs.

    Raises:
        ViewError: a run holds no motion.
    """
    for scene in (first, second):
        if scene.signals.s_mm[-1] - scene.signals.s_mm[0] <= _LEAST_STEP_MM:
            raise ViewError(f"{scene.signals.run.path}: the run holds no motion, so there is nothing to compare")
    common = _Common(first.signals, second.signals)
    ones = [common.curve("feed", "feedrate, mm/s", (first.signals.feedrate_mm_s, second.signals.feedrate_mm_s))]
    if first.limit_use.limits and second.limit_use.limits:
        uses = (100.0 * first.limit_use.closest_ratio, 100.0 * second.limit_use.closest_ratio)
        ones.append(common.curve("use", "closest limit, %", uses, 100.0))
    ones += _axis_curves(common, first.signals, second.signals)
    lengths = [float(scene.signals.s_mm[-1]) for scene in (first, second)]
    remark = ""
    if abs(lengths[0] - lengths[1]) > _LENGTHS_AGREE * max(lengths):
        remark = f"the paths are {lengths[0]:.2f} and {lengths[1]:.2f} mm long: one arc length is not one place"
    times = (first.signals.t_s, second.signals.t_s)
    return Comparison(first, second, _names(first, second), tuple(ones), common.over_path(times), remark)


def comparison_markdown(comparison: Comparison) -> str:
    """Figures of both runs in one table."""
    rows = zip(_figures(comparison.first), _figures(comparison.second), strict=True)
    lines = [f"| | {comparison.names[0]} | {comparison.names[1]} |", "|---|---|---|"]
    lines += [f"| {name} | {one} | {other} |" for (name, one), (_, other) in rows]
    gain_s = comparison.first.signals.run.motion_time_s - comparison.second.signals.run.motion_time_s
    part = gain_s / max(comparison.first.signals.run.motion_time_s, 1e-9)
    word = "faster" if gain_s >= 0.0 else "slower"
    lines += ["", f"- the second is {abs(gain_s):.3f} s ({abs(100.0 * part):.2f} %) {word}"]
    for name, scene in zip(comparison.names, (comparison.first, comparison.second), strict=True):
        shares = [part for part in scene.limit_use.shares(path_weight_mm(scene.signals)) if part[1] >= _LEAST_SHARE]
        lines.append(f"- {name} is held by {', '.join(f'{label} {100.0 * part:.0f} %' for label, part in shares)}")
    if comparison.remark:
        lines.append(f"- {comparison.remark}")
    return "\n".join(lines)


class _Common:
    """Common times and arc lengths of two runs."""

    def __init__(self, first: RunSignals, second: RunSignals) -> None:
        self.pair = (first, second)
        start_s, end_s = min(first.t_s[0], second.t_s[0]), max(first.t_s[-1], second.t_s[-1])
        period_s = first.run.setpoints.period_s
        self.t_s = period_s * np.arange(round(start_s / period_s), round(end_s / period_s) + 1)
        # Where the machine waits, its arc length counts once: at arrival.
        self.rows = tuple(np.concatenate([[True], np.diff(one.s_mm) > _LEAST_STEP_MM]) for one in self.pair)
        s_mm = first.s_mm[self.rows[0]]
        self.s_mm = s_mm[s_mm <= second.s_mm[-1]]

    def curve(
        self, key: str, title: str, values: tuple[FloatArray, FloatArray], limit: float = float("inf")
    ) -> ComparedCurve:
        """Curve of values at the set points of each run."""
        rows = [
            np.interp(self.t_s, one.t_s, row, left=np.nan, right=np.nan)
            for one, row in zip(self.pair, values, strict=True)
        ]
        return ComparedCurve(key, title, Overlay(self.t_s, rows[0], rows[1]), self.over_path(values), limit)

    def over_path(self, values: tuple[FloatArray, FloatArray]) -> Overlay:
        """Values at the set points of each run, by arc length."""
        rows = [
            np.interp(self.s_mm, one.s_mm[keep], row[keep])
            for one, row, keep in zip(self.pair, values, self.rows, strict=True)
        ]
        return Overlay(self.s_mm, rows[0], rows[1])


def _axis_curves(common: _Common, first: RunSignals, second: RunSignals) -> list[ComparedCurve]:
    """Curves of the axes that both runs have: measured values if both have them, otherwise commanded ones."""
    curves = list[ComparedCurve]()
    for key in _AXIS_KEYS:
        one, other = first.quantities[key], second.quantities[key]
        for axis, name in enumerate(first.run.axis_names):
            if name not in second.run.axis_names:
                continue
            there = second.run.axis_names.index(name)
            values = _both(first, second, (one.measured, other.measured), (axis, there), at_states=True)
            values = values or _both(first, second, (one.commanded, other.commanded), (axis, there), at_states=False)
            if values is not None:
                curves.append(common.curve(f"{key}/{name}", f"{name}: {one.title}", values, one.limit_of(axis)))
    return curves


def _both(
    first: RunSignals,
    second: RunSignals,
    values: tuple[FloatArray | None, FloatArray | None],
    axes: tuple[int, int],
    *,
    at_states: bool,
) -> tuple[FloatArray, FloatArray] | None:
    one, other = values
    if one is None or other is None:
        return None
    rows = one[:, axes[0]], other[:, axes[1]]
    if not at_states:
        return rows
    return np.interp(first.t_s, first.state_t_s, rows[0]), np.interp(second.t_s, second.state_t_s, rows[1])


def _names(first: RunScene, second: RunScene) -> tuple[str, str]:
    """Names that differ: titles, else planning methods, else folders, else "first" and "second"."""
    runs = first.signals.run, second.signals.run
    folders = [run.path.parent.name if run.path.name == BAG_NAME else run.path.name for run in runs]
    methods = [run.chunks[0].figures.method if run.chunks else "" for run in runs]
    for names in ([run.title for run in runs], methods, folders):
        if names[0] != names[1] and all(names):
            return names[0], names[1]
    return "first", "second"


def _figures(scene: RunScene) -> list[tuple[str, str]]:
    signals, run = scene.signals, scene.signals.run
    rows = [
        ("machine", run.machine.name if run.machine else "unknown"),
        ("motion time", f"{run.motion_time_s:.3f} s"),
        ("path length", f"{signals.s_mm[-1]:.2f} mm"),
        ("largest feedrate", f"{signals.top_feed_mm_s:.1f} mm/s"),
    ]
    for key in ("tracking_error", "control_signal"):
        quantity = signals.quantities[key]
        name, unit = quantity.title.split(", ")
        values = quantity.measured if quantity.measured is not None else quantity.commanded
        peak = "unknown" if values is None else f"{float(np.max(np.abs(values))):.2f} {unit}"
        rows.append((f"peak {name}", peak))
    error = "unknown" if scene.contour is None else f"{float(np.max(np.abs(scene.contour.error_um))):.2f} µm"
    rows += [
        ("largest contour error", error),
        ("plan", f"{run.chunks[0].figures.method}, {len(run.chunks)} windows" if run.chunks else "unknown"),
    ]
    return rows
