"""How the views of a run are laid out: what a motion engineer looks at first is seen first."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from feedopt_tools.views.signals import Quantity, RunSignals

GROUND = (22, 24, 28)
_ROOM = 1.12
_VIEW_ASPECT = 1.33
_EYE_DISTANCE = 1.15


def run_layout(signals: RunSignals) -> rrb.Blueprint:
    """Toolpath and figures on the left; on the right feed, tracking error and control signal, then the axis limits."""
    path = rrb.Spatial3DView(
        origin="/",
        contents=["toolpath", "start", "tool"],
        name="Toolpath, coloured by feed",
        background=GROUND,
        line_grid=False,
        eye_controls=_eye(signals),
    )
    summary = rrb.TextDocumentView(origin="summary", name=signals.run.title)
    documents: list[rrb.View] = [summary]
    if "feedopt/program" in signals.run.provenance:
        documents.append(rrb.TextDocumentView(origin="program", name="Program"))
    left = rrb.Vertical(path, rrb.Tabs(*documents, active_tab=0), row_shares=[8, 5])
    right = rrb.Tabs(_motion(signals), _limits(signals), _computer(signals), active_tab=0)
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[2, 3]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="motion_time"),
        auto_layout=False,
        auto_views=False,
    )


def _motion(signals: RunSignals) -> rrb.Vertical:
    feed_top = np.nanmax([signals.top_feed_mm_s, signals.feed_limit_mm_s])
    axis = rrb.ScalarAxis(range=(-0.04 * feed_top, _ROOM * feed_top))
    legend = rrb.PlotLegend(visible=signals.programmed_mm_s is not None)
    feed = rrb.TimeSeriesView(origin="feed", name="Feedrate and its limit, mm/s", axis_y=axis, plot_legend=legend)
    error, control = signals.quantities["tracking_error"], signals.quantities["control_signal"]
    rows = [_axis_views(signals, quantity) for quantity in (error, control) if _drawn(quantity)]
    # Told in the title: a legend would cover what it explains.
    compared = any(quantity.commanded is not None and quantity.measured is not None for quantity in (error, control))
    return rrb.Vertical(feed, *rows, name="Motion (white: predicted)" if compared else "Motion")


def _limits(signals: RunSignals) -> rrb.Vertical:
    rows = [_axis_views(signals, signals.quantities[key]) for key in ("velocity", "acceleration", "jerk")]
    return rrb.Vertical(*rows, name="Axis limits")


def _computer(signals: RunSignals) -> rrb.Vertical:
    lateness = "Lateness of the set points, ms"
    views = [rrb.TimeSeriesView(origin="interpolator", name=lateness, plot_legend=rrb.PlotLegend(visible=False))]
    if signals.run.chunks:
        views += [
            rrb.TimeSeriesView(
                origin="planner", name="Planning time of each chunk, ms", plot_legend=rrb.Corner2D.RightTop
            ),
            rrb.TimeSeriesView(
                origin="certificate",
                name="Closest limit of each chunk, %",
                axis_y=rrb.ScalarAxis(range=(0.0, 110.0)),
                plot_legend=rrb.PlotLegend(visible=False),
            ),
        ]
    return rrb.Vertical(*views, name="Computer")


def _axis_views(signals: RunSignals, quantity: Quantity) -> rrb.Horizontal:
    name, unit = quantity.title.split(", ")
    views = []
    for axis, axis_name in enumerate(signals.run.axis_names):
        top = _top(quantity, axis)
        views.append(
            rrb.TimeSeriesView(
                origin=f"{quantity.key}/{axis_name}",
                name=f"{axis_name}: {name}, {unit}",
                axis_y=rrb.ScalarAxis(range=(-_ROOM * top, _ROOM * top)),
                plot_legend=rrb.PlotLegend(visible=False),
            )
        )
    return rrb.Horizontal(*views)


def _drawn(quantity: Quantity) -> bool:
    return quantity.commanded is not None or quantity.measured is not None


def _top(quantity: Quantity, axis: int) -> float:
    values = [values[:, axis] for values in (quantity.commanded, quantity.measured) if values is not None]
    peak = max((float(np.max(np.abs(row))) for row in values), default=0.0)
    return max(peak, quantity.limit[axis] if quantity.limit else 0.0, 1e-9)


def _eye(signals: RunSignals) -> rrb.EyeControls3D:
    """From above and the front; straight down where the path is flat, so that it reads as a drawing."""
    low, high = signals.tool_mm.min(axis=0), signals.tool_mm.max(axis=0)
    middle, size = (low + high) / 2.0, high - low
    flat = size[2] < 0.02 * max(size[0], size[1])
    direction = np.array([0.0, 0.0, 1.0]) if flat else np.array([0.35, -0.8, 0.75])
    # The eye opens a little more than 50 degrees from bottom to top, in a view a third wider than high.
    extent = max(size[0] / _VIEW_ASPECT, size[1]) if flat else 0.8 * float(np.linalg.norm(size))
    eye = middle + _EYE_DISTANCE * max(extent, 1.0) * direction / np.linalg.norm(direction)
    return rrb.EyeControls3D(position=eye, look_target=middle, eye_up=(0.0, 1.0, 0.0) if flat else (0.0, 0.0, 1.0))
