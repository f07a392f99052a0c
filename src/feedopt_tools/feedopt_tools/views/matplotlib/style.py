"""Style and shared parts of the pictures by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray
from feedopt_tools.views.colours import LIMIT, PATH, unit_colour
from feedopt_tools.views.signals.scene import RunScene
from feedopt_tools.views.signals.signals import RunSignals
from feedopt_tools.views.small_png import small_png

WIDTH, HEIGHT = 1600, 900
_DPI = 100
_COLUMNS = 1500
STYLE: dict[Any, Any] = {
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


def page_figure(title: str) -> Figure:
    """An empty page of 1600 x 900 with its title; call it inside ``rc_context(STYLE)``."""
    figure = Figure(figsize=(WIDTH / _DPI, HEIGHT / _DPI), dpi=_DPI, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.08)  # type: ignore[union-attr, call-arg]
    figure.suptitle(title, fontsize=14, fontweight="bold", x=0.012, ha="left")
    return figure


def run_title(signals: RunSignals) -> str:
    """Program, machine, length and time of a run."""
    run = signals.run
    parts = [run.title, f"{signals.s_mm[-1]:.1f} mm in {run.motion_time_s:.3f} s"]
    if run.machine is not None:
        parts.insert(1, run.machine.name)
    return "   ·   ".join(parts)


def write_figure(figure: Figure, picture: Path) -> None:
    """Write a small PNG. Raises OSError."""
    picture.parent.mkdir(parents=True, exist_ok=True)
    picture.write_bytes(png_of(figure))


def png_of(figure: Figure) -> bytes:
    """The figure as a small PNG."""
    image = io.BytesIO()
    figure.savefig(image, dpi=_DPI, format="png")
    return small_png(image.getvalue())


def thinned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A curve reduced to the minimum and maximum of each of 1500 groups of points: keeps all peaks, shape (k,) each."""
    group = len(x) // _COLUMNS
    if group < 3:
        return x, y
    whole = group * (len(x) // group)
    blocks = np.nan_to_num(y[:whole]).reshape(-1, group)
    extremes = np.sort(np.stack([np.argmin(blocks, axis=1), np.argmax(blocks, axis=1)], axis=1), axis=1)
    rows = np.concatenate([(extremes + group * np.arange(len(blocks))[:, None]).ravel(), [len(x) - 1]])
    return x[rows], y[rows]


def curve(axes: Axes, x: FloatArray, y: FloatArray, **style: Any) -> None:
    """Draw a curve of any length."""
    axes.plot(*thinned(x, y), **{"linewidth": 1.2, **style})


def limit_line(axes: Axes, values: Sequence[float], colour: tuple[float, float, float] | None = None) -> None:
    """Straight lines at limits; no line for a missing limit."""
    for value in values:
        if np.isfinite(value):
            axes.axhline(value, color=colour or unit_colour(LIMIT), linewidth=1.1, linestyle=(0, (6, 2)), zorder=1)


def seen_from_above(tool_mm: FloatArray) -> FloatArray:
    """Points in the drawing plane: x and y, or an oblique view if the path is not flat, shape (n, 2)."""
    size = np.ptp(tool_mm, axis=0)
    if size[2] < 0.02 * max(size[0], size[1]):
        return tool_mm[:, :2]
    across = tool_mm @ np.array([np.cos(0.5), -np.sin(0.5), 0.0])
    up = tool_mm @ np.array([0.5 * np.sin(0.5), 0.5 * np.cos(0.5), 0.87])
    return np.stack([across, up], axis=1)


def path_axes(axes: Axes, scene: RunScene, strips: Sequence[FloatArray], colours: NDArray[np.uint8]) -> None:
    """A coloured path with its start, axes of equal scale."""
    plane = [seen_from_above(strip) for strip in strips]
    axes.add_collection(LineCollection(plane, colors=colours / 255.0, linewidths=2.0, capstyle="round"))
    start = seen_from_above(scene.signals.tool_mm)[0]
    axes.plot(*start, "o", color=unit_colour(PATH), markersize=6, zorder=3)
    axes.annotate("start", start, xytext=(7, 7), textcoords="offset points", color=unit_colour(PATH), fontsize=10)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    axes.autoscale_view()
    axes.grid(visible=True)


def colour_scale(figure: Figure, axes: Axes, colours: NDArray[np.uint8], top: float, label: str) -> None:
    """A colour bar beside a path, from zero to ``top``."""
    scale = mpl.colors.ListedColormap(colours / 255.0)
    bar = figure.colorbar(mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, top), scale), ax=axes, pad=0.01, aspect=32)
    bar.set_label(label)
    bar.outline.set_visible(False)
