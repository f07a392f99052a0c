"""``feedopt plan``: plan a program without ROS."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click
import numpy as np

from feedopt_core.errors import ConfigError
from feedopt_core.machine.machine_file import load_machine
from feedopt_core.pipeline.plan_program import Plan, Setpoints, plan_program
from feedopt_core.programs.layers.transitions import LayerTransitions
from feedopt_tools.command.exit_codes import FAILURE, OK
from feedopt_tools.command.options import (
    machine_option,
    method_option,
    planner_parameters,
    tolerance_option,
    transition_options,
)
from feedopt_tools.command.text_output import TEXT_OUTPUT, is_standard_output, text_output

_HEADER = "t_s,s_mm,feedrate_mm_s,x_mm,y_mm,z_mm"


@click.command()
@click.argument("program", type=click.Path(path_type=Path))
@machine_option
@method_option
@tolerance_option
@transition_options
@click.option("--setpoints", type=TEXT_OUTPUT, help="CSV file for the set points; - is standard output.")
@click.option("--report", type=TEXT_OUTPUT, help="JSON file for times and audit; - is standard output.")
def command(
    program: Path,
    machine: str,
    method: str,
    tolerance_mm: float,
    transition_reach_mm: float,
    transition_side: str,
    setpoints: Path | None,
    report: Path | None,
) -> None:
    """Plan PROGRAM without ROS; write set points and report.

    Fails if the audit finds a violation in the plan.
    """
    if is_standard_output(setpoints) and is_standard_output(report):
        raise ConfigError("--setpoints and --report cannot both be standard output")
    parameters = planner_parameters(method)
    transitions = LayerTransitions.requested(transition_reach_mm, transition_side)
    plan = plan_program(program, load_machine(machine), parameters, tolerance_mm, transitions)
    document = report_document(plan, parameters.method)
    if setpoints is not None:
        write_setpoints(setpoints, plan.setpoints)
    if report is not None:
        with text_output(report) as file:
            file.write(json.dumps(document, indent=1) + "\n")
    worst = plan.audit.worst
    what = f"{worst.quantity} of {worst.axis}" if worst.axis else worst.quantity
    click.echo(
        f"{program}: {plan.toolpath.end_mm:.1f} mm in {plan.motion_time_s:.3f} s, "
        f"planned in {plan.compute_time_s:.2f} s; closest to its limit: {what}, "
        f"{worst.ratio:.4f} at s = {worst.s_mm:.1f} mm",
        err=is_standard_output(setpoints) or is_standard_output(report),
    )
    sys.exit(OK if plan.audit.holds else FAILURE)


def report_document(plan: Plan, method: str) -> dict[str, object]:
    """Report of a plan as JSON types; ``audit`` has one entry per grid, axis and quantity."""
    return {
        "motion_time_s": plan.motion_time_s,
        "compute_time_s": plan.compute_time_s,
        "first_chunk_s": plan.first_chunk_s,
        "path_length_mm": plan.toolpath.end_mm,
        "method": method,
        "windows": len(plan.chunks),
        "audit_holds": plan.audit.holds,
        "audit": plan.audit.as_list(),
    }


def write_setpoints(path: Path, setpoints: Setpoints) -> None:
    """Write set points with 15 significant digits, one per line. Raises ConfigError."""
    columns = np.column_stack([setpoints.t_s, setpoints.s_mm, setpoints.v_mm_s, setpoints.tool_mm])
    with text_output(path) as file:
        np.savetxt(file, columns, fmt="%.15g", delimiter=",", header=_HEADER, comments="")
