"""A published piece of the feed profile: what is committed, the stop behind it, its certificate and its cost."""

from __future__ import annotations

from dataclasses import dataclass

from feedopt_core.audit.report import AuditReport, AuditRow
from feedopt_core.config.machine import Machine
from feedopt_core.feedrate.profile import FeedProfile


@dataclass(frozen=True)
class Certificate:
    """Extremes that the audit found over committed part and stop; per axis, in the order of the machine file.

    The extremes of a quantity are empty where the machine file gives no limit of it.
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
        """Extremes of a fine-grid report."""
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


@dataclass(frozen=True)
class SolverFigures:
    """What the plan of one window took; ``solver`` is the one that found it.

    ``fallback``: the window had no plan, so the chunk ends in a stop that the path does not ask for: the stop of the
    chunk before, or from rest the end of a shorter window.
    """

    method: str
    solver: str
    variables: int
    rows: int
    iterations: int
    solve_time_s: float
    audit_time_s: float
    fallback: bool


@dataclass(frozen=True)
class Chunk:
    """Committed part and stop of one window; the fields are those of the message.

    ``profile`` runs from ``s_start_mm`` to ``s_stop_mm``, ``s_commit_mm`` is one of its element ends.
    ``dwell_s`` is the time to wait there, at rest, before the next chunk starts.
    """

    sequence: int
    last_segment_sequence: int
    last: bool
    s_start_mm: float
    s_commit_mm: float
    s_stop_mm: float
    t_start_s: float
    t_commit_s: float
    dwell_s: float
    profile: FeedProfile
    certificate: Certificate
    figures: SolverFigures
