"""Typical user programs, from their files to audited plans.

Run: ``./feedopt bench programs [--part NAME ...] [--method NAME] [--tolerance MM]``. Parts: ``table`` (our own programs
and those in the folder that FEEDOPT_PROGRAMS names, else in ../shared/data/programs beside the workspace), ``chords``
(the fan contour as short chords against its smooth curve), ``reading`` (lines per second, memory) and ``scales``. Plane
programs use case_a, others router_heng. The benchmark reports figures, without pass or fail.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmark.programs.catalogue import MACHINES, all_programs
from benchmark.programs.chords import chord_lengths, fan_contour, sampled, write_chords
from benchmark.programs.planned import ProgramRun, plan_segments, run_program
from benchmark.programs.reading import measure_reading
from benchmark.programs.scales import run_scales
from rich.console import Console
from rich.table import Table

from feedopt_core.machine.machine_file import load_machine
from feedopt_core.planner.stream_planner import PlannerParameters
from feedopt_core.smoothing.cubic_spline import DEFAULT_TOLERANCE_MM

_READING_CHORD_MM = 0.01
_LAPS = (1, 10)


@dataclass(frozen=True)
class Setting:
    """Settings of every part."""

    folder: Path
    parameters: PlannerParameters
    tolerance_mm: float
    progress: Console


def main(argv: list[str]) -> int:
    """Command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="feedopt bench programs", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--part", nargs="+", choices=PARTS, default=list(PARTS), help="what to run; else all of it")
    parser.add_argument("--method", default="lp_nlp", help="planning method")
    parser.add_argument("--tolerance", type=float, default=DEFAULT_TOLERANCE_MM, metavar="MM", help="of the smoothing")
    arguments = parser.parse_args(argv)
    if not arguments.tolerance > 0.0:
        parser.error("--tolerance must be above zero")
    out = Console(width=None if sys.stdout.isatty() else 170)
    with tempfile.TemporaryDirectory(prefix="feedopt-programs-") as folder:
        parameters = PlannerParameters(method=arguments.method)
        setting = Setting(Path(folder), parameters, arguments.tolerance, Console(stderr=True))
        for part in arguments.part:
            out.print(PARTS[part](setting))
    return 0


def program_table(setting: Setting) -> Table:
    """Every program from its file to an audited plan."""
    machines = {dimensions: load_machine(name) for dimensions, name in MACHINES.items()}
    table = Table("program", "lines", "length", "parse", "smoothing", "segments", "stops", box=None)
    for column in ("deviation / tolerance", "motion time", "worst ratio", "planning", "windows", "fall-backs"):
        table.add_column(column)
    programs = list(all_programs(setting.folder))
    # Load the compiled code here, not in the first row.
    run_program(*programs[0], machines, setting.parameters, setting.tolerance_mm)
    for name, path in programs:
        row = row_of(run_program(name, path, machines, setting.parameters, setting.tolerance_mm))
        setting.progress.print("  ".join(row), highlight=False, soft_wrap=True)
        table.add_row(*row)
    return table


def row_of(run: ProgramRun) -> tuple[str, ...]:
    """A row of the table; unknown figures are omitted, a failure is the last cell."""
    survey, motion, cells = run.survey, run.motion, [run.name]
    if survey is not None:
        stops = sum(segment.place.exact_stop for segment in survey.segments)
        cells += [
            f"{survey.lines}",
            f"{sum(segment.length_mm for segment in survey.segments):.1f} mm",
            f"{1e3 * survey.parse_time_s:.1f} ms",
            f"{1e3 * survey.smoothing_time_s:.1f} ms",
            f"{len(survey.segments)}",
            f"{stops}",
            "-" if survey.deviation is None else f"{survey.deviation.ratio:.4f}",
        ]
    if motion is not None:
        cells += [f"{motion.time_s:.3f} s", f"{motion.worst_ratio:.5f}", f"{motion.planning_s:.2f} s"]
        cells += [f"{motion.windows}", f"{motion.fallbacks}"]
    return (*cells, run.failure) if run.failure else tuple(cells)


def chord_table(setting: Setting) -> Table:
    """The fan contour as chords against the smooth curve."""
    smooth, machine = fan_contour(), load_machine(MACHINES[2])
    table = Table("fan contour as", "lines", "smoothing", "segments", "deviation / tolerance", box=None)
    for column in ("motion time", "against the curve", "worst ratio", "fall-backs"):
        table.add_column(column)
    curve = plan_segments(smooth, machine, setting.parameters)
    lengths = "-", "-", f"{len(smooth)}", "-"
    table.add_row("smooth curve", *lengths, f"{curve.time_s:.3f} s", "-", f"{curve.worst_ratio:.5f}", "0")
    for chord_mm, decimals in chord_lengths():
        name, path = f"chords of {chord_mm:g} mm", setting.folder / "chords.ngc"
        setting.progress.print(name, highlight=False)
        write_chords(path, sampled(smooth, chord_mm), decimals)
        run = run_program(name, path, {2: machine}, setting.parameters, setting.tolerance_mm)
        survey, motion = run.survey, run.motion
        if survey is None or motion is None or survey.deviation is None:
            table.add_row(name, run.failure)
            continue
        smoothing_us = 1e6 * (survey.parse_time_s + survey.smoothing_time_s) / survey.lines
        table.add_row(
            name,
            f"{survey.lines}",
            f"{smoothing_us:.2f} us a line",
            f"{len(survey.segments)}",
            f"{survey.deviation.ratio:.4f}",
            f"{motion.time_s:.3f} s",
            f"{100.0 * (motion.time_s / curve.time_s - 1.0):+.2f} %",
            f"{motion.worst_ratio:.5f}",
            f"{motion.fallbacks}",
        )
    return table


def reading_table(setting: Setting) -> Table:
    """Lines per second of processor time, and memory."""
    points_mm = sampled(fan_contour(), _READING_CHORD_MM)
    warm_up, path = setting.folder / "warm_up.ngc", setting.folder / "reading.ngc"
    write_chords(warm_up, points_mm[:5000], 4)
    table = Table("lines", "parse alone", "file to segments", "first segment after", "segments", "memory", box=None)
    for laps in _LAPS:
        setting.progress.print(f"{laps} laps", highlight=False)
        write_chords(path, points_mm, 4, laps)
        found = measure_reading(path, warm_up, setting.tolerance_mm)
        table.add_row(
            f"{found.lines}",
            f"{found.lines / found.parse_s:.0f} lines/s",
            f"{found.lines / found.whole_s:.0f} lines/s",
            f"{1e3 * found.first_segment_s:.1f} ms",
            f"{found.segments}",
            f"{found.memory_mb:.0f} MB (before: {found.start_mb:.0f} MB)",
        )
    return table


def scale_table(setting: Setting) -> Table:
    """Circle, diamond and square in three scales."""
    machine = load_machine(MACHINES[2])
    table = Table("circle, diamond, square in", "length / scale", "segments", "motion time", "worst ratio", box=None)
    for name, length_mm, segments, motion in run_scales(
        setting.folder, machine, setting.parameters, setting.tolerance_mm
    ):
        table.add_row(name, f"{length_mm:.9f} mm", f"{segments}", f"{motion.time_s:.9f} s", f"{motion.worst_ratio:.6f}")
    return table


PARTS: dict[str, Callable[[Setting], Table]] = {
    "table": program_table,
    "chords": chord_table,
    "reading": reading_table,
    "scales": scale_table,
}
"""Parts of the benchmark by name."""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
