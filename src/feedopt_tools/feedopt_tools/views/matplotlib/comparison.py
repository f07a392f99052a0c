"""Comparison of two runs by matplotlib, if Rerun cannot draw."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

from feedopt_tools.views.colours import FEED, axis_colour, feed_colours, unit_colour
from feedopt_tools.views.matplotlib.style import (
    STYLE,
    colour_scale,
    curve,
    limit_line,
    page_figure,
    path_axes,
    write_figure,
)
from feedopt_tools.views.signals.comparison import Comparison, Overlay
from feedopt_tools.views.signals.path_colours import path_colourings

_KEYS = ("feed", "use", "tracking_error")


def draw_comparison_by_matplotlib(comparison: Comparison, picture: Path, over: str) -> None:
    """Write a PNG of 1600 x 900 with both paths, overlaid curves and the time difference.

    Raises:
        OSError: the picture cannot be written.
    """
    with mpl.rc_context(STYLE):
        times = [scene.signals.run.motion_time_s for scene in (comparison.first, comparison.second)]
        names = comparison.names
        figure = page_figure(f"{names[0]}: {times[0]:.3f} s   ·   {names[1]}: {times[1]:.3f} s")
        shown = [curve for curve in comparison.curves if curve.key.split("/")[0] in _KEYS]
        grid = figure.add_gridspec(2 * (len(shown) + 1), 2, width_ratios=[1.0, 1.6])
        top_mm_s = max(scene.signals.top_feed_mm_s for scene in (comparison.first, comparison.second))
        half = len(shown) + 1
        for place, scene in enumerate((comparison.first, comparison.second)):
            axes = figure.add_subplot(grid[place * half : (place + 1) * half, 0])
            colouring = path_colourings(scene, top_mm_s)[0]
            path_axes(axes, scene, colouring.strips, colouring.colours)
            axes.set_title(names[place])
            colour_scale(figure, axes, feed_colours(np.linspace(0.0, 1.0, 256), 1.0), top_mm_s, "feedrate, mm/s")
        for place, one in enumerate(shown):
            axes = figure.add_subplot(grid[2 * place : 2 * place + 2, 1])
            overlay: Overlay = one.over_time if over == "time" else one.over_path
            curve(axes, overlay.at, overlay.first, color=unit_colour(axis_colour(0)), label=names[0])
            curve(axes, overlay.at, overlay.second, color=unit_colour(axis_colour(2)), label=names[1])
            limit_line(axes, [one.limit] if one.key == "use" else [one.limit, -one.limit])
            axes.set_title(one.title)
            axes.grid(visible=True)
            if place == 0:
                axes.legend(loc="upper right", ncols=2, borderaxespad=0.0, bbox_to_anchor=(1.0, 1.3))
        axes = figure.add_subplot(grid[2 * len(shown) :, 1])
        reached = comparison.reached_s
        curve(axes, reached.at, 1e3 * reached.difference, color=unit_colour(FEED))
        axes.set_title(f"{names[1]} is later by, ms, over the arc length, mm")
        axes.grid(visible=True)
        write_figure(figure, picture)
