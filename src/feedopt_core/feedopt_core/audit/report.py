"""What an audit finds: for each axis and quantity the worst ratio to its limit, and where."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass

ALLOWED_RATIO = 1.001
"""Largest ratio that passes. The optimisation keeps a margin below 1; this is room for rounding in differences."""


@dataclass(frozen=True)
class AuditRow:
    """Worst case of one quantity on one axis.

    Attributes:
        grid: ``fine`` (analytic, finer than the optimisation's mesh) or ``1 kHz`` (finite differences of set points).
        axis: name of the axis; empty for the feedrate along the path.
        quantity: feedrate, velocity, acceleration, jerk, control or tracking_error.
        value: largest size found, in the unit of the limit.
        limit: the limit.
        ratio: value / limit (for the feedrate: the largest ratio, as the programmed limit changes along the path).
        s_mm, t_s: where and when.
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
        """Every ratio is at most :data:`ALLOWED_RATIO`."""
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


def _severity(row: AuditRow) -> float:
    """Order of badness; a ratio that is not a number is the worst of all and must never be lost in a comparison."""
    return math.inf if math.isnan(row.ratio) else row.ratio
