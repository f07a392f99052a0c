"""The fan contour exported as G-code, timed on models of ordinary controllers: how much of the saved time remains.

Run: ``./feedopt bench export [--machine NAME] [--method NAME] [--json FILE]``. The program is planned, written with
several chord lengths and feed steps, read back, and executed by the rules of Grbl and of Klipper (see lookahead.py).
For comparison, the same chords are executed with one feed for the whole program: at full speed, and at the speed for
which the axes need no more acceleration than for the exported program.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from benchmark.export.lookahead import Array, Controller, Ride, ride
from rich.console import Console
from rich.table import Table

from feedopt_core.config_files import find_config
from feedopt_core.machine.machine_file import Machine, load_machine
from feedopt_core.pipeline.plan_program import plan_program
from feedopt_core.pipeline.read_program import Program, ProgramKind, read_moves
from feedopt_core.programs.moves import LineMoves
from feedopt_tools.command.options import planner_parameters
from feedopt_tools.export.gcode import GcodeSettings, write_gcode
from feedopt_tools.export.motion import Motion, motion_of_plan

CHORDS_MM = (0.1, 0.25, 0.5, 1.0, 2.0)
FEED_STEPS_MM_MIN = (1.0, 100.0, 600.0)
_PERIOD_S = 0.001
_SINGLE_FEEDS = 100
_AS_GENTLE = 1.02
# At 1 kHz the peak at a corner or a step of acceleration depends on the sampling: both are averaged over 5 ms.
_WINDOW_TICKS = 5


@dataclass(frozen=True)
class Row:
    """One program on one controller.

    Attributes:
        controller: name of the controller.
        program: ``exported``, ``one feed, full`` or ``one feed, as gentle``.
        chord_mm, feed_step_mm_min: chord length and feed step of the export; NaN if not applicable.
        moves_a_second: largest number of moves per second.
        time_s: motion time.
        survives_ratio: remaining part of the time that the plan saves against ``one feed, as gentle``; NaN if not
            applicable.
        acceleration_ratio, jerk_ratio: largest ratio of any axis to its limit, averaged over 5 ms.
    """

    controller: str
    program: str
    chord_mm: float
    feed_step_mm_min: float
    moves_a_second: float
    time_s: float
    survives_ratio: float
    acceleration_ratio: float
    jerk_ratio: float


def main(argv: list[str]) -> int:
    """Command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="feedopt bench export", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--machine", default="case_a", help="machine file or its name; it needs acceleration limits")
    parser.add_argument("--method", default="lp", help="planning method")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every figure here")
    arguments = parser.parse_args(argv)
    machine = load_machine(arguments.machine)
    if not np.all(np.isfinite(machine.acceleration_limit_mm_s2 + machine.velocity_limit_mm_s)):
        parser.error(f"machine {machine.name} has an axis without a limit of velocity or acceleration")
    contour = find_config("programs", "fan_contour", ".csv")
    motion = motion_of_plan(plan_program(contour, machine, planner_parameters(arguments.method)), machine, contour)
    rows = [row for controller in controllers(machine) for row in controller_rows(controller, motion)]
    Console(width=None if sys.stdout.isatty() else 150).print(_table(motion, rows))
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n", encoding="utf-8")
    return 0


def controllers(machine: Machine) -> tuple[Controller, ...]:
    """Grbl and Klipper with their usual settings and the machine's limits."""
    limits = machine.velocity_limit_mm_s, machine.acceleration_limit_mm_s2
    return Controller("grbl", *limits, 0.01, 0.0, 16), Controller("klipper", *limits, 0.0, 5.0, 0)


