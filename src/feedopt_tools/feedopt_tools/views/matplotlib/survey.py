"""A program and its smoothed path by matplotlib, if Rerun cannot draw."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from feedopt_tools.views.colours import FEED, LIMIT, PATH, PROGRAMMED, RAPID, axis_colour, unit_colour
from feedopt_tools.views.matplotlib.style import STYLE, curve, page_figure, seen_from_above, write_figure
from feedopt_tools.views.signals.survey_scene import SurveyScene


def draw_survey_by_matplotlib(scene: SurveyScene, picture: Path) -> None:
    """Write a PNG of 1600 x 900.

    Raises:
        OSError: the picture cannot be written.
    """
    with mpl.rc_context(STYLE):
        figures = scene.figures
        figure = page_figure(f"{scene.name}   ·   {figures.lines} lines, {figures.length_mm:.1f} mm")
        rows = 2 if scene.deviation is None else 3
        grid = figure.add_gridspec(rows, 2, width_ratios=[1.0, 1.15])
        _paths(figure.add_subplot(grid[:, 0]), scene)
        if scene.deviation is not None:
            axes = figure.add_subplot(grid[0, 1])
            deviation = scene.deviation
            curve(axes, deviation.s_mm, 1e3 * deviation.tolerance_mm, color=unit_colour(LIMIT), linestyle=(0, (6, 2)))
            curve(axes, deviation.s_mm, 1e3 * deviation.deviation_mm, color=unit_colour(FEED))
            axes.set_ylim(0.0, 1.15e3 * float(np.max(deviation.tolerance_mm)))
            axes.set_title("deviation and its tolerance, µm")
            axes.grid(visible=True)
        axes = figure.add_subplot(grid[rows - 2, 1])
        curve(axes, scene.s_mm, scene.curvature_per_mm, color=unit_colour(axis_colour(2)))
        axes.set_title("curvature, 1/mm")
        axes.grid(visible=True)
        axes = figure.add_subplot(grid[rows - 1, 1])
        axes.step(scene.segment_s_mm, scene.feed_mm_s, where="post", color=unit_colour(axis_colour(1)))
        axes.set_title("programmed feed, mm/s")
        axes.set_xlabel("arc length, mm")
        axes.grid(visible=True)
        write_figure(figure, picture)


def _paths(axes: Axes, scene: SurveyScene) -> None:
    # One point of view for all pieces, even if some of them are flat.
    programmed = list(zip(scene.programmed.strips, scene.programmed.rapid, strict=True))
    every = [*(strip for strip, _ in programmed), *scene.strips_mm]
    ends = np.cumsum([len(strip) for strip in every])[:-1]
    seen = np.split(seen_from_above(np.concatenate(every)), ends)
    for colour, wanted, label in ((PROGRAMMED, False, "programmed"), (RAPID, True, "rapid")):
        strips = [seen[index] for index, (_, rapid) in enumerate(programmed) if rapid == wanted]
        if strips:
            lines = LineCollection(strips, colors=[unit_colour(colour)], linewidths=1.0, label=label)
            axes.add_collection(lines)
    smoothed = seen[len(programmed) :]
    axes.add_collection(LineCollection(smoothed, colors=["#303038"], linewidths=1.4, label="smoothed"))
    axes.plot(*smoothed[0][0], "o", color=unit_colour(PATH), markersize=6, zorder=3)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    axes.set_title("toolpath, mm")
    axes.grid(visible=True)
    axes.legend(loc="upper right", ncols=3, borderaxespad=0.0, bbox_to_anchor=(1.0, 1.06))
