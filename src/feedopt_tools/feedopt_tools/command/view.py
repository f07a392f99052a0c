"""``feedopt view``: a recorded run in the Rerun viewer."""

from __future__ import annotations

from pathlib import Path

import click

from feedopt_tools.execute.execution import BAG_NAME
from feedopt_tools.views.viewer import open_viewer


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--save", type=click.Path(path_type=Path, dir_okay=False), help="Where to put the .rrd made of a bag.")
@click.option("--program", type=int, help="Program of the bag; without it, the last one.")
def command(bag: Path, save: Path | None, program: int | None) -> None:
    """Show BAG, the folder of a run or a .rrd file in the Rerun viewer."""
    opened = open_viewer(bag / BAG_NAME if (bag / BAG_NAME).is_dir() else bag, save, program)
    click.echo(opened.hint or f"{opened.recording} is open in the viewer")
