"""Colours of the path: by feed, binding limit, utilisation, tracking error and control signal; the enlarged error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray
from feedopt_tools.views.colours import FREE, feed_colours, limit_colour
from feedopt_tools.views.signals.contour import ContourError
from feedopt_tools.views.signals.scene import RunScene
from feedopt_tools.views.signals.signals import speed_pieces

PATH_PIECES = 3000
"""Most pieces that a path is coloured in."""


@dataclass(frozen=True)
class PathColouring:
    """The path in one colouring.

    Attributes:
        key: of the entity ``paths/<key>`` and of the view.
        title: of the view, with the value that is red; zero is blue.
        strips: pieces of the path, shape (n, 3) each.
        colours: one a piece, shape (pieces, 3).
        top: value of the last colour; NaN where the colours are no scale.
        label: what is coloured, with its unit.
    """

    key: str
    title: str
    strips: tuple[FloatArray, ...]
    colours: NDArray[np.uint8]
    top: float
    label: str


def path_colourings(scene: RunScene, top_feed_mm_s: float | None = None) -> tuple[PathColouring, ...]:
    """The path by feed, active limit, use of the closest limit, tracking error and control signal, as known.

    Args:
        scene: the run.
        top_feed_mm_s: feedrate of the last colour; None: the largest of the run.
    """
    signals, use = scene.signals, scene.limit_use
    top_feed = signals.top_feed_mm_s if top_feed_mm_s is None else top_feed_mm_s
    pieces = speed_pieces(signals.s_mm, PATH_PIECES)
    strips = tuple(signals.tool_mm[first : last + 1] for first, last in pieces)

    def scaled(key: str, short: str, what: str, unit: str, values: FloatArray, top: float) -> PathColouring:
        peaks = np.array([np.max(values[first : last + 1]) for first, last in pieces])
        return PathColouring(key, f"{short} {top:.3g} {unit}", strips, feed_colours(peaks, top), top, f"{what}, {unit}")

    found = [scaled("feed", "Feed", "feedrate", "mm/s", signals.feedrate_mm_s, top_feed)]
    if use.limits:
        found.append(PathColouring("limit", "Limit", strips, _limit_colours(scene, pieces), np.nan, "limit that binds"))
        found.append(scaled("use", "Use", "closest limit", "%", 100.0 * use.closest_ratio, 100.0))
    if (error_um := scene.error_um) is not None:
        found.append(scaled("error", "Error", "tracking error", "µm", error_um, max(float(np.max(error_um)), 1e-3)))
    if (volts := scene.control_volts) is not None:
        found.append(scaled("control", "Control", "control signal", "V", volts, max(float(np.max(volts)), 1e-3)))
    return tuple(found)


def _limit_colours(scene: RunScene, pieces: list[tuple[int, int]]) -> NDArray[np.uint8]:
    """Colour of the limit that binds most of each piece."""
    use = scene.limit_use
    palette = np.array([FREE, *(limit_colour(limit.key, limit.axis) for limit in use.limits)], dtype=np.uint8)
    most = [int(np.argmax(np.bincount(use.active[first : last + 1] + 1))) for first, last in pieces]
    return np.asarray(palette[most])


def contour_strips(contour: ContourError) -> tuple[list[FloatArray], NDArray[np.uint8], float]:
    """The actual path with its error exaggerated: strips, their colours by the size of the error, the largest in um."""
    rows = np.flatnonzero(np.concatenate([[True], np.diff(contour.s_mm) > 0.0]))
    exaggerated, size = contour.exaggerated_mm[rows], np.abs(contour.error_um)[rows]
    count = max(4, len(rows) // PATH_PIECES)
    pieces = [(i, min(i + count, len(rows) - 1)) for i in range(0, max(len(rows) - 1, 1), count)]
    strips = [exaggerated[first : last + 1] for first, last in pieces]
    peaks = np.array([np.max(size[first : last + 1]) for first, last in pieces])
    top_um = max(float(np.max(size)), 1e-3)
    return strips, feed_colours(peaks, top_um), top_um
