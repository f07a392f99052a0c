"""Sampling of path pieces, dense enough that no bend is missed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.compiled import compiled
from feedopt_core.geometry.toolpath import Toolpath

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
    """Points between edges: at least ``least`` per piece, more where the bend length is below 20 times their distance.

    Args:
        toolpath: holds the edges.
        edges_mm: increasing arc lengths, shape (pieces + 1,).
        least: points a piece.
    """
    probes = edges_mm[:-1, None] + _PROBES * np.diff(edges_mm)[:, None]
    first = _first_points(edges_mm, toolpath.bend_length_mm(probes.ravel()), least)
    owner, z = np.empty(first[-1], dtype=np.int64), np.empty(first[-1])
    _spread(first, owner, z)
    return Samples(owner, z, first[:-1])


@compiled
def _first_points(edges_mm: FloatArray, bend_mm: FloatArray, least: int) -> IntArray:
    """Index of the first point of each piece, and how many there are in all, shape (pieces + 1,)."""
    first = np.zeros(len(edges_mm), dtype=np.int64)
    probes = len(_PROBES)
    for piece in range(len(edges_mm) - 1):
        shortest = np.min(bend_mm[piece * probes : (piece + 1) * probes])
        count = math.ceil((edges_mm[piece + 1] - edges_mm[piece]) / (_BEND_SHARE * shortest))
        first[piece + 1] = first[piece] + min(max(count, least), _MOST)
    return first


@compiled
def _spread(first: IntArray, owner: IntArray, z: FloatArray) -> None:
    for piece in range(len(first) - 1):
        count = first[piece + 1] - first[piece]
        for i in range(count):
            owner[first[piece] + i] = piece
            z[first[piece] + i] = i / (count - 1)
