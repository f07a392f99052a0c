"""The pages of a run by matplotlib, if Rerun cannot draw: the same curves, limits and colours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from feedopt_tools.views.colours import FEED, PATH, axis_colour, feed_colours, unit_colour
from feedopt_tools.views.matplotlib.run_pages import active_limit_page, contour_page, events_page, planner_page
from feedopt_tools.views.matplotlib.style import (
    STYLE,
    colour_scale,
    curve,
    limit_line,
    page_figure,
    path_axes,
    run_title,
    write_figure,
)
from feedopt_tools.views.pages import (
    ACTIVE_LIMIT,
    AXIS_LIMITS,
    AXIS_QUANTITIES,
    CONTOUR,
    EVENTS,
    MOTION,
    PLANNER,
    TRACKING,
    TRACKING_QUANTITIES,
    Page,
)
from feedopt_tools.views.signals.path_colours import path_colourings
from feedopt_tools.views.signals.scene import RunScene
from feedopt_tools.views.signals.signals import Quantity, RunSignals

_ROOM = 1.15


def draw_by_matplotlib(scene: RunScene, picture: Path, page: Page = MOTION) -> None:
    """Write a PNG of 1600 x 900 with one page.

    Raises:
        OSError: the picture cannot be written.
    """
    with mpl.rc_context(STYLE):
        write_figure(figure_of(scene, page), picture)


def figure_of(scene: RunScene, page: Page) -> Figure:
    """One page as a figure; to be called inside ``rc_context(STYLE)``."""
    pages: dict[Page, Callable[[RunScene], Figure]] = {
        MOTION: _motion_page,
        ACTIVE_LIMIT: active_limit_page,
        AXIS_LIMITS: lambda shown: _rows_page(shown, "use", AXIS_QUANTITIES),
        TRACKING: lambda shown: _rows_page(shown, "error", TRACKING_QUANTITIES),
        CONTOUR: contour_page,
        PLANNER: planner_page,
        EVENTS: events_page,
    }
    return pages[page](scene)


def _motion_page(scene: RunScene) -> Figure:
    """Coloured toolpath, feed over time and arc length, tracking error, control signal."""
    signals = scene.signals
    figure = page_figure(run_title(signals))
    columns = figure.add_gridspec(1, 2, width_ratios=[1.0, 1.15])
    left, right = columns[0].subgridspec(6, 1), columns[1].subgridspec(6, 1)
    _coloured_path(figure, figure.add_subplot(left[:4]), scene, "feed")
    _feed_over_arc_length(figure.add_subplot(left[4:]), signals)
    rows = [signals.quantities[key] for key in ("tracking_error", "control_signal") if signals.quantities[key].drawn]
    rows = rows or [signals.quantities["acceleration"], signals.quantities["jerk"]]
    height = 6 // (1 + len(rows))
    first = figure.add_subplot(right[:height])
    _feed_over_time(first, signals)
    for place, quantity in enumerate(rows, start=1):
        axes = figure.add_subplot(right[height * place : height * (place + 1)], sharex=first)
        _quantity(axes, signals, quantity)
    axes.set_xlabel("motion time, s")
    return figure


def _rows_page(scene: RunScene, path_key: str, keys: tuple[str, ...]) -> Figure:
    """A coloured path, and quantities of the axes over time."""
    signals = scene.signals
    figure = page_figure(run_title(signals))
    rows = [signals.quantities[key] for key in keys if signals.quantities[key].drawn]
    grid = figure.add_gridspec(len(rows), 2, width_ratios=[1.0, 1.15])
    _coloured_path(figure, figure.add_subplot(grid[:, 0]), scene, path_key)
    for place, quantity in enumerate(rows):
        axes = figure.add_subplot(grid[place, 1])
        _quantity(axes, signals, quantity)
    axes.set_xlabel("motion time, s")
    return figure


def _coloured_path(figure: Figure, axes: Axes, scene: RunScene, key: str) -> None:
    colourings = {colouring.key: colouring for colouring in path_colourings(scene)}
    colouring = colourings.get(key, colourings["feed"])
    path_axes(axes, scene, colouring.strips, colouring.colours)
    axes.set_title("toolpath, mm")
    colour_scale(figure, axes, feed_colours(np.linspace(0.0, 1.0, 256), 1.0), colouring.top, colouring.label)


def _feed_over_arc_length(axes: Axes, signals: RunSignals) -> None:
    limit_line(axes, [signals.feed_limit_mm_s])
    curve(axes, signals.s_mm, signals.feedrate_mm_s, color=unit_colour(FEED), linewidth=1.6)
    axes.set_title("feedrate over arc length, mm/s")
    axes.set_xlabel("arc length, mm")
    axes.set_xlim(0.0, max(signals.s_mm[-1], 1e-9))
    _feed_range(axes, signals)


def _feed_over_time(axes: Axes, signals: RunSignals) -> None:
    limit_line(axes, [signals.feed_limit_mm_s])
    if signals.programmed_mm_s is not None:
        programmed = np.fmin(signals.programmed_mm_s, signals.feed_limit_mm_s)
        curve(axes, signals.t_s, programmed, color=unit_colour(PATH), linewidth=1.0, label="programmed")
        axes.legend(loc="lower center")
    curve(axes, signals.t_s, signals.feedrate_mm_s, color=unit_colour(FEED), linewidth=1.6)
    axes.set_title("feedrate, mm/s")
    axes.set_xlim(signals.t_s[0], signals.t_s[-1])
    _feed_range(axes, signals)


def _feed_range(axes: Axes, signals: RunSignals) -> None:
    limit = signals.feed_limit_mm_s
    axes.set_ylim(0.0, _ROOM * max(signals.top_feed_mm_s, limit if np.isfinite(limit) else 0.0))
    axes.grid(visible=True)


def _quantity(axes: Axes, signals: RunSignals, quantity: Quantity) -> None:
    names = signals.run.axis_names
    axes.set_title(quantity.title)
    axes.grid(visible=True)
    for axis, name in enumerate(names):
        colour = unit_colour(axis_colour(axis))
        if quantity.measured is not None:
            curve(axes, signals.state_t_s, quantity.measured[:, axis], color=colour, linewidth=1.4, label=name)
        if quantity.commanded is not None:
            alone = quantity.measured is None
            style: dict[str, Any] = {"color": colour, "linewidth": 1.4, "label": name}
            if not alone:
                style = {"color": "#303038", "linewidth": 0.8, "linestyle": (0, (4, 3)), "alpha": 0.8}
                style["label"] = "predicted by the model" if axis == len(names) - 1 else None
            curve(axes, signals.t_s, quantity.commanded[:, axis], **style)
    if quantity.limit is not None:
        # Equal limits of several axes are one line; different limits have the colour of their axis.
        if len(set(quantity.limit)) == 1:
            limit_line(axes, [quantity.limit[0], -quantity.limit[0]])
        else:
            for axis, limit in enumerate(quantity.limit):
                limit_line(axes, [limit, -limit], unit_colour(axis_colour(axis)))
    low, high = axes.get_ylim()
    axes.set_ylim(1.05 * low, 1.05 * high)
    axes.legend(loc="upper right", ncols=len(names) + 1, borderaxespad=0.0, bbox_to_anchor=(1.0, 1.16))
