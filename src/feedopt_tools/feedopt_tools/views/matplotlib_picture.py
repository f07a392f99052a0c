"""The picture of a run where Rerun cannot draw: the same curves, limits and colours by matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from feedopt_tools.views.colours import FEED, LIMIT, PATH, axis_colour, feed_colours, unit_colour
from feedopt_tools.views.signals import Quantity, RunSignals, speed_pieces

WIDTH, HEIGHT = 1600, 900
_DPI = 100
_PIECES = 3000
_ROOM = 1.15
_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 11.0,
    "axes.titlesize": 12.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#9a9aa2",
    "axes.labelcolor": "#44444c",
    "xtick.color": "#66666e",
    "ytick.color": "#66666e",
    "grid.color": "#e6e6ea",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 10.0,
}


def draw_by_matplotlib(signals: RunSignals, picture: Path) -> None:
    """Write a PNG of 1600 x 900: coloured toolpath, feed over time and arc length, tracking error, control signal.

    Raises:
        OSError: the picture cannot be written.
    """
    picture.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(WIDTH / _DPI, HEIGHT / _DPI), dpi=_DPI, layout="constrained")
        figure.get_layout_engine().set(w_pad=0.12, h_pad=0.08)  # type: ignore[union-attr, call-arg]
        figure.suptitle(_title(signals), fontsize=14, fontweight="bold", x=0.012, ha="left")
        grid = figure.add_gridspec(6, 2, width_ratios=[1.0, 1.15])
        _toolpath(figure, figure.add_subplot(grid[:4, 0]), signals)
        _feed_over_arc_length(figure.add_subplot(grid[4:, 0]), signals)
        rows = [signals.quantities["tracking_error"], signals.quantities["control_signal"]]
        if all(row.measured is None and row.commanded is None for row in rows):
            rows = [signals.quantities["acceleration"], signals.quantities["jerk"]]
        first = figure.add_subplot(grid[:2, 1])
        _feed_over_time(first, signals)
        for place, quantity in enumerate(rows, start=1):
            axes = figure.add_subplot(grid[2 * place : 2 * place + 2, 1], sharex=first)
            _quantity(axes, signals, quantity)
        axes.set_xlabel("motion time, s")
        figure.savefig(picture, dpi=_DPI)


def _title(signals: RunSignals) -> str:
    run = signals.run
    parts = [run.title, f"{signals.s_mm[-1]:.1f} mm in {run.motion_time_s:.3f} s"]
    if run.machine is not None:
        parts.insert(1, run.machine.name)
    return "   ·   ".join(parts)


def _toolpath(figure: Figure, axes: Axes, signals: RunSignals) -> None:
    top = signals.top_feed_mm_s
    pieces = speed_pieces(signals.s_mm, _PIECES)
    fastest = np.array([np.max(signals.feedrate_mm_s[first : last + 1]) for first, last in pieces])
    plane = _seen_from_above(signals.tool_mm)
    strips = [plane[first : last + 1] for first, last in pieces]
    # Slow pieces last: where the path crosses itself, the slow one is the one to be seen.
    order = np.argsort(-fastest, kind="stable")
    colours = feed_colours(fastest, top)[order] / 255.0
    axes.add_collection(LineCollection([strips[i] for i in order], colors=colours, linewidths=2.0, capstyle="round"))
    axes.plot(*plane[0], "o", color=unit_colour(PATH), markersize=6, zorder=3)
    axes.annotate("start", plane[0], xytext=(7, 7), textcoords="offset points", color=unit_colour(PATH), fontsize=10)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    axes.autoscale_view()
    axes.grid(visible=True)
    axes.set_title("toolpath, mm")
    scale = ListedColormap(feed_colours(np.linspace(0.0, top, 256), top) / 255.0)
    bar = figure.colorbar(mpl.cm.ScalarMappable(Normalize(0.0, top), scale), ax=axes, pad=0.01, aspect=32)
    bar.set_label("feedrate, mm/s")
    bar.outline.set_visible(False)


def _seen_from_above(tool_mm: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The drawing plane: x and y, or an oblique view where the path is not flat."""
    size = np.ptp(tool_mm, axis=0)
    if size[2] < 0.02 * max(size[0], size[1]):
        return tool_mm[:, :2]
    across = tool_mm @ np.array([np.cos(0.5), -np.sin(0.5), 0.0])
    up = tool_mm @ np.array([0.5 * np.sin(0.5), 0.5 * np.cos(0.5), 0.87])
    return np.stack([across, up], axis=1)


