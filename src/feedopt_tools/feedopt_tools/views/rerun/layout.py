"""Layout of the views of a run in Rerun, the most important first."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import rerun.blueprint as rrb

from feedopt_core.arrays import FloatArray
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
    pages_of,
)
from feedopt_tools.views.rerun.curves import ARC_LENGTH, TIME, entity
from feedopt_tools.views.signals.path_colours import path_colourings
from feedopt_tools.views.signals.scene import RunScene
from feedopt_tools.views.signals.signals import Quantity

GROUND = (22, 24, 28)
TIME_LINES = {"time": TIME, "arc-length": ARC_LENGTH}
_ROOM = 1.12
_VIEW_ASPECT = 1.33
_EYE_DISTANCE = 1.15


def run_layout(scene: RunScene, page: Page = MOTION, over: str = "time") -> rrb.Blueprint:
    """The path in its colourings and the figures on the left, the pages on the right.

    Args:
        scene: the run.
        page: the page shown first.
        over: horizontal axis of the curves, ``time`` or ``arc-length``.
    """
    run = scene.signals.run
    paths = _paths(scene)
    in_front = page.path if page.path in paths else next(iter(paths))
    documents: list[rrb.View] = [rrb.TextDocumentView(origin="summary", name=run.title)]
    if run.provenance.get("feedopt/program", {}).get("text"):
        documents.append(rrb.TextDocumentView(origin="program", name="Program"))
    space = rrb.Tabs(*paths.values(), active_tab=list(paths).index(in_front))
    left = rrb.Vertical(space, rrb.Tabs(*documents, active_tab=0), row_shares=[8, 5])
    rights = _Pages(scene, over).all()
    shown = page if page in rights else MOTION
    right = rrb.Tabs(*rights.values(), active_tab=list(rights).index(shown))
    return blueprint(rrb.Horizontal(left, right, column_shares=[4, 5]), over)


def blueprint(root: rrb.Container, over: str) -> rrb.Blueprint:
    """A layout with all panels collapsed except the time line."""
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIME_LINES[over]),
        auto_layout=False,
        auto_views=False,
    )


def _paths(scene: RunScene) -> dict[str, rrb.Spatial3DView]:
    eye = eye_over(scene.signals.tool_mm)
    views = {
        colouring.key: path_view(colouring.title, [f"paths/{colouring.key}", "start", "tool"], eye)
        for colouring in path_colourings(scene)
    }
    if scene.contour is not None or scene.programmed.strips:
        factor = f" {scene.contour.factor:g}x" if scene.contour is not None else ""
        views["contour"] = path_view(f"Contour{factor}", ["contour/**"], eye)
    return views


def path_view(name: str, contents: list[str], eye: rrb.EyeControls3D) -> rrb.Spatial3DView:
    """A 3D view; all paths of a run have the same point of view."""
    return rrb.Spatial3DView(
        origin="/", contents=contents, name=name, background=GROUND, line_grid=False, eye_controls=eye
    )


class _Pages:
    """The pages of one run on one time line."""

    def __init__(self, scene: RunScene, over: str) -> None:
        self.scene = scene
        self.signals = scene.signals
        self.x_axis = x_axis(over, float(scene.signals.s_mm[-1]))

    def all(self) -> dict[Page, rrb.Container]:
        """Every page for which this run has data."""
        makers: dict[Page, Callable[[], rrb.Container]] = {
            MOTION: self._motion,
            ACTIVE_LIMIT: self._active_limit,
            AXIS_LIMITS: lambda: self._rows(AXIS_LIMITS, AXIS_QUANTITIES),
            TRACKING: lambda: self._rows(TRACKING, TRACKING_QUANTITIES),
            CONTOUR: self._contour,
            PLANNER: self._planner,
            EVENTS: self._events,
        }
        return {page: makers[page]() for page in pages_of(self.scene)}

    def _plot(self, origin: str, name: str, legend: rrb.Corner2D | None = None, **more: Any) -> rrb.TimeSeriesView:
        shown = rrb.PlotLegend(visible=False) if legend is None else rrb.PlotLegend(legend)
        return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=shown, axis_x=self.x_axis, **more)

    def _motion(self) -> rrb.Vertical:
        error, control = (self.signals.quantities[key] for key in ("tracking_error", "control_signal"))
        rows = [self._axis_views(quantity) for quantity in (error, control) if quantity.drawn]
        # The title explains the colour, because a legend would cover the curves.
        compared = any(row.commanded is not None and row.measured is not None for row in (error, control))
        name = f"{MOTION.title} (white: predicted)" if compared else MOTION.title
        return rrb.Vertical(self._feed(), *rows, name=name)

    def _feed(self) -> rrb.TimeSeriesView:
        signals = self.signals
        feed_top = np.nanmax([signals.top_feed_mm_s, _finite(signals.feed_limit_mm_s)])
        axis = rrb.ScalarAxis(range=(-0.04 * feed_top, _ROOM * feed_top))
        legend = rrb.Corner2D.RightTop if signals.programmed_mm_s is not None else None
        return self._plot("feed", "Feedrate and its limit, mm/s", legend, axis_y=axis)

    def _active_limit(self) -> rrb.Vertical:
        axes = dict.fromkeys(limit.axis for limit in self.scene.limit_use.limits if limit.axis is not None)
        places = [self.signals.run.axis_names[axis] for axis in axes]
        rows = [
            self._plot(
                "/",
                f"Use of the limits of {place}, %",
                rrb.Corner2D.RightTop,
                contents=[entity("use", place) + "/**", "use/limit"],
                axis_y=rrb.ScalarAxis(range=(-4.0, 114.0)),
            )
            for place in places
        ]
        lane = rrb.StateTimelineView(
            origin="active", name="Active limit (grey: none above 95 %)", time_view=self.x_axis
        )
        return rrb.Vertical(lane, *rows, self._feed(), row_shares=[0.8, *[2] * len(rows), 1.4], name=ACTIVE_LIMIT.title)

    def _rows(self, page: Page, keys: tuple[str, ...]) -> rrb.Vertical:
        quantities = [self.signals.quantities[key] for key in keys]
        return rrb.Vertical(*(self._axis_views(row) for row in quantities if row.drawn), name=page.title)

    def _contour(self) -> rrb.Vertical:
        side = ", above zero to the left of travel" if np.ptp(self.signals.tool_mm[:, 2]) == 0.0 else ""
        error = self.signals.quantities["tracking_error"]
        return rrb.Vertical(
            self._plot("contour_error", f"Contour error, µm{side}"),
            self._plot("lag", "Lag along the path, µm"),
            *([self._axis_views(error)] if error.drawn else []),
            name=CONTOUR.title,
        )

    def _planner(self) -> rrb.Vertical:
        windows = "Windows: end of the committed part, stop, and motion, mm"
        views = [
            self._plot("windows", windows, rrb.Corner2D.LeftTop),
            self._plot("planner", "Computing time of each window, ms", rrb.Corner2D.RightTop),
            self._plot("planner_share", "Computing time / committed motion time, %"),
        ]
        if self.scene.reserve is not None:
            views.append(self._plot("reserve", "Plan ahead of the motion, s"))
        percent = rrb.ScalarAxis(range=(0.0, 110.0))
        views.append(self._plot("certificate", "Closest limit of each window, %", axis_y=percent))
        return rrb.Vertical(*views, name=PLANNER.title)

    def _events(self) -> rrb.Vertical:
        views: list[rrb.View] = [self._plot("interpolator", "Lateness of the set points, ms")]
        shares = [2.0]
        if self.signals.run.segments:
            views.append(self._plot("program_line", "Line of the program"))
            shares.append(1.6)
        if self.scene.states:
            views.append(rrb.StateTimelineView(origin="nodes", name="States of the nodes", time_view=self.x_axis))
            shares.append(3.0)
        log = rrb.TextLogView(origin="events", name="Events")
        return rrb.Vertical(*views, log, row_shares=[*shares, 2.6], name=EVENTS.title)

    def _axis_views(self, quantity: Quantity) -> rrb.Horizontal:
        name, unit = quantity.title.split(", ")
        views = []
        for axis, axis_name in enumerate(self.signals.run.axis_names):
            top = _ROOM * _top(quantity, axis)
            title = f"{axis_name}: {name}, {unit}"
            views.append(self._plot(entity(quantity.key, axis_name), title, axis_y=rrb.ScalarAxis(range=(-top, top))))
        return rrb.Horizontal(*views)


def x_axis(over: str, end_mm: float) -> rrb.TimeAxis | None:
    """Axis over the whole path for curves over arc length; without it the plots open on a part of the path."""
    if over == "time":
        return None
    boundary = rrb.TimeRangeBoundary.absolute
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=boundary(seq=0), end=boundary(seq=round(1e3 * end_mm))))


def _top(quantity: Quantity, axis: int) -> float:
    values = [values[:, axis] for values in (quantity.commanded, quantity.measured) if values is not None]
    peak = max((float(np.max(np.abs(row))) for row in values), default=0.0)
    limit = quantity.limit_of(axis)
    return max(peak, limit if np.isfinite(limit) else 0.0, 1e-9)


def _finite(value: float) -> float:
    return value if np.isfinite(value) else float("nan")


def eye_over(tool_mm: FloatArray) -> rrb.EyeControls3D:
    """Point of view from above and the front; for a flat path from above, as in a drawing."""
    low, high = tool_mm.min(axis=0), tool_mm.max(axis=0)
    middle, size = (low + high) / 2.0, high - low
    flat = size[2] < 0.02 * max(size[0], size[1])
    direction = np.array([0.0, 0.0, 1.0]) if flat else np.array([0.35, -0.8, 0.75])
    # The vertical field of view is slightly above 50 degrees; the view is a third wider than high.
    extent = max(size[0] / _VIEW_ASPECT, size[1]) if flat else 0.8 * float(np.linalg.norm(size))
    eye = middle + _EYE_DISTANCE * max(extent, 1.0) * direction / np.linalg.norm(direction)
    return rrb.EyeControls3D(position=eye, look_target=middle, eye_up=(0.0, 1.0, 0.0) if flat else (0.0, 0.0, 1.0))
