"""``feedopt doctor``: list what is missing on this computer, with the remedies."""

from __future__ import annotations

import sys

import click
from rich.console import Console
from rich.table import Table

from feedopt_tools.command.exit_codes import FAILURE, OK
from feedopt_tools.command.upkeep.machine_checks import all_checks

_SIGNS = {"ok": "[green]ok[/green]", "hint": "[yellow]hint[/yellow]", "missing": "[red]missing[/red]"}


@click.command()
def command() -> None:
    """Check Python, ROS, the build, real-time permission, picture libraries, disk and ROS domain."""
    checks = all_checks()
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for check in checks:
        table.add_row(_SIGNS[check.verdict], check.name, check.found)
        if check.way_out:
            table.add_row("", "", f"-> {check.way_out}")
    Console().print(table)
    sys.exit(FAILURE if any(check.verdict == "missing" for check in checks) else OK)
