"""Results of an audit: for each axis and quantity the largest ratio to its limit; and the certificate of a chunk."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass

from feedopt_core.machine.machine_file import Machine

ALLOWED_RATIO = 1.001
"""Largest ratio that passes. The optimisation keeps a margin below 1; the part above 1 covers rounding errors."""


@dataclass(frozen=True)
class AuditRow:
    """Worst case of one quantity on one axis.

    Attributes:
        grid: ``fine`` (analytic, finer than the optimisation's mesh) or ``set points`` (their finite differences).
        axis: name of the axis; empty for the feedrate along the path.
        quantity: feedrate, velocity, acceleration, jerk, control or tracking_error.
        value: largest absolute value found, in the unit of the limit.
        limit: the limit.
        ratio: value / limit (for the feedrate: the largest ratio, as the programmed limit changes along the path).
        s_mm, t_s: arc length and time of the value.
    """

    grid: str
    axis: str
    quantity: str
    value: float
    limit: float
    ratio: float
    s_mm: float
    t_s: float


@dataclass(frozen=True)
class AuditReport:
    """Rows of one or both grids."""

    rows: tuple[AuditRow, ...]

    @property
    def worst(self) -> AuditRow:
        """Row with the largest ratio."""
        return max(self.rows, key=_severity)

    @property
    def holds(self) -> bool:
        """Whether every ratio is at most :data:`ALLOWED_RATIO`."""
        return all(row.ratio <= ALLOWED_RATIO for row in self.rows)

    def as_list(self) -> list[dict[str, str | float]]:
        """Rows as plain dictionaries, for JSON."""
        return [asdict(row) for row in self.rows]


def merge(reports: Iterable[AuditReport]) -> AuditReport:
    """The worst row of each grid, axis and quantity over several reports, in order of first appearance."""
    worst: dict[tuple[str, str, str], AuditRow] = {}
    for report in reports:
        for row in report.rows:
            key = (row.grid, row.axis, row.quantity)
            if key not in worst or _severity(row) > _severity(worst[key]):
                worst[key] = row
    return AuditReport(tuple(worst.values()))


@dataclass(frozen=True)
class Certificate:
    """Largest values that the audit found over committed part and stop, for each axis in the order of the machine file.

    The values of a quantity are empty where the machine file gives no limit for it.
    """

    max_velocity_mm_s: tuple[float, ...]
    max_acceleration_mm_s2: tuple[float, ...]
    max_jerk_mm_s3: tuple[float, ...]
    max_control_volts: tuple[float, ...]
    max_tracking_error_mm: tuple[float, ...]
    worst_ratio: float
    worst_quantity: str
    worst_axis: str
    worst_s_mm: float

    @classmethod
    def of(cls, report: AuditReport, machine: Machine) -> Certificate:
        """Certificate from an audit report of the fine grid."""
        found: dict[tuple[str, str], AuditRow] = {(row.quantity, row.axis): row for row in report.rows}

        def extremes(quantity: str) -> tuple[float, ...]:
            return tuple(found[quantity, axis].value for axis in machine.axis_names if (quantity, axis) in found)

        worst = report.worst
        return cls(
            max_velocity_mm_s=extremes("velocity"),
            max_acceleration_mm_s2=extremes("acceleration"),
            max_jerk_mm_s3=extremes("jerk"),
            max_control_volts=extremes("control"),
            max_tracking_error_mm=extremes("tracking_error"),
            worst_ratio=worst.ratio,
            worst_quantity=worst.quantity,
            worst_axis=worst.axis,
            worst_s_mm=worst.s_mm,
        )


def _severity(row: AuditRow) -> float:
    """Sort key of a row: its ratio, and infinity for NaN, which no comparison would report otherwise."""
    return math.inf if math.isnan(row.ratio) else row.ratio
