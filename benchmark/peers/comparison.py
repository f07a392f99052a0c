"""The comparison: cases, planners, measurement, table and document.

Every motion is sampled at 1 kHz with the planner's own time law, evaluated on the exact path and audited twice: by
feedopt_core.audit, and by finite_differences.py, which shares no code with it. If a planner violates a limit, the table
shows the ratio to the limit. The benchmark reports figures, without pass or fail.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import math
import os
import platform
import statistics
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TypeVar

from benchmark.peers.feedopt_peer import plan_one_shot, plan_windowed
from benchmark.peers.finite_differences import ChordSpline, worst_differences
from benchmark.peers.motion import PERIOD_S, PeerError, PeerMotion
from rich.table import Table

from feedopt_core.audit.setpoints import audit_setpoints
from feedopt_core.config_files import find_config
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine, load_machine
from feedopt_core.motion.certificate import ALLOWED_RATIO
from feedopt_core.pipeline.read_program import open_program, read_program
from feedopt_core.planner.stream_planner import PlannerParameters

PROGRAM = "fan_contour"
QUANTITIES = ("velocity", "acceleration", "jerk")
PEERS = {"toppra": "toppra", "copp_py": "copp-py"}
_TOPPRA_SPACINGS_MM = (1.0, 0.25, 0.1)
_COPP_SPACINGS_MM = (1.0, 0.25, 0.1)
_COPP_GRADED_SPACINGS_MM = (0.25, 0.1)
_Setting = TypeVar("_Setting")


CASES = ("case_a", "case_b")
"""Machines by name: only limits of the axes are active, no limit of the feedrate along the path."""


@dataclass(frozen=True)
class PeerRow:
    """One planner with one setting on one case.

    Attributes:
        failure: message of the planner if it found no motion; the figures are then missing.
        motion_time_s: planned time from standstill to standstill.
        time_within_limits_s: the same motion, slowed down as a whole until no ratio exceeds the audit's allowance.
        compute_time_s: median of the runs.
        compute_times_s: time of each run.
        audit: axis to quantity to worst ratio, feedopt_core.audit.
        check: the same by finite_differences.py.
    """

    case: str
    planner: str
    setting: str
    failure: str = ""
    motion_time_s: float | None = None
    time_within_limits_s: float | None = None
    compute_time_s: float | None = None
    compute_times_s: list[float] = field(default_factory=list)
    audit: dict[str, dict[str, float]] = field(default_factory=dict)
    check: dict[str, dict[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Contender:
    planner: str
    setting: str
    plan: Callable[[Toolpath, Machine], PeerMotion]


def missing_peers() -> list[str]:
    """Names on PyPI of the peers that are not installed; requirements/bench.txt pins them."""
    return [package for module, package in PEERS.items() if importlib.util.find_spec(module) is None]


def run_peers(runs: int, report: Callable[[PeerRow], None] = lambda row: None) -> list[PeerRow]:
    """Measure every planner on every case.

    Args:
        runs: runs of each planner and setting; the compute time is their median.
        report: called with each finished row.
    """
    program = find_config("programs", PROGRAM, ".csv")
    path = ChordSpline(program)
    rows = []
    with _one_core():
        for case in CASES:
            machine = load_machine(case)
            toolpath = Toolpath()
            for segment in read_program(open_program(program), str(program), machine.dimensions):
                toolpath.append(segment)
            for contender in _contenders(program):
                row = _measure(case, contender, toolpath, machine, path, runs)
                rows.append(row)
                report(row)
    return rows


def _contenders(program: Path) -> Iterator[_Contender]:
    spacing = f"{PlannerParameters().knot_spacing_mm:g} mm"
    yield _Contender("feedopt lp", f"windowed, {spacing}", lambda _, machine: plan_windowed(program, machine))
    yield _Contender("feedopt lp", f"one shot, {spacing}", plan_one_shot)
    missing = missing_peers()
    if "copp-py" not in missing:
        yield from _copp_contenders()
    if "toppra" not in missing:
        from benchmark.peers import toppra_peer

        for spacing_mm in _TOPPRA_SPACINGS_MM:
            yield _Contender("TOPP-RA, no jerk", f"even {spacing_mm:g} mm", _bind(toppra_peer.plan, spacing_mm))


def _copp_contenders() -> Iterator[_Contender]:
    from benchmark.peers.copp_peer import CoppSetting, Stations, plan

    for stations, spacings_mm in ((Stations.EVEN, _COPP_SPACINGS_MM), (Stations.GRADED, _COPP_GRADED_SPACINGS_MM)):
        for spacing_mm in spacings_mm:
            for solver in ("lp", "socp"):
                setting = CoppSetting(solver, stations, spacing_mm)
                yield _Contender(f"COPP TOPP3 {solver}", f"{stations.value} {spacing_mm:g} mm", _bind(plan, setting))


def _bind(
    plan: Callable[[Toolpath, Machine, _Setting], PeerMotion], setting: _Setting
) -> Callable[[Toolpath, Machine], PeerMotion]:
    return lambda toolpath, machine: plan(toolpath, machine, setting)


def _measure(
    case: str, contender: _Contender, toolpath: Toolpath, machine: Machine, path: ChordSpline, runs: int
) -> PeerRow:
    try:
        motions = [contender.plan(toolpath, machine) for _ in range(runs)]
    except PeerError as error:
        return PeerRow(case, contender.planner, contender.setting, failure=str(error))
    motion = motions[0]
    audit, check = _audited(motion, toolpath, machine), _checked(motion, path, machine)
    times_s = [each.compute_time_s for each in motions]
    return PeerRow(
        case,
        contender.planner,
        contender.setting,
        motion_time_s=motion.motion_time_s,
        time_within_limits_s=motion.motion_time_s * slowing(audit),
        compute_time_s=statistics.median(times_s),
        compute_times_s=times_s,
        audit=audit,
        check=check,
    )


def _audited(motion: PeerMotion, toolpath: Toolpath, machine: Machine) -> dict[str, dict[str, float]]:
    position_mm = toolpath.evaluate(motion.s_mm).r_mm @ machine.axis_matrix().T
    report = audit_setpoints(position_mm, motion.s_mm, PERIOD_S, machine)
    ratios: dict[str, dict[str, float]] = {name: {} for name in machine.axis_names}
    for row in report.rows:
        if row.quantity in QUANTITIES:
            ratios[row.axis][row.quantity] = row.ratio
    return ratios


def _checked(motion: PeerMotion, path: ChordSpline, machine: Machine) -> dict[str, dict[str, float]]:
    worst = worst_differences(path.position_mm(motion.s_mm) @ machine.axis_matrix().T, PERIOD_S)
    limits = {
        "velocity": machine.velocity_limit_mm_s,
        "acceleration": machine.acceleration_limit_mm_s2,
        "jerk": machine.jerk_limit_mm_s3,
    }
    return {
        axis: {quantity: float(worst[quantity][i]) / limits[quantity][i] for quantity in QUANTITIES}
        for i, axis in enumerate(machine.axis_names)
    }


def slowing(ratios: dict[str, dict[str, float]]) -> float:
    """Factor k on time that brings every ratio within the allowance; it divides the n-th derivative by k^n."""
    factor = 1.0
    for axis in ratios.values():
        for order, quantity in enumerate(QUANTITIES, start=1):
            factor = max(factor, math.pow(axis[quantity] / ALLOWED_RATIO, 1.0 / order))
    return factor


@contextmanager
def _one_core() -> Iterator[None]:
    """Limit this process to one core, independent of the threads of its libraries."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def table_of(rows: list[PeerRow]) -> Table:
    """The rows as a table; violations are marked."""
    axes = load_machine(CASES[0]).axis_names
    table = Table(title=f"{PROGRAM}: worst ratios to the limits at 1 kHz (above {ALLOWED_RATIO:g} in red)")
    for heading in ("case", "planner", "setting"):
        table.add_column(heading)
    for heading in ("motion s", "within limits s", "compute s"):
        table.add_column(heading, justify="right")
    for quantity in QUANTITIES:
        for axis in axes:
            table.add_column(f"{quantity[0]} {axis}", justify="right")
    table.add_column("2nd check", justify="right")
    previous = ""
    for row in rows:
        if previous and row.case != previous:
            table.add_section()
        table.add_row("" if row.case == previous else row.case, row.planner, row.setting, *_cells(row, axes))
        previous = row.case
    return table


def _cells(row: PeerRow, axes: tuple[str, ...]) -> list[str]:
    if row.motion_time_s is None or row.time_within_limits_s is None or row.compute_time_s is None:
        return ["failed"]
    cells = [f"{row.motion_time_s:.4f}", f"{row.time_within_limits_s:.4f}", f"{row.compute_time_s:.3f}"]
    for quantity in QUANTITIES:
        cells += [_ratio_cell(row.audit[axis][quantity]) for axis in axes]
    cells.append(_ratio_cell(max(max(ratios.values()) for ratios in row.check.values())))
    return cells


def _ratio_cell(ratio: float) -> str:
    text = f"{ratio:.4f}"
    return f"[red]{text}[/red]" if ratio > ALLOWED_RATIO else text


def document_of(rows: list[PeerRow], runs: int, load: float) -> dict[str, object]:
    """All figures, with versions and hardware of the measurement."""
    packages = ("numpy", "scipy", *PEERS.values())
    versions = {name: importlib.metadata.version(name) for name in packages if name not in missing_peers()}
    return {
        "program": PROGRAM,
        "runs": runs,
        "python": platform.python_version(),
        "versions": versions,
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "load_before": load,
        "rows": [asdict(row) for row in rows],
    }
