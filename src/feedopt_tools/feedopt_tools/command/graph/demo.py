"""``feedopt demo``: execute the fan contour, from program to picture."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from feedopt_core.config_files import config_directory
from feedopt_core.motion.certificate import ALLOWED_RATIO
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_tools.command.exit_codes import FAILURE, OK
from feedopt_tools.command.graph.run import execution_exit_code, show_execution
from feedopt_tools.command.graph.run_display import RunDisplay
from feedopt_tools.command.options import DEFAULT_MACHINE, run_directory
from feedopt_tools.execute.client import ProgramRequest
from feedopt_tools.execute.execution import RunOptions, execute_program
from feedopt_tools.execute.judgement import Judgement, judge_run
from feedopt_tools.views.picture import draw_picture
from feedopt_tools.views.rerun.recording import save_recording

PROGRAM = "fan_contour.csv"


@click.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder for bag, logs, recording and picture.")
def command(out: Path | None) -> None:
    """Execute the fan contour on the simulated router in real time; record it, check its limits and draw it.

    Fails if a limit is violated or a tick is missing.
    """
    console = Console()
    directory = run_directory(out, "demo")
    program = config_directory() / "programs" / PROGRAM
    options = RunOptions(ProgramRequest(PROGRAM, path=program), DEFAULT_MACHINE, directory)
    with RunDisplay(console) as display:
        execution = execute_program(options, display.events)
    code = execution_exit_code(execution)
    if not execution.succeeded:
        show_execution(console, execution)
        sys.exit(code)
    run = read_bag(execution.bag)
    judgement = judge_run(run)
    console.print("drawing")
    recording, picture = directory / "run.rrd", directory / "run.png"
    save_recording(run, recording)
    drawn = draw_picture(run, picture)
    _show(console, judgement)
    files = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    files.add_row("bag", str(execution.bag))
    files.add_row("Rerun", f"{recording}   (./feedopt view {recording})")
    files.add_row("picture", f"{drawn.path} by {drawn.drawn_by}" + (f" ({drawn.reason})" if drawn.reason else ""))
    console.print(files, soft_wrap=True)
    sys.exit(OK if judgement.holds else FAILURE)


def _show(console: Console, judgement: Judgement) -> None:
    punctuality = judgement.punctuality
    figures = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    figures.add_row("motion time", f"{judgement.motion_time_s:.3f} s")
    figures.add_row("set points", f"{punctuality.ticks}, missing {punctuality.missing_ticks}")
    figures.add_row(
        "lateness",
        f"p50 {1e6 * punctuality.p50_s:.0f} us, p99 {1e6 * punctuality.p99_s:.0f} us, "
        f"late by a period or more: {punctuality.late_ticks}",
    )
    figures.add_row(
        "recorder",
        f"{judgement.recorded_messages} messages, {100.0 * judgement.recorder_cpu_ratio:.1f} % of a core",
    )
    for finding in judgement.findings:
        figures.add_row("[red]missing[/red]", f"{finding.place}: {finding.text}")
    console.print(figures)

    audit = Table(title="limits, checked on the recorded set points", title_justify="left")
    for column in ("quantity", "axis", "largest", "limit", "ratio", "at s, mm", "at t, s"):
        audit.add_column(column, justify="left" if column in ("quantity", "axis") else "right")
    for row in judgement.audit.rows:
        style = "" if row.ratio <= ALLOWED_RATIO else "red"
        audit.add_row(
            row.quantity,
            row.axis,
            f"{row.value:.6g}",
            f"{row.limit:.6g}",
            f"{row.ratio:.4f}",
            f"{row.s_mm:.1f}",
            f"{row.t_s:.3f}",
            style=style,
        )
    console.print(audit)

    tracking = Table(title="tracking error, um", title_justify="left")
    for column in ("axis", "limit", "predicted max", "simulated max", "predicted rms", "simulated rms"):
        tracking.add_column(column, justify="left" if column == "axis" else "right")
    for entry in judgement.tracking:
        values = (entry.predicted_max_um, entry.simulated_max_um, entry.predicted_rms_um, entry.simulated_rms_um)
        limit = f"{entry.limit_um:.2f}"
        tracking.add_row(entry.axis, limit, *(f"{value:.2f}" for value in values), style="red" if entry.over else None)
    console.print(tracking)
    for entry in judgement.tracking:
        if entry.over:
            console.print(
                f"violation: the simulated drive of {entry.axis} exceeds its limit, the plan does not", style="red"
            )
