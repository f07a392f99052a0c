"""``feedopt toolpath``: show the content of a program and its smoothed path; without limits and motion."""

from __future__ import annotations

import json
import math
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Table

from feedopt_core.machine.machine_file import load_machine
from feedopt_core.pipeline.survey import SurveyFigures, survey_figures, survey_program
from feedopt_core.programs.layers.transitions import LayerTransitions
from feedopt_tools.command.exit_codes import FAILURE, OK
from feedopt_tools.command.options import tolerance_option, transition_options
from feedopt_tools.command.text_output import TEXT_OUTPUT, is_standard_output, text_output

if TYPE_CHECKING:
    from feedopt_tools.views.signals.survey_scene import SurveyScene


@click.command()
@click.argument("program", type=click.Path(path_type=Path))
@click.option(
    "--machine", metavar="FILE|NAME", help="Machine that defines the number of coordinates; its limits are not used."
)
@tolerance_option
@transition_options
@click.option("--view", is_flag=True, help="Open the path in the Rerun viewer.")
@click.option("--json", "report", type=TEXT_OUTPUT, help="JSON file for the figures; - is standard output.")
@click.option("--save", type=click.Path(path_type=Path, dir_okay=False), help="File name of the .rrd recording.")
@click.option(
    "--screenshot", type=click.Path(path_type=Path, dir_okay=False), help="Write a picture of the path as PNG."
)
def command(
    program: Path,
    machine: str | None,
    tolerance_mm: float,
    transition_reach_mm: float,
    transition_side: str,
    *,
    view: bool,
    report: Path | None,
    save: Path | None,
    screenshot: Path | None,
) -> None:
    """List the content of PROGRAM: moves, corners, stops, and the smoothed path with its deviation.

    Fails if the deviation of the smoothed path exceeds the tolerance.
    """
    transitions = LayerTransitions.requested(transition_reach_mm, transition_side)
    survey = survey_program(program, load_machine(machine).dimensions if machine else None, tolerance_mm, transitions)
    figures = survey_figures(survey)
    to_stderr = is_standard_output(report)
    _show_figures(figures, to_stderr=to_stderr)
    if report is not None:
        with text_output(report) as file:
            file.write(json.dumps(figures_document(figures), indent=1) + "\n")
    if view or save is not None or screenshot is not None:
        from feedopt_tools.views.signals.survey_scene import survey_scene

        _show(survey_scene(program.name, survey), view=view, save=save, screenshot=screenshot, to_stderr=to_stderr)
    sys.exit(OK if survey.deviation is None or survey.deviation.holds else FAILURE)


def figures_document(figures: SurveyFigures) -> dict[str, object]:
    """Figures as JSON types; infinite values become null."""
    document = asdict(figures)
    if math.isinf(figures.smallest_radius_mm):
        document["smallest_radius_mm"] = None
    return document


def _show_figures(figures: SurveyFigures, *, to_stderr: bool) -> None:
    from feedopt_tools.views.signals.survey_scene import survey_rows

    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, text in survey_rows(figures):
        table.add_row(name, text)
    Console(stderr=to_stderr).print(table, highlight=False)


def _show(scene: SurveyScene, *, view: bool, save: Path | None, screenshot: Path | None, to_stderr: bool) -> None:
    from feedopt_tools.views.picture import draw_survey_picture
    from feedopt_tools.views.rerun.survey_recording import save_survey
    from feedopt_tools.views.rerun.viewer import open_viewer

    if screenshot is not None:
        picture = draw_survey_picture(scene, screenshot)
        reason = f" ({picture.reason})" if picture.reason else ""
        click.echo(f"{picture.path} drawn by {picture.drawn_by}{reason}", err=to_stderr)
    if save is None and not view:
        return
    # The viewer reads the file after this command has ended.
    recording = save or Path(tempfile.mkdtemp(prefix="feedopt-")) / f"{Path(scene.name).stem}.rrd"
    save_survey(scene, recording)
    if view:
        opened = open_viewer(recording)
        click.echo(opened.hint or f"{recording} is open in the viewer", err=to_stderr)
    else:
        click.echo(str(recording), err=to_stderr)
