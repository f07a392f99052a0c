"""``feedopt export``: write a plan or a run for other tools."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TextIO

import click

from feedopt_core.errors import ConfigError
from feedopt_core.machine.machine_file import load_machine
from feedopt_core.pipeline.plan_program import plan_program
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.bags.run_data import RunData
from feedopt_recorder.run_folder import BAG_NAME, bag_of
from feedopt_tools.command.options import machine_option, method_option, planner_parameters, tolerance_option
from feedopt_tools.command.text_output import TEXT_OUTPUT, is_standard_output, open_text
from feedopt_tools.errors import ExportError
from feedopt_tools.export.gcode import GcodeSettings, write_gcode
from feedopt_tools.export.joint_trajectory import joint_trajectory_yaml
from feedopt_tools.export.motion import Motion, motion_of_plan, motion_of_run
from feedopt_tools.export.samples import Table, setpoint_table, state_table, write_csv, write_npz, write_parquet

_ENDINGS = {
    "gcode": ".ngc",
    "csv": ".csv",
    "npz": ".npz",
    "parquet": ".parquet",
    "joint-trajectory": ".yaml",
    "states": ".csv",
}
_BINARY: dict[str, Callable[[Path, Table], None]] = {"npz": write_npz, "parquet": write_parquet}
_DEFAULTS = GcodeSettings()


@click.command()
@click.argument("source", metavar="BAG|PROGRAM", type=click.Path(path_type=Path))
@click.option("--format", "kind", type=click.Choice(list(_ENDINGS)), default="gcode", show_default=True)
@click.option(
    "--out",
    type=TEXT_OUTPUT,
    help="Output file; default: named after the source. - is standard output, for all formats but npz and parquet.",
)
@click.option("--program", type=int, help="Number of the program in the bag; default: the last one.")
@machine_option
@method_option
@tolerance_option
@click.option("--chord-tolerance-mm", type=float, default=_DEFAULTS.tolerance_mm, show_default=True, help="G-code.")
@click.option("--longest-chord-mm", type=float, default=_DEFAULTS.longest_chord_mm, show_default=True, help="G-code.")
@click.option("--feed-step-mm-min", type=float, default=_DEFAULTS.feed_step_mm_min, show_default=True, help="G-code.")
@click.option("--inverse-time", is_flag=True, help="G-code: feeds as inverse time (G93).")
@click.option("--period-s", type=float, help="Period of set points and trajectories, s; default: that of the machine.")
def command(
    source: Path,
    kind: str,
    *,
    out: Path | None,
    program: int | None,
    machine: str,
    method: str,
    tolerance_mm: float,
    chord_tolerance_mm: float,
    longest_chord_mm: float,
    feed_step_mm_min: float,
    inverse_time: bool,
    period_s: float | None,
) -> None:
    """Write a recorded run, or plan a program and write it, as G-code with feeds, set points, trajectory or states.

    Machine, method and smoothing tolerance apply to a program; a bag contains its own.
    """
    to_stdout = is_standard_output(out)
    if to_stdout and kind in _BINARY:
        raise ConfigError(
            f"--format {kind} is binary and needs a file: give --out FILE, or --format csv for standard output"
        )
    bag = bag_of(source)
    run = read_bag(bag, program) if bag.is_dir() or bag.suffix == ".mcap" else None
    stem = source.parent.name if source.name == BAG_NAME else source.stem
    path = out or Path(f"{stem}_{kind.replace('-', '_')}{_ENDINGS[kind]}")
    if kind == "states":
        if run is None:
            raise ConfigError(f"{source}: is a program; states can only be exported from the bag of a run")
        states = state_table(run)
        _write_text(path, lambda file: write_csv(file, states))
        click.echo(f"{path}: {len(run.states)} states", err=to_stdout)
        return
    motion = _motion(source, run, (machine, method, tolerance_mm))
    period_s = motion.machine.period_s if period_s is None else period_s
    if kind == "gcode":
        settings = GcodeSettings(chord_tolerance_mm, longest_chord_mm, feed_step_mm_min, inverse_time)
        click.echo(_write_gcode(path, motion, settings), err=to_stdout)
    elif kind == "joint-trajectory":
        text = joint_trajectory_yaml(motion, period_s)
        _write_text(path, lambda file: file.write(text))
        click.echo(f"{path}: {text.count('- positions')} points, {motion.t_s[-1]:.3f} s", err=to_stdout)
    else:
        table = setpoint_table(motion, period_s)
        if kind in _BINARY:
            _write(path, lambda: _BINARY[kind](path, table))
        else:
            _write_text(path, lambda file: write_csv(file, table))
        click.echo(f"{path}: {len(table['t_s'])} set points, {motion.t_s[-1]:.3f} s", err=to_stdout)


def _motion(source: Path, run: RunData | None, planning: tuple[str, str, float]) -> Motion:
    if run is not None:
        return motion_of_run(run)
    name, method, tolerance_mm = planning
    machine = load_machine(name)
    plan = plan_program(source, machine, planner_parameters(method), tolerance_mm)
    if not plan.audit.holds:
        worst = plan.audit.worst
        raise ExportError(
            f"{source}: the plan violates a limit: {worst.quantity} {worst.axis} is {worst.ratio:.4f} times its limit"
        )
    return motion_of_plan(plan, machine, source)


def _write_gcode(path: Path, motion: Motion, settings: GcodeSettings) -> str:
    written = write_gcode(motion, settings)
    _write_text(path, lambda file: file.write("\n".join(written.lines) + "\n"))
    return (
        f"{path}: {written.chords} moves within {1e3 * written.deviation_mm:.2f} um of the path (read back); "
        f"{written.written_s:.3f} s at their feeds (planned {written.planned_s:.3f} s), "
        f"up to {written.blocks_a_second:.0f} moves a second"
    )


def _write_text(path: Path, write: Callable[[TextIO], object]) -> None:
    def opened() -> None:
        with open_text(path) as file:
            write(file)

    _write(path, opened)


def _write(path: Path, write: Callable[[], object]) -> None:
    try:
        write()
    except OSError as error:
        raise ExportError(f"{path}: cannot be written: {error.strerror}") from error
