"""Colours that Rerun and the pictures share, readable on dark and on white."""

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


def axis_colour(axis: int) -> tuple[int, int, int]:
    """Colour of an axis by its place in the machine file."""
    return AXES[axis % len(AXES)]


def feed_colours(feedrate_mm_s: FloatArray, top_mm_s: float) -> NDArray[np.uint8]:
    """Colours of feedrates from standstill to ``top_mm_s``, shape (n, 3)."""
    # The ends of the map are too dark to be seen on a dark ground.
    place = 0.08 + 0.84 * np.clip(feedrate_mm_s / top_mm_s, 0.0, 1.0)
    return np.asarray(np.round(255.0 * mpl.colormaps[FEED_MAP](place)[:, :3]), dtype=np.uint8)


def unit_colour(colour: tuple[int, int, int]) -> tuple[float, float, float]:
    """The colour in parts of one, as matplotlib takes it."""
    return (colour[0] / 255.0, colour[1] / 255.0, colour[2] / 255.0)
