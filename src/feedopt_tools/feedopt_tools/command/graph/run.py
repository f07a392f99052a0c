"""``feedopt run``: execute one program on a new graph."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from feedopt_core.pipeline.read_program import open_program
from feedopt_tools.command.exit_codes import FAILURE, OK, exit_code
from feedopt_tools.command.graph.run_display import RunDisplay
from feedopt_tools.command.options import (
    machine_option,
    method_option,
    planner_parameters,
    run_directory,
    tolerance_option,
    transition_options,
)
from feedopt_tools.execute.client import ProgramRequest
from feedopt_tools.execute.execution import Execution, RunOptions, execute_program


@click.command()
@click.argument("program", type=click.Path(path_type=Path))
@machine_option
@method_option
@tolerance_option
@transition_options
@click.option("--out", type=click.Path(path_type=Path), help="Folder for bag and logs; it must not exist yet.")
@click.option("--stream", is_flag=True, help="Send the lines of PROGRAM on /program_lines instead of its file name.")
@click.option(
    "--no-sim", is_flag=True, help="Run without the simulated router; the program ends when the interpolator is done."
)
def command(
    program: Path,
    machine: str,
    method: str,
    tolerance_mm: float,
    transition_reach_mm: float,
    transition_side: str,
    *,
    out: Path | None,
    stream: bool,
    no_sim: bool,
) -> None:
    """Execute PROGRAM on the graph, in real time, and record it.

    Ctrl-C stops the motion on the path and ends the run; a second Ctrl-C ends the nodes at once.
    """
    # Checked here, because the graph needs seconds to start.
    planner_parameters(method)
    open_program(program)
    request = ProgramRequest(
        program.name,
        path=program,
        tolerance_mm=tolerance_mm,
        streamed=stream,
        transition_reach_mm=transition_reach_mm,
        transition_side=transition_side,
    )
    console = Console()
    options = RunOptions(
        request=request,
        machine=machine,
        directory=run_directory(out, program.name),
        method=method,
        sim=not no_sim,
    )
    with RunDisplay(console) as display:
        execution = execute_program(options, display.events)
    show_execution(console, execution)
    sys.exit(execution_exit_code(execution))


def execution_exit_code(execution: Execution) -> int:
    """Exit code of a run; the failure of a node is raised again as the error of its kind.

    Raises:
        FeedoptError: the cause of an early end.
    """
    if execution.failure is not None:
        raise execution.failure
    if execution.outcome is not None and execution.outcome.failure is not None:
        return exit_code(execution.outcome.failure.kind)
    return OK if execution.succeeded else FAILURE


def show_execution(console: Console, execution: Execution) -> None:
    """Print the result of a run as a table."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    outcome = execution.outcome
    if outcome is not None:
        table.add_row("result", "done" if outcome.failure is None else f"[red]{escape(str(outcome.failure))}[/red]")
        table.add_row("motion time", f"{outcome.motion_time_s:.3f} s")
        table.add_row("path", f"{outcome.path_length_mm:.1f} mm in {outcome.segments} segments")
        table.add_row("late ticks", str(execution.missed_ticks))
        if execution.starved_chunk_sequence:
            text = f"stopped after chunk {execution.starved_chunk_sequence}: planning was too slow"
            table.add_row("starved", text)
    elif execution.interrupted:
        table.add_row("result", "[red]interrupted before the program began[/red]")
    for name, code in execution.exit_codes.items():
        if code:
            table.add_row(name, f"[red]exit code {code}[/red]")
    for remark in execution.remarks:
        table.add_row("", f"[red]{remark}[/red]")
    table.add_row("recording", str(execution.bag))
    console.print(table)
