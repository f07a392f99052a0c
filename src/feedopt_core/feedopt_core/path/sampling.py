"""How densely a piece of path must be looked at so that no bend is stepped over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.path.toolpath import Toolpath

_PROBES = np.linspace(0.01, 0.99, 7)
_BEND_SHARE = 0.05
_MOST = 512


@dataclass(frozen=True)
class Samples:
    """Points inside the pieces between edges, piece by piece, both ends of each included.

    Attributes:
        owner: piece of each point, shape (n,), not decreasing.
        z: place within it, 0 to 1, shape (n,).
        first: index of the first point of each piece, shape (pieces,).
    """

    owner: IntArray
    z: FloatArray
    first: IntArray


def samples_between(toolpath: Toolpath, edges_mm: FloatArray, least: int) -> Samples:
    """Points between edges: at least so many a piece, more where the path bends over less than 20 times their distance.

    Args:
        toolpath: holds the edges.
        edges_mm: increasing arc lengths, shape (pieces + 1,).
        least: points a piece.
    """
    widths = np.diff(edges_mm)
    probes = edges_mm[:-1, None] + _PROBES * widths[:, None]
    bend = np.min(toolpath.bend_length_mm(probes.ravel()).reshape(probes.shape), axis=1)
    counts = np.clip(np.ceil(widths / (_BEND_SHARE * bend)), least, _MOST).astype(np.int64)
    first = np.cumsum(counts) - counts
    owner = np.repeat(np.arange(len(counts)), counts)
    return Samples(owner, (np.arange(len(owner)) - first[owner]) / (counts[owner] - 1), first)
