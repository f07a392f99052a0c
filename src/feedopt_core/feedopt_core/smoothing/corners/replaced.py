"""The part of the path that a blend replaces, and the distance of the blend from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.compiled import compiled
from feedopt_core.smoothing.path_element import PathElement, sampled

_CONTINUED = 4.0
"""Length of curve, in tolerances, next to a cut, within which a programmed spike may lie."""
_SPIKE = 30.0
"""Length, in tolerances, by which the programmed path may be longer than the curve that replaces it."""


@dataclass(frozen=True)
class Replaced:
    """Part of an element that a cut removes.

    Attributes:
        programmed_mm: points of the programmed path, slightly beyond the cut, in the direction of motion.
        continuation_mm: points next to the cut on the curve that remains, in the direction of motion; may be empty.
    """

    programmed_mm: FloatArray
    continuation_mm: FloatArray


def replaced_end(element: PathElement, cut_mm: float, tolerance_mm: float) -> Replaced:
    """The end of an element that a cut removes."""
    at_mm = element.length_mm - cut_mm
    if element.programmed_end_mm is None:
        return Replaced(
            sampled(element.curve, at_mm, element.length_mm, tolerance_mm), np.empty((0, element.dimensions))
        )
    stays = element.curve.evaluate(np.linspace(max(0.0, at_mm - _CONTINUED * tolerance_mm), at_mm, 9)).r_mm
    return Replaced(_up_to(element.programmed_end_mm[::-1], stays[-1], cut_mm, tolerance_mm)[::-1], stays[:-1])


def replaced_start(element: PathElement, cut_mm: float, tolerance_mm: float) -> Replaced:
    """The start of an element that a cut removes."""
    if element.programmed_start_mm is None:
        return Replaced(sampled(element.curve, 0.0, cut_mm, tolerance_mm), np.empty((0, element.dimensions)))
    end_mm = min(element.length_mm, cut_mm + _CONTINUED * tolerance_mm)
    stays = element.curve.evaluate(np.linspace(cut_mm, end_mm, 9)).r_mm
    return Replaced(_up_to(element.programmed_start_mm, stays[0], cut_mm, tolerance_mm), stays[1:])


def _up_to(points_mm: FloatArray, cut_point_mm: FloatArray, cut_mm: float, tolerance_mm: float) -> FloatArray:
    """First part of a polyline, up to the last place that may correspond to a point of its curve.

    A polyline with spikes may be much longer than its curve, so the place is found by distance.
    """
    steps = np.diff(points_mm, axis=0)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    count = int(np.searchsorted(lengths, 3.0 * cut_mm + _SPIKE * tolerance_mm))
    steps = steps[:count]
    offsets = cut_point_mm - points_mm[: len(steps)]
    squares = np.maximum(np.einsum("md,md->m", steps, steps), np.finfo(np.float64).tiny)
    along = np.clip(np.einsum("md,md->m", offsets, steps) / squares, 0.0, 1.0)
    distances = np.linalg.norm(offsets - along[:, None] * steps, axis=1)
    last = int(np.flatnonzero(distances <= np.min(distances) + 0.5 * tolerance_mm)[-1])
    end_mm = points_mm[last] + along[last] * steps[last]
    return np.concatenate([points_mm[: last + 1], end_mm[None, :]])


def two_way_distance(points_mm: FloatArray, replaced_mm: FloatArray, continued_mm: FloatArray) -> float:
    """Largest distance between two polylines: from the inner points of each one to the other.

    Args:
        points_mm: the one polyline, shape (n, d).
        replaced_mm: the other one, shape (m, d).
        continued_mm: the first one with what continues it at both ends, shape (k, d).
    """
    return max(_largest_distance(points_mm, replaced_mm), _largest_distance(replaced_mm, continued_mm))


@compiled
def _largest_distance(points: FloatArray, chain: FloatArray) -> float:
    """Largest distance of the inner points from the chain."""
    largest = 0.0
    for i in range(1, len(points) - 1):
        nearest = np.inf
        for j in range(len(chain) - 1):
            square = 0.0
            along = 0.0
            for d in range(points.shape[1]):
                step = chain[j + 1, d] - chain[j, d]
                square += step * step
                along += step * (points[i, d] - chain[j, d])
            share = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
            distance = 0.0
            for d in range(points.shape[1]):
                step = chain[j + 1, d] - chain[j, d]
                off = points[i, d] - chain[j, d] - share * step
                distance += off * off
            nearest = min(nearest, distance)
        largest = max(largest, nearest)
    return float(np.sqrt(largest))