def controller_rows(controller: Controller, motion: Motion) -> list[Row]:
    """Every program on one controller."""
    rows = []
    plan_s = float(motion.t_s[-1])
    for chord_mm in CHORDS_MM:
        exported = []
        for step in FEED_STEPS_MM_MIN:
            written = write_gcode(motion, GcodeSettings(longest_chord_mm=chord_mm, feed_step_mm_min=step))
            points, feeds = _moves(written.lines, motion.machine.dimensions)
            exported.append((step, written.blocks_a_second, ride(controller, points, feeds)))
        ratios = [_ratios(motion, one) for _, _, one in exported]
        gentle = _as_gentle(controller, motion, points, ratios[0][0])
        full = ride(controller, points, np.full(len(points) - 1, motion.machine.feed_limit_mm_s))
        for (step, rate, one), pair in zip(exported, ratios, strict=True):
            survives = (gentle.total_s - one.total_s) / (gentle.total_s - plan_s)
            rows.append(Row(controller.name, "exported", chord_mm, step, rate, one.total_s, survives, *pair))
        for name, one in (("one feed, as gentle", gentle), ("one feed, full", full)):
            nothing = float("nan")
            rate = float(1.0 / np.min(one.time_s[1:-1]))
            rows.append(
                Row(controller.name, name, chord_mm, nothing, rate, one.total_s, nothing, *_ratios(motion, one))
            )
    return rows


def _moves(lines: tuple[str, ...], dimensions: int) -> tuple[Array, Array]:
    """Ends of the feed moves, the start first, and their feeds."""
    points, feeds = list[Array](), list[Array]()
    for move in read_moves(Program(ProgramKind.GCODE, lines), "exported"):
        if isinstance(move, LineMoves) and not move.rapid:
            points += [move.points_mm] if points else [move.start_mm[None, :], move.points_mm]
            feeds.append(move.feed_mm_s)
    return np.vstack(points)[:, :dimensions], np.concatenate(feeds)


def _as_gentle(controller: Controller, motion: Motion, points: Array, acceleration_ratio: float) -> Ride:
    """Motion with the fastest single feed whose acceleration stays within a ratio to the limits."""
    for feed_mm_s in np.geomspace(motion.machine.feed_limit_mm_s, 1.0, _SINGLE_FEEDS):
        one = ride(controller, points, np.full(len(points) - 1, feed_mm_s))
        if _ratios(motion, one)[0] <= acceleration_ratio * _AS_GENTLE:
            break
    return one


def _ratios(motion: Motion, one: Ride) -> tuple[float, float]:
    """Largest ratio of axis acceleration and jerk to their limits on the smooth path, averaged over 5 ms."""
    s, _ = one.sampled(_PERIOD_S)
    start_mm, end_mm = motion.toolpath.start_mm, motion.toolpath.end_mm
    s = np.pad(start_mm + s * (end_mm - start_mm) / np.sum(one.length_mm), (20, 20), mode="edge")
    axes = motion.toolpath.evaluate(s).r_mm @ motion.machine.axis_matrix().T
    window = np.ones(_WINDOW_TICKS) / _WINDOW_TICKS
    axes = np.stack([np.convolve(np.convolve(column, window, "valid"), window, "valid") for column in axes.T], axis=1)
    acceleration = np.max(np.abs(np.diff(axes, n=2, axis=0)), axis=0) / _PERIOD_S**2
    jerk = np.max(np.abs(np.diff(axes, n=3, axis=0)), axis=0) / _PERIOD_S**3
    limits = np.array(motion.machine.acceleration_limit_mm_s2), np.array(motion.machine.jerk_limit_mm_s3)
    return float(np.max(acceleration / limits[0])), float(np.max(jerk / limits[1]))


def _table(motion: Motion, rows: list[Row]) -> Table:
    title = f"{motion.name} on {motion.machine.name}: planned {motion.t_s[-1]:.3f} s"
    table = Table(title=title, title_justify="left")
    for column in ("controller", "program", "chord, mm", "feed step", "moves/s", "time, s", "survives", "acc.", "jerk"):
        table.add_column(column, justify="left" if column in ("controller", "program") else "right")
    for row in rows:
        table.add_row(
            row.controller,
            row.program,
            f"{row.chord_mm:g}",
            "" if np.isnan(row.feed_step_mm_min) else f"{row.feed_step_mm_min:g}",
            f"{row.moves_a_second:.0f}",
            f"{row.time_s:.3f}",
            _survives(row),
            f"{row.acceleration_ratio:.2f}",
            f"{row.jerk_ratio:.2f}",
        )
    return table


def _survives(row: Row) -> str:
    if np.isnan(row.survives_ratio):
        return ""
    return f"{100.0 * row.survives_ratio:.0f} %" if row.survives_ratio > 0.0 else "nothing"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
