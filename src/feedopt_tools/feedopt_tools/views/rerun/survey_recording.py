"""A program and its smoothed path as a Rerun recording that contains its layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from feedopt_tools.views.colours import FEED, LIMIT, PATH, PROGRAMMED, RAPID, axis_colour, feed_colours
from feedopt_tools.views.rerun.curves import Curves, along_path
from feedopt_tools.views.rerun.layout import blueprint, eye_over, path_view, x_axis
from feedopt_tools.views.rerun.recording import write_recording
from feedopt_tools.views.signals.survey_scene import SurveyScene, survey_rows

OVER = "arc-length"


def save_survey(scene: SurveyScene, path: Path) -> None:
    """Write an ``.rrd`` file that opens with its layout. Raises ViewError if it cannot be written."""
    write_recording(path, scene.name, survey_layout(scene), lambda recording: draw_survey(recording, scene))


def draw_survey(recording: rr.RecordingStream, scene: SurveyScene) -> None:
    """Write all entities of a program into a recording."""
    curves = Curves(recording)
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    programmed = list(zip(scene.programmed.strips, scene.programmed.rapid, strict=True))
    for kind, colour, wanted in (("programmed", PROGRAMMED, False), ("rapids", RAPID, True)):
        strips = [strip for strip, rapid in programmed if rapid == wanted]
        if strips:
            curves.path(f"paths/{kind}", strips, np.array([colour], dtype=np.uint8), 1.0)
    if len(scene.points_mm):
        points = rr.Points3D(scene.points_mm, colors=[PROGRAMMED], radii=rr.Radius.ui_points(2.2))
        recording.log("paths/points", points, static=True)
    curves.path("paths/smoothed", scene.strips_mm, np.array([FEED], dtype=np.uint8), 1.6)
    recording.log("start", rr.Points3D(scene.path_mm[:1], colors=[PATH], radii=rr.Radius.ui_points(4.0)), static=True)
    _draw_tool(curves, scene)
    # Curvatures extend over several decades, so the colours follow their fourth root.
    peaks = scene.peak_per_mm**0.25
    curves.path("curvature_path", scene.strips_mm, feed_colours(peaks, max(float(np.max(peaks)), 1e-9)))
    if scene.deviation is not None:
        at = [along_path(scene.deviation.s_mm)]
        curves.curve("deviation/deviation", at, 1e3 * scene.deviation.deviation_mm, "deviation, µm", FEED)
        limit = 1e3 * scene.deviation.tolerance_mm
        curves.curve("deviation/tolerance", at, limit, "tolerance, µm", LIMIT, 1.0, steps=True)
    curves.curve("curvature/curvature", [along_path(scene.s_mm)], scene.curvature_per_mm, "curvature", axis_colour(2))
    starts = [along_path(scene.segment_s_mm)]
    curves.curve("programmed_feed/feed", starts, scene.feed_mm_s, "programmed feed", axis_colour(1), steps=True)
    rows = "".join(f"| {name} | {text} |\n" for name, text in survey_rows(scene.figures))
    curves.text("summary", f"# {scene.name}\n\n| | |\n|---|---|\n{rows}", markdown=True)


def survey_layout(scene: SurveyScene) -> rrb.Blueprint:
    """The paths and the figures on the left, the curves along the path on the right."""
    eye = eye_over(scene.path_mm)
    axis = x_axis(OVER, float(scene.s_mm[-1]))
    paths = rrb.Tabs(
        path_view("Programmed (grey; rapids blue) and smoothed", ["paths/**", "start", "tool"], eye),
        path_view("Curvature", ["curvature_path", "start", "tool"], eye),
        active_tab=0,
    )
    left = rrb.Vertical(paths, rrb.TextDocumentView(origin="summary", name="Figures"), row_shares=[7, 5])
    hidden = rrb.PlotLegend(visible=False)
    views: list[rrb.View] = [
        rrb.TimeSeriesView(origin="curvature", name="Curvature along the path, 1/mm", plot_legend=hidden, axis_x=axis)
    ]
    if scene.deviation is not None:
        top = 1.15e3 * float(np.max(scene.deviation.tolerance_mm))
        title = "Deviation between smoothed and programmed path, and its tolerance, µm"
        views.insert(
            0,
            rrb.TimeSeriesView(
                origin="deviation",
                name=title,
                plot_legend=hidden,
                axis_x=axis,
                axis_y=rrb.ScalarAxis(range=(-0.04 * top, top)),
            ),
        )
    if np.any(np.isfinite(scene.feed_mm_s)):
        views.append(
            rrb.TimeSeriesView(origin="programmed_feed", name="Programmed feed, mm/s", plot_legend=hidden, axis_x=axis)
        )
    return blueprint(rrb.Horizontal(left, rrb.Vertical(*views), column_shares=[4, 5]), OVER)


def _draw_tool(curves: Curves, scene: SurveyScene) -> None:
    """Draw a point on the path that follows the cursor, at the start of each segment."""
    style = rr.Points3D.from_fields(colors=[(255, 255, 255)], radii=rr.Radius.ui_points(6.0))
    curves.recording.log("tool", style, static=True)
    at = [along_path(scene.segment_s_mm[:-1])]
    places = np.stack([strip[0] for strip in scene.strips_mm])
    curves.recording.send_columns("tool", indexes=at, columns=rr.Points3D.columns(positions=places))
