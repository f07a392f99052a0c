"""Colours shared by Rerun views and pictures, readable on dark and on white."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray

FEED_MAP = "turbo"
AXES = ((224, 92, 72), (64, 164, 96), (76, 132, 224), (176, 112, 208), (208, 160, 48), (64, 176, 184))
FEED = (236, 168, 52)
PREDICTED = (216, 216, 224)
LIMIT = (200, 60, 110)
PATH = (120, 120, 130)
PROGRAMMED = (150, 150, 160)
RAPID = (96, 128, 176)
FREE = (104, 104, 112)
_LIMIT_KINDS = {
    "feedrate": (236, 168, 52),
    "velocity": (64, 176, 92),
    "acceleration": (72, 132, 236),
    "jerk": (214, 76, 160),
    "control_signal": (232, 92, 60),
    "tracking_error": (148, 104, 228),
}
# The hue identifies the quantity, the lightness the axis.
_LIGHTER = (0.0, 0.42, -0.4, 0.68, -0.6, 0.21)


def axis_colour(axis: int) -> tuple[int, int, int]:
    """Colour of an axis, given its index in the machine file."""
    return AXES[axis % len(AXES)]


def limit_colour(key: str, axis: int | None) -> tuple[int, int, int]:
    """Colour of a limit: the hue is the quantity, the lightness the axis."""
    lighter = _LIGHTER[(axis or 0) % len(_LIGHTER)]
    towards = 255 if lighter > 0.0 else 0
    red, green, blue = (round(part + abs(lighter) * (towards - part)) for part in _LIMIT_KINDS[key])
    return red, green, blue


def feed_colours(feedrate_mm_s: FloatArray, top_mm_s: float) -> NDArray[np.uint8]:
    """Colours of feedrates from standstill to ``top_mm_s``, shape (n, 3)."""
    # The ends of the colour map are too dark for a dark background.
    place = 0.08 + 0.84 * np.clip(feedrate_mm_s / top_mm_s, 0.0, 1.0)
    return np.asarray(np.round(255.0 * mpl.colormaps[FEED_MAP](place)[:, :3]), dtype=np.uint8)


def unit_colour(colour: tuple[int, int, int]) -> tuple[float, float, float]:
    """The colour with components from 0 to 1, as matplotlib expects."""
    return (colour[0] / 255.0, colour[1] / 255.0, colour[2] / 255.0)