def _feed_over_arc_length(axes: Axes, signals: RunSignals) -> None:
    _limit(axes, [signals.feed_limit_mm_s])
    axes.plot(signals.s_mm, signals.feedrate_mm_s, color=unit_colour(FEED), linewidth=1.6)
    axes.set_title("feedrate over arc length, mm/s")
    axes.set_xlabel("arc length, mm")
    axes.set_xlim(0.0, max(signals.s_mm[-1], 1e-9))
    _feed_range(axes, signals)


def _feed_over_time(axes: Axes, signals: RunSignals) -> None:
    _limit(axes, [signals.feed_limit_mm_s])
    if signals.programmed_mm_s is not None:
        programmed = np.minimum(signals.programmed_mm_s, signals.feed_limit_mm_s)
        axes.plot(signals.t_s, programmed, color=unit_colour(PATH), linewidth=1.0, label="programmed")
        axes.legend(loc="lower center")
    axes.plot(signals.t_s, signals.feedrate_mm_s, color=unit_colour(FEED), linewidth=1.6)
    axes.set_title("feedrate, mm/s")
    axes.set_xlim(signals.t_s[0], signals.t_s[-1])
    _feed_range(axes, signals)


def _feed_range(axes: Axes, signals: RunSignals) -> None:
    axes.set_ylim(0.0, _ROOM * float(np.nanmax([signals.top_feed_mm_s, signals.feed_limit_mm_s])))
    axes.grid(visible=True)


def _quantity(axes: Axes, signals: RunSignals, quantity: Quantity) -> None:
    names = signals.run.axis_names
    axes.set_title(quantity.title)
    axes.grid(visible=True)
    for axis, name in enumerate(names):
        colour = unit_colour(axis_colour(axis))
        if quantity.measured is not None:
            axes.plot(signals.state_t_s, quantity.measured[:, axis], color=colour, linewidth=1.4, label=name)
        if quantity.commanded is not None:
            alone = quantity.measured is None
            style: dict[str, Any] = {"color": colour, "linewidth": 1.4, "label": name}
            if not alone:
                style = {"color": "#303038", "linewidth": 0.8, "linestyle": (0, (4, 3)), "alpha": 0.8}
                style["label"] = "predicted by the model" if axis == len(names) - 1 else None
            axes.plot(signals.t_s, quantity.commanded[:, axis], **style)
    if quantity.limit is not None:
        # Equal limits of several axes are one line; different ones take the colour of their axis.
        if len(set(quantity.limit)) == 1:
            _limit(axes, [quantity.limit[0], -quantity.limit[0]])
        else:
            for axis, limit in enumerate(quantity.limit):
                _limit(axes, [limit, -limit], unit_colour(axis_colour(axis)))
    low, high = axes.get_ylim()
    axes.set_ylim(1.05 * low, 1.05 * high)
    axes.legend(loc="upper right", ncols=len(names) + 1, borderaxespad=0.0, bbox_to_anchor=(1.0, 1.16))


def _limit(axes: Axes, values: list[float], colour: tuple[float, float, float] | None = None) -> None:
    for value in values:
        if np.isfinite(value):
            axes.axhline(value, color=colour or unit_colour(LIMIT), linewidth=1.1, linestyle=(0, (6, 2)), zorder=1)
