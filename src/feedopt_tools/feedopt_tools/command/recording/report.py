"""``feedopt report``: write an HTML page about a run."""

from __future__ import annotations

from pathlib import Path

import click

from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.run_folder import bag_of
from feedopt_tools.command.text_output import TEXT_OUTPUT, is_standard_output, text_output
from feedopt_tools.report.run_report import report_html, write_report
from feedopt_tools.views.signals.scene import scene_of


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--out", type=TEXT_OUTPUT, help="Output file; default: report.html in BAG. - is standard output.")
@click.option("--program", type=int, help="Number of the program in the bag; default: the last one.")
def command(bag: Path, out: Path | None, program: int | None) -> None:
    """Write one self-contained HTML page about BAG: times, limits, tracking, planner, events, provenance."""
    folder = bag_of(bag)
    scene = scene_of(read_bag(folder, program, allow_truncated=True))
    if out is not None and is_standard_output(out):
        page = report_html(scene)
        with text_output(out) as file:
            file.write(page)
        click.echo(f"{out}: {len(page.encode()) / 1024:.0f} KiB", err=True)
        return
    path = out or (folder if folder.is_dir() else folder.parent) / "report.html"
    write_report(scene, path)
    click.echo(f"{path}: {path.stat().st_size / 1024:.0f} KiB")
