"""Two runs in one Rerun recording: one path below the other, overlaid curves, and their differences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from feedopt_tools.views.colours import FEED, axis_colour
from feedopt_tools.views.rerun.curves import Curves, along_path, along_time, entity, times
from feedopt_tools.views.rerun.layout import blueprint, eye_over, path_view, x_axis
from feedopt_tools.views.rerun.paths import draw_tool
from feedopt_tools.views.rerun.recording import write_recording
from feedopt_tools.views.signals.comparison import ComparedCurve, Comparison, Overlay, comparison_markdown
from feedopt_tools.views.signals.path_colours import path_colourings

_FIRST, _SECOND = axis_colour(0), axis_colour(2)
_SHOWN_PATHS = ("feed", "limit")
_GROUPS = (
    ("Tracking error", "tracking_error"),
    ("Control signal", "control_signal"),
    ("Velocity", "velocity"),
    ("Acceleration", "acceleration"),
    ("Jerk", "jerk"),
)


def save_comparison(comparison: Comparison, path: Path, over: str = "arc-length") -> None:
    """Write two runs as one ``.rrd`` file with its layout.

    Args:
        comparison: the runs.
        path: the file to write.
        over: initial horizontal axis of the curves: ``time`` or ``arc-length``.

    Raises:
        ViewError: the file cannot be written.
    """
    name = " and ".join(comparison.names)
    layout = comparison_layout(comparison, over)
    write_recording(path, name, layout, lambda recording: draw_comparison(recording, comparison))


def draw_comparison(recording: rr.RecordingStream, comparison: Comparison) -> None:
    """Write both runs and their difference into a recording."""
    curves = Curves(recording)
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    top_mm_s = max(scene.signals.top_feed_mm_s for scene in (comparison.first, comparison.second))
    for place, scene in (("first", comparison.first), ("second", comparison.second)):
        for colouring in path_colourings(scene, top_mm_s):
            if colouring.key in _SHOWN_PATHS:
                curves.path(f"{place}/paths/{colouring.key}", colouring.strips, colouring.colours)
        draw_tool(curves, f"{place}/tool", scene)
    for curve in comparison.curves:
        _draw_overlay(curves, curve.key, comparison.names, curve.over_time, along_time(curve.over_time.at))
        _draw_overlay(curves, curve.key, comparison.names, curve.over_path, along_path(curve.over_path.at))
        if np.isfinite(curve.limit):
            ends = times(curve.over_time.at[[0, -1]], curve.over_path.at[[0, -1]])
            curves.limits(
                _path("both", curve.key) + "/limit", ends, [curve.limit, -curve.limit][: 1 if curve.key == "use" else 2]
            )
    reached = comparison.reached_s
    gained = 1e3 * reached.difference
    curves.curve("later/later", [along_path(reached.at)], gained, f"{comparison.names[1]} later by, ms", FEED)
    # Over time: distance on the path by which the second run is ahead.
    t_s = comparison.curves[0].over_time.at
    ahead = [np.interp(t_s, scene.signals.t_s, scene.signals.s_mm) for scene in (comparison.first, comparison.second)]
    curves.curve("ahead/ahead", [along_time(t_s)], ahead[1] - ahead[0], f"{comparison.names[1]} ahead by, mm", FEED)
    curves.text("summary", comparison_markdown(comparison), markdown=True)


def _draw_overlay(curves: Curves, key: str, names: tuple[str, str], overlay: Overlay, at: rr.TimeColumn) -> None:
    curves.curve(_path("both", key) + "/first", [at], overlay.first, names[0], _FIRST)
    curves.curve(_path("both", key) + "/second", [at], overlay.second, names[1], _SECOND)
    curves.curve(_path("difference", key), [at], overlay.difference, f"{names[1]} minus {names[0]}", FEED, 1.2)


def comparison_layout(comparison: Comparison, over: str) -> rrb.Blueprint:
    """Both paths and the figures on the left; overlaid curves with their differences on the right."""
    scenes = {"first": comparison.first, "second": comparison.second}
    eye = eye_over(comparison.first.signals.tool_mm)
    axis = x_axis(over, float(comparison.reached_s.at[-1]))
    top_mm_s = max(scene.signals.top_feed_mm_s for scene in scenes.values())
    groups = []
    for key in _SHOWN_PATHS:
        views = [
            path_view(f"{name}: {colouring.title}", [f"{place}/paths/{key}", f"{place}/tool"], eye)
            for (place, scene), name in zip(scenes.items(), comparison.names, strict=True)
            for colouring in path_colourings(scene, top_mm_s)
            if colouring.key == key
        ]
        if views:
            groups.append(rrb.Vertical(*views, name="Feed" if key == "feed" else "Active limit"))
    summary = rrb.TextDocumentView(origin="summary", name="Figures")
    left = rrb.Vertical(rrb.Tabs(*groups, active_tab=0), summary, row_shares=[9, 4])
    pages = [_feed_page(comparison, over, axis)]
    for title, prefix in _GROUPS:
        mine = [curve for curve in comparison.curves if curve.key.startswith(f"{prefix}/")]
        if mine:
            pages.append(rrb.Vertical(*(_overlay_row(curve, axis) for curve in mine), name=title))
    return blueprint(rrb.Horizontal(left, rrb.Tabs(*pages, active_tab=0), column_shares=[2, 3]), over)


def _feed_page(comparison: Comparison, over: str, axis: rrb.TimeAxis | None) -> rrb.Vertical:
    rows: list[rrb.View] = []
    for curve in comparison.curves:
        if curve.key in ("feed", "use"):
            title = curve.title[0].upper() + curve.title[1:]
            rows.append(_plot(_path("both", curve.key), title, axis, legend=True))
    rows.append(_plot("difference/feed", "Difference of feed, mm/s", axis))
    later = _plot("later", f"{comparison.names[1]} is later by, ms", axis)
    ahead = _plot("ahead", f"{comparison.names[1]} is ahead by, mm", axis)
    # Each of the two curves exists on one time line only.
    return rrb.Vertical(*rows, later if over == "arc-length" else ahead, name="Feed")


def _overlay_row(curve: ComparedCurve, axis: rrb.TimeAxis | None) -> rrb.Vertical:
    overlay = _plot(_path("both", curve.key), curve.title, axis, legend=True)
    return rrb.Vertical(overlay, _plot(_path("difference", curve.key), "difference", axis), row_shares=[3, 2])


def _plot(origin: str, name: str, axis: rrb.TimeAxis | None, *, legend: bool = False) -> rrb.TimeSeriesView:
    shown = rrb.PlotLegend(rrb.Corner2D.RightTop) if legend else rrb.PlotLegend(visible=False)
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=shown, axis_x=axis)


def _path(kind: str, key: str) -> str:
    return entity(kind, *key.split("/", 1))
