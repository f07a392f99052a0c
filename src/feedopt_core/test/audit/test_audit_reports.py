"""The audit finds what breaks a limit, where it does, on both grids; NaN never passes."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from core_motion import PERIOD_S, PlannedPath, difference_ratios, plan_path
from core_paths import drive_machine, kinematic_machine, spline

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.audit.setpoints import audit_setpoints
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.certificate import ALLOWED_RATIO, AuditReport, AuditRow, merge
from feedopt_core.pipeline.plan_program import Setpoints

MACHINE = drive_machine()
LIMIT_OF = {
    "velocity": "velocity_limit_mm_s",
    "acceleration": "acceleration_limit_mm_s2",
    "jerk": "jerk_limit_mm_s3",
    "control": "control_limit_volts",
    "tracking_error": "tracking_error_limit_mm",
}
WAVE = [(7.0 * k, 6.0 * np.sin(0.8 * k)) for k in range(9)]


@pytest.fixture(scope="module")
def planned() -> PlannedPath:
    return plan_path(MACHINE, spline(WAVE))


@pytest.fixture(scope="module")
def setpoints(planned: PlannedPath) -> Setpoints:
    return planned.setpoints()


def row_of(report: AuditReport, quantity: str, axis: str) -> AuditRow:
    return next(row for row in report.rows if (row.quantity, row.axis) == (quantity, axis))


def sampled(setpoints: Setpoints, machine: Machine = MACHINE, position_mm: FloatArray | None = None) -> AuditReport:
    positions = setpoints.position_mm if position_mm is None else position_mm
    return audit_setpoints(positions, setpoints.s_mm, PERIOD_S, machine)


def with_limit(quantity: str, axis: int, limit: float) -> Machine:
    """The machine with one limit of one axis changed."""
    limits = list(getattr(MACHINE, LIMIT_OF[quantity]))
    limits[axis] = limit
    change: dict[str, Any] = {LIMIT_OF[quantity]: tuple(limits)}
    return replace(MACHINE, **change)


def test_sound_plan_passes_on_both_grids(planned: PlannedPath, setpoints: Setpoints) -> None:
    fine, grid = planned.fine_audit(), sampled(setpoints)
    for report in (fine, grid):
        assert report.holds
        assert report.worst.ratio > 0.9
    axes = {
        (quantity, axis)
        for quantity in ("velocity", "acceleration", "jerk", "control", "tracking_error")
        for axis in "XY"
    }
    assert {(row.quantity, row.axis) for row in fine.rows} == axes | {("feedrate", "")}
    assert {(row.quantity, row.axis) for row in grid.rows} == axes
    assert {row.grid for row in fine.rows} == {"fine"}
    assert {row.grid for row in grid.rows} == {"set points"}


def test_fine_grid_sees_what_the_set_points_see(planned: PlannedPath, setpoints: Setpoints) -> None:
    """Differences are averages of the derivatives, so they never exceed them, and come close."""
    for row in sampled(setpoints).rows:
        fine = row_of(planned.fine_audit(), row.quantity, row.axis)
        assert row.value <= fine.value * 1.001
        assert row.value >= fine.value * (0.8 if row.quantity in ("jerk", "tracking_error") else 0.97)


def test_differences_agree_with_an_independent_check(setpoints: Setpoints) -> None:
    report = sampled(setpoints)
    for quantity, ratio in difference_ratios(setpoints.position_mm, MACHINE).items():
        found = max(row_of(report, quantity, axis).ratio for axis in "XY")
        assert found == pytest.approx(ratio, rel=1e-9)


def test_drive_rows_are_the_models_of_the_differences(setpoints: Setpoints) -> None:
    report = sampled(setpoints)
    x, h = setpoints.position_mm, PERIOD_S
    velocity = (x[2:] - x[:-2]) / (2.0 * h)
    acceleration = (x[2:] - 2.0 * x[1:-1] + x[:-2]) / h**2
    jerk = np.gradient(acceleration, h, axis=0)
    drive, tracking = MACHINE.drive, MACHINE.tracking
    assert drive is not None and tracking is not None
    for axis, name in enumerate("XY"):
        v, a, j = velocity[:, axis], acceleration[:, axis], jerk[:, axis]
        control = (
            drive.inertia_volts_s2_mm[axis] * a
            + drive.viscous_volts_s_mm[axis] * v
            + drive.offset_volts[axis]
            + drive.coulomb_volts[axis] * np.sign(v)
        )
        error = tracking.tracking_kv_s[axis] * v + tracking.tracking_ka_s2[axis] * a + tracking.tracking_kj_s3[axis] * j
        assert row_of(report, "control", name).value == pytest.approx(np.max(np.abs(control)), rel=1e-6)
        assert row_of(report, "tracking_error", name).value == pytest.approx(np.max(np.abs(error)), rel=1e-2)


@pytest.mark.parametrize("quantity", LIMIT_OF)
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("grid", ["fine", "set points"])
def test_exceeded_limit_is_found_by_quantity_and_axis(
    planned: PlannedPath, setpoints: Setpoints, quantity: str, axis: int, grid: str
) -> None:
    """The same motion under a limit 1 % below what it takes."""

    def audited(machine: Machine) -> AuditReport:
        if grid == "fine":
            return audit_profile(planned.toolpath, planned.chunks[0].profile, machine)
        return sampled(setpoints, machine)

    name = "XY"[axis]
    taken = row_of(audited(MACHINE), quantity, name).value
    report = audited(with_limit(quantity, axis, taken / 1.01))
    assert not report.holds
    assert (report.worst.grid, report.worst.quantity, report.worst.axis) == (grid, quantity, name)
    assert report.worst.ratio == pytest.approx(1.01, rel=1e-9)
    assert audited(with_limit(quantity, axis, taken / (ALLOWED_RATIO - 1e-6))).holds


def test_exceeded_feed_is_found(planned: PlannedPath) -> None:
    profile = planned.chunks[0].profile
    report = audit_profile(planned.toolpath, profile, replace(MACHINE, feed_limit_mm_s=40.0))
    worst = row_of(report, "feedrate", "")
    assert not report.holds
    assert worst.ratio == pytest.approx(np.sqrt(np.max(profile.q_mm2_s2)) / 40.0, rel=1e-3)
    assert worst.limit == 40.0


@pytest.mark.parametrize("at_s", [0.08, 0.3, 0.61])
@pytest.mark.parametrize("axis", [0, 1])
def test_shaken_set_point_is_found_where_it_is(setpoints: Setpoints, at_s: float, axis: int) -> None:
    """A single set point off by 1 um."""
    index = round(at_s / PERIOD_S)
    shaken = setpoints.position_mm.copy()
    shaken[index, axis] += 1e-3
    report = sampled(setpoints, position_mm=shaken)
    assert not report.holds
    jerk = row_of(report, "jerk", "XY"[axis])
    # 3 um over a period cubed, more or less what the motion itself takes there.
    assert jerk.value == pytest.approx(3e-3 / PERIOD_S**3, rel=0.1)
    assert jerk.t_s == pytest.approx(at_s, abs=2.1 * PERIOD_S)
    assert jerk.s_mm == pytest.approx(setpoints.s_mm[index], abs=0.5)
    other = row_of(report, "jerk", "YX"[axis])
    assert other.ratio <= ALLOWED_RATIO


def test_jump_at_the_very_start_or_end_is_found(setpoints: Setpoints) -> None:
    """A motion that does not start at standstill: the standstill before it is part of the audit."""
    for part in (slice(30, None), slice(None, -30)):
        report = audit_setpoints(setpoints.position_mm[part], setpoints.s_mm[part], PERIOD_S, MACHINE)
        assert not report.holds
        assert report.worst.ratio > 2.0


@pytest.mark.parametrize("part", [0.02, 0.4, 0.9])
def test_bump_in_one_element_is_found_there(planned: PlannedPath, part: float) -> None:
    """Fine grid: one element whose q bends more than the limits allow."""
    profile = planned.chunks[0].profile
    element = 1 + int(part * (len(profile.kind) - 2))
    bend = profile.d2q_ds2_per_s2.copy()
    bend[element] += 4.0 * np.max(np.abs(bend))
    report = audit_profile(planned.toolpath, replace(profile, d2q_ds2_per_s2=bend), MACHINE)
    assert not report.holds
    worst = max(row_of(report, "jerk", axis).ratio for axis in "XY")
    assert worst > ALLOWED_RATIO
    place = next(row.s_mm for row in report.rows if row.quantity == "jerk" and row.ratio == worst)
    assert profile.s_mm[element] <= place <= profile.s_mm[element + 1]


def test_times_of_a_later_chunk_count_from_the_start_of_the_program(planned: PlannedPath) -> None:
    profile = planned.chunks[0].profile
    now = audit_profile(planned.toolpath, profile, MACHINE)
    later = audit_profile(planned.toolpath, profile, MACHINE, t_start_s=10.0)
    for first, second in zip(now.rows, later.rows, strict=True):
        assert second.t_s == pytest.approx(first.t_s + 10.0, abs=1e-9)
        assert second.ratio == first.ratio
        assert 0.0 <= first.t_s <= profile.duration_s


def test_set_points_that_are_not_numbers_never_pass(setpoints: Setpoints) -> None:
    for index in (0, 200, len(setpoints.s_mm) - 1):
        spoiled = setpoints.position_mm.copy()
        spoiled[index, 1] = np.nan
        assert not sampled(setpoints, position_mm=spoiled).holds


def row(ratio: float, axis: str = "X", quantity: str = "jerk", grid: str = "fine") -> AuditRow:
    return AuditRow(grid, axis, quantity, ratio, 1.0, ratio, 0.0, 0.0)


def test_report_with_a_ratio_that_is_not_a_number_does_not_hold() -> None:
    for rows in ((row(np.nan),), (row(0.5), row(np.nan, "Y")), (row(np.nan), row(0.5, "Y"))):
        assert not AuditReport(rows).holds


def test_worst_row_is_the_one_that_is_not_a_number() -> None:
    for rows in ((row(0.5), row(np.nan, "Y")), (row(np.nan), row(0.5, "Y"))):
        assert np.isnan(AuditReport(rows).worst.ratio)


def test_merging_keeps_the_worst_of_each_row() -> None:
    first = AuditReport((row(0.5), row(0.9, "Y"), row(0.4, grid="set points")))
    second = AuditReport((row(0.7), row(0.8, "Y"), row(0.3, quantity="velocity")))
    merged = merge([first, second])
    assert [(found.axis, found.quantity, found.grid, found.ratio) for found in merged.rows] == [
        ("X", "jerk", "fine", 0.7),
        ("Y", "jerk", "fine", 0.9),
        ("X", "jerk", "set points", 0.4),
        ("X", "velocity", "fine", 0.3),
    ]


def test_merging_never_loses_a_ratio_that_is_not_a_number() -> None:
    for ratios in permutations([0.5, np.nan, 0.6]):
        assert not merge(AuditReport((row(ratio),)) for ratio in ratios).holds


def test_rows_as_plain_data() -> None:
    report = AuditReport((row(0.5), row(0.4, grid="set points")))
    assert report.as_list()[0] == {
        "grid": "fine",
        "axis": "X",
        "quantity": "jerk",
        "value": 0.5,
        "limit": 1.0,
        "ratio": 0.5,
        "s_mm": 0.0,
        "t_s": 0.0,
    }


def test_machine_without_models_has_no_rows_of_them() -> None:
    machine = kinematic_machine()
    report = plan_path(machine, spline(WAVE)).fine_audit()
    assert {found.quantity for found in report.rows} == {"feedrate", "velocity", "acceleration", "jerk"}
