"""Verdict on a recorded run, from the bag alone: limits, punctuality, tracking, completeness."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.setpoints import audit_setpoints
from feedopt_core.errors import ConfigError
from feedopt_core.motion.certificate import AuditReport
from feedopt_recorder.bags.check_bag import Finding, check_run
from feedopt_recorder.bags.run_data import RunData
from feedopt_recorder.run_folder import SUMMARY_NAME
from feedopt_tools.views.signals.signals import Quantity, signals_of


@dataclass(frozen=True)
class Punctuality:
    """Lateness of the set points, s; ``late_ticks`` by a period or more; ``missing_ticks`` are not recorded."""

    ticks: int
    p50_s: float
    p99_s: float
    late_ticks: int
    missing_ticks: int


@dataclass(frozen=True)
class TrackingRow:
    """Tracking error of one axis, um: predicted by the machine's model, and simulated; NaN: not known.

    ``limit_um`` is infinite where the machine file gives none.
    """

    axis: str
    limit_um: float
    predicted_max_um: float
    predicted_rms_um: float
    simulated_max_um: float
    simulated_rms_um: float

    @property
    def over(self) -> bool:
        """The drive exceeded the limit."""
        return self.simulated_max_um > self.limit_um


@dataclass(frozen=True)
class Judgement:
    """Verdict on one run.

    Attributes:
        motion_time_s: from the first to the last moving set point.
        audit: worst ratios of the recorded set points, by finite differences.
        findings: what is missing in the bag.
        recorded_messages: of all topics.
        recorder_cpu_ratio: of one core.
    """

    motion_time_s: float
    audit: AuditReport
    findings: tuple[Finding, ...]
    punctuality: Punctuality
    tracking: tuple[TrackingRow, ...]
    recorded_messages: int
    recorder_cpu_ratio: float

    @property
    def holds(self) -> bool:
        """Every limit holds and nothing is missing."""
        return self.audit.holds and not self.findings and self.punctuality.missing_ticks == 0


def judge_run(run: RunData) -> Judgement:
    """Judge a recorded run.

    Raises:
        ConfigError: the bag holds no machine, so there are no limits to judge by.
    """
    if run.machine is None:
        raise ConfigError(
            f"{run.path}: holds no /machine message, so its limits are unknown and the run cannot be judged"
        )
    setpoints = run.setpoints
    audit = audit_setpoints(
        setpoints.position_mm, setpoints.s_mm, setpoints.period_s, run.machine, t_start_s=float(setpoints.t_s[0])
    )
    lateness = setpoints.lateness_s
    p50_s, p99_s = np.percentile(lateness, [50, 99])
    span = int(setpoints.tick[-1] - setpoints.tick[0]) + 1
    messages, cpu_ratio = _recorder_figures(run.path)
    return Judgement(
        motion_time_s=run.motion_time_s,
        audit=audit,
        findings=check_run(run),
        punctuality=Punctuality(
            len(setpoints),
            float(p50_s),
            float(p99_s),
            int(np.sum(lateness >= setpoints.period_s)),
            span - len(setpoints),
        ),
        tracking=_tracking(run),
        recorded_messages=messages,
        recorder_cpu_ratio=cpu_ratio,
    )


def _tracking(run: RunData) -> tuple[TrackingRow, ...]:
    error: Quantity = signals_of(run).quantities["tracking_error"]
    rows = []
    for axis, name in enumerate(run.axis_names):
        predicted, simulated = _extremes(error.commanded, axis), _extremes(error.measured, axis)
        rows.append(TrackingRow(name, error.limit_of(axis), *predicted, *simulated))
    return tuple(rows)


def _extremes(values: FloatArray | None, axis: int) -> tuple[float, float]:
    """Largest absolute value and root mean square of one axis; NaN without values."""
    if values is None or not len(values):
        return float("nan"), float("nan")
    column = values[:, axis]
    return float(np.max(np.abs(column))), float(np.sqrt(np.mean(column**2)))


def _recorder_figures(bag: Path) -> tuple[int, float]:
    folder = bag if bag.is_dir() else bag.parent
    try:
        document = json.loads((folder / SUMMARY_NAME).read_text(encoding="utf-8"))
        messages = sum(int(topic["messages"]) for topic in document["topics"].values())
        return messages, float(document["cpu_share_ratio"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{folder / SUMMARY_NAME}: cannot be read: {error}") from error
