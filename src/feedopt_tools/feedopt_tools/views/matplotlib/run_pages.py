"""Pages by matplotlib: active limits, contour, planner, events."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from feedopt_core.arrays import FloatArray
from feedopt_tools.views.colours import (
    FEED,
    FREE,
    PATH,
    PROGRAMMED,
    axis_colour,
    feed_colours,
    limit_colour,
    unit_colour,
)
from feedopt_tools.views.matplotlib.style import (
    colour_scale,
    curve,
    limit_line,
    page_figure,
    path_axes,
    run_title,
    seen_from_above,
)
from feedopt_tools.views.signals.limit_use import NONE, path_weight_mm
from feedopt_tools.views.signals.path_colours import contour_strips, path_colourings
from feedopt_tools.views.signals.run_events import program_lines
from feedopt_tools.views.signals.scene import RunScene

_LISTED = 14
_LINE_CHARACTERS = 110


def active_limit_page(scene: RunScene) -> Figure:
    """The path coloured by the active limit, and the utilisation of every limit over the arc length for each axis."""
    signals, use = scene.signals, scene.limit_use
    figure = page_figure(f"{run_title(signals)}   ·   active limit along the path")
    axes_used = list(dict.fromkeys(limit.axis for limit in use.limits if limit.axis is not None))
    rows = len(axes_used) + 1
    grid = figure.add_gridspec(rows, 2, width_ratios=[1.0, 1.15])
    path = figure.add_subplot(grid[:, 0])
    colouring = next(one for one in path_colourings(scene) if one.key == "limit")
    path_axes(path, scene, colouring.strips, colouring.colours)
    path.set_title("toolpath, mm")
    shares = dict(use.shares(path_weight_mm(signals)))
    handles = [
        Patch(color=unit_colour(limit_colour(limit.key, limit.axis)), label=f"{limit.label}: {100 * share:.0f} %")
        for limit in use.limits
        if (share := shares[limit.label]) >= 0.005
    ]
    free = Patch(color=unit_colour(FREE), label=f"none above 95 %: {100 * shares['none']:.0f} %")
    path.legend(handles=[*handles, free], loc="upper left", title="active limit, part of the path")
    for place, axis in enumerate(axes_used):
        axes = figure.add_subplot(grid[place, 1])
        for k, limit in enumerate(use.limits):
            if limit.axis == axis:
                colour = unit_colour(limit_colour(limit.key, limit.axis))
                curve(axes, signals.s_mm, 100.0 * use.ratio[:, k], color=colour, label=limit.label)
        _percent(axes, f"{signals.run.axis_names[axis]}: utilisation, %")
        axes.legend(loc="upper right", ncols=5, borderaxespad=0.0, bbox_to_anchor=(1.0, 1.12), fontsize=9)
        axes.set_xlim(0.0, signals.s_mm[-1])
    last = figure.add_subplot(grid[rows - 1, 1])
    curve(last, signals.s_mm, signals.feedrate_mm_s, color=unit_colour(FEED), linewidth=1.6)
    for first, behind, k in use.stretches():
        colour = unit_colour(FREE if k == NONE else limit_colour(use.limits[k].key, use.limits[k].axis))
        last.axvspan(signals.s_mm[first], signals.s_mm[behind], ymax=0.06, color=colour, linewidth=0)
    last.set_title("feedrate, mm/s; below: active limit")
    last.set_ylim(bottom=-0.08 * signals.top_feed_mm_s)
    last.set_xlim(0.0, signals.s_mm[-1])
    last.set_xlabel("arc length, mm")
    last.grid(visible=True)
    return figure


def contour_page(scene: RunScene) -> Figure:
    """Programmed, smoothed and actual path with enlarged error; contour error and lag over the arc length."""
    signals, contour = scene.signals, scene.contour
    assert contour is not None
    figure = page_figure(f"{run_title(signals)}   ·   error enlarged {contour.factor:g} times")
    grid = figure.add_gridspec(2, 2, width_ratios=[1.0, 1.15])
    path = figure.add_subplot(grid[:, 0])
    strips, colours, top_um = contour_strips(contour)
    path_axes(path, scene, strips, colours)
    for strip, rapid in zip(scene.programmed.strips, scene.programmed.rapid, strict=True):
        plane = seen_from_above(strip)
        path.plot(*plane.T, color=unit_colour(PROGRAMMED), linewidth=0.8, linestyle=":" if rapid else "-", marker=".")
    path.plot(*seen_from_above(signals.tool_mm).T, color="#303038", linewidth=0.8)
    path.set_title("programmed (points), smoothed (black) and actual path, mm")
    colour_scale(figure, path, feed_colours(np.linspace(0.0, 1.0, 256), 1.0), top_um, "contour error, µm")
    rows = (("contour error, µm", contour.error_um, FEED), ("lag along the path, µm", contour.lag_um, axis_colour(5)))
    for place, (title, values, colour) in enumerate(rows):
        axes = figure.add_subplot(grid[place, 1])
        curve(axes, contour.s_mm, values, color=unit_colour(colour))
        axes.set_title(title)
        axes.set_xlim(0.0, signals.s_mm[-1])
        axes.grid(visible=True)
    axes.set_xlabel("arc length, mm")
    return figure


def planner_page(scene: RunScene) -> Figure:
    """Windows: committed part and stop, computing time, lead of the plan, and largest utilisation."""
    signals, chunks = scene.signals, scene.signals.run.chunks
    figure = page_figure(f"{run_title(signals)}   ·   {len(chunks)} windows, method {chunks[0].figures.method}")
    axes = figure.subplots(2, 2)
    t_s = np.array([*(chunk.t_start_s for chunk in chunks), chunks[-1].t_commit_s])

    def steps(place: Axes, values: list[float], label: str, axis: int) -> None:
        held: FloatArray = np.array([*values, values[-1]])
        place.step(t_s, held, where="post", label=label, color=unit_colour(axis_colour(axis)))

    steps(axes[0, 0], [chunk.s_commit_mm for chunk in chunks], "committed to", 1)
    steps(axes[0, 0], [chunk.s_stop_mm for chunk in chunks], "stop at", 0)
    curve(axes[0, 0], signals.t_s, signals.s_mm, color="#303038", linewidth=0.9, label="motion")
    axes[0, 0].set_title("windows: arc length, mm")
    axes[0, 0].legend(loc="upper left")
    steps(axes[0, 1], [1e3 * chunk.figures.solve_time_s for chunk in chunks], "solve", 2)
    steps(axes[0, 1], [1e3 * chunk.figures.audit_time_s for chunk in chunks], "audit", 5)
    axes[0, 1].set_title("computing time of each window, ms")
    axes[0, 1].set_ylim(bottom=0.0)
    axes[0, 1].legend(loc="upper right")
    if scene.reserve is not None:
        curve(axes[1, 0], scene.reserve.t_s, scene.reserve.ahead_s, color=unit_colour(FEED))
    axes[1, 0].set_title("plan ahead of the motion, s")
    axes[1, 0].set_ylim(bottom=0.0)
    steps(axes[1, 1], [100.0 * chunk.certificate.worst_ratio for chunk in chunks], "closest limit", 3)
    _percent(axes[1, 1], "closest limit of each window, %")
    for place in axes.ravel():
        place.grid(visible=True)
        place.set_xlim(signals.t_s[0], signals.t_s[-1])
        place.set_xlabel("motion time, s")
    return figure


def events_page(scene: RunScene) -> Figure:
    """Lateness, program line and events, the most severe first."""
    signals = scene.signals
    figure = page_figure(run_title(signals))
    grid = figure.add_gridspec(4, 1)
    late = figure.add_subplot(grid[0])
    curve(late, signals.t_s, signals.lateness_ms, color=unit_colour(FEED), linewidth=0.9)
    late.set_title("lateness of the set points, ms")
    line = figure.add_subplot(grid[1], sharex=late)
    if (lines := program_lines(signals)) is not None:
        curve(line, signals.t_s, lines, color=unit_colour(PATH))
    line.set_title("line of the program")
    line.set_xlabel("motion time, s")
    late.set_xlim(signals.t_s[0], signals.t_s[-1])
    for axes in (late, line):
        axes.grid(visible=True)
    listed = figure.add_subplot(grid[2:])
    listed.axis("off")
    order = {"ERROR": 0, "WARN": 1, "INFO": 2}
    events = sorted(scene.events, key=lambda event: order[event.level])[:_LISTED]
    texts = [
        f"{event.t_s:9.3f} s  {event.s_mm:9.1f} mm  {event.level:<5}  {event.source}: {event.text}"[:_LINE_CHARACTERS]
        for event in sorted(events, key=lambda event: event.t_s)
    ]
    more = f"({len(scene.events)} events, {len(texts)} listed)"
    listed.text(0.0, 1.0, "\n".join([*texts, more]), va="top", family="monospace", fontsize=10)
    return figure


def _percent(axes: Axes, title: str) -> None:
    limit_line(axes, [100.0])
    axes.set_ylim(0.0, 112.0)
    axes.set_title(title)
    axes.grid(visible=True)
