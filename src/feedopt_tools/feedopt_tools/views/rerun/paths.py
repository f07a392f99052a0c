"""Draws the toolpath in its colourings, the contour with its enlarged error, and the tool."""

from __future__ import annotations

import numpy as np
import rerun as rr

from feedopt_tools.views.colours import PATH, PROGRAMMED, RAPID
from feedopt_tools.views.rerun.curves import Curves, times
from feedopt_tools.views.signals.path_colours import PATH_PIECES, contour_strips, path_colourings
from feedopt_tools.views.signals.scene import RunScene
from feedopt_tools.views.signals.signals import speed_pieces

_TOOL_EVERY = 10


def draw_paths(curves: Curves, scene: RunScene) -> None:
    """Draw every colouring below ``paths/``, the contour below ``contour/``, and the moving tool."""
    signals, recording = scene.signals, curves.recording
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for colouring in path_colourings(scene):
        curves.path(f"paths/{colouring.key}", colouring.strips, colouring.colours)
    start = rr.Points3D(signals.tool_mm[:1], colors=[PATH], radii=rr.Radius.ui_points(4.0))
    recording.log("start", start, static=True)
    draw_tool(curves, "tool", scene)
    _draw_contour(curves, scene)


def draw_tool(curves: Curves, entity: str, scene: RunScene) -> None:
    """Draw the commanded position of the tool on both time lines."""
    signals, recording = scene.signals, curves.recording
    rows = np.arange(0, len(signals.t_s), _TOOL_EVERY)
    style = rr.Points3D.from_fields(colors=[(255, 255, 255)], radii=rr.Radius.ui_points(6.0))
    recording.log(entity, style, static=True)
    indexes = times(signals.t_s[rows], signals.s_mm[rows])
    recording.send_columns(entity, indexes=indexes, columns=rr.Points3D.columns(positions=signals.tool_mm[rows]))


def _draw_contour(curves: Curves, scene: RunScene) -> None:
    """Draw the programmed, the smoothed (commanded) and the actual path, the last with enlarged error."""
    programmed = list(zip(scene.programmed.strips, scene.programmed.rapid, strict=True))
    for kind, colour, wanted in (("programmed", PROGRAMMED, False), ("rapids", RAPID, True)):
        strips = [strip for strip, rapid in programmed if rapid == wanted]
        if strips:
            curves.path(f"contour/{kind}", strips, np.array([colour], dtype=np.uint8), 1.0)
            # The points show where the smoothed path is allowed to leave the straight lines between them.
            points = rr.Points3D(np.vstack(strips), colors=[colour], radii=rr.Radius.ui_points(2.0))
            curves.recording.log(f"contour/{kind}/points", points, static=True)
    signals = scene.signals
    pieces = speed_pieces(signals.s_mm, PATH_PIECES)
    strips = [signals.tool_mm[first : last + 1] for first, last in pieces]
    curves.path("contour/smoothed", strips, np.array([(232, 232, 236)], dtype=np.uint8), 1.0)
    if scene.contour is None:
        return
    strips, colours, _ = contour_strips(scene.contour)
    curves.path("contour/actual", strips, colours)
