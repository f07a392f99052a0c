"""Divides a path into straight chords, by a tolerance and by the changes of the feed."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.toolpath import Toolpath

_SAMPLES_A_CHORD = 8
_LEAST_PIECE_MM = 1e-6
_SPARE = 0.9
_INSIDE_RATIO = 1e-6


def chord_ends_mm(toolpath: Toolpath, tolerance_mm: float, longest_mm: float) -> FloatArray:
    """Arc lengths of the ends of chords, increasing, shape (n,).

    A chord of length h over curvature k leaves the path by ``h^2 k / 8``. Joints of the path are ends.

    Args:
        toolpath: complete path.
        tolerance_mm: largest distance of a chord from the path.
        longest_mm: longest chord.
    """
    start_mm, end_mm = toolpath.start_mm, toolpath.end_mm
    joints = [segment.place.s_start_mm for segment in toolpath.segments]
    joints = [s for s in joints if start_mm + _LEAST_PIECE_MM < s < end_mm - _LEAST_PIECE_MM]
    ends = [np.array([start_mm])]
    for first, last in zip([start_mm, *joints], [*joints, end_mm], strict=True):
        count = max(2, int(np.ceil((last - first) / longest_mm)) * _SAMPLES_A_CHORD)
        s = np.linspace(first, last, count + 1)
        # At a joint the path has the curvature of the next segment: sample just before it.
        inside = np.minimum(s, last - _INSIDE_RATIO * (last - first))
        curvature = np.linalg.norm(toolpath.evaluate(inside).d2r_ds2, axis=1)
        # Chords per millimetre. The larger of two neighbours counts, so that no bend is missed between samples.
        density = np.maximum(1.0 / longest_mm, np.sqrt(curvature / (8.0 * _SPARE * tolerance_mm)))
        steps = np.diff(s) * np.maximum(density[:-1], density[1:])
        count_at = np.concatenate([[0.0], np.cumsum(steps)])
        chords = max(1, int(np.ceil(count_at[-1])))
        ends.append(np.interp(np.linspace(0.0, count_at[-1], chords + 1)[1:], count_at, s))
    return np.concatenate(ends)


def chord_deviation_mm(toolpath: Toolpath, ends_mm: FloatArray, points_mm: FloatArray) -> float:
    """Largest distance of the path from its chords, measured at seven points of each.

    Args:
        toolpath: the path.
        ends_mm: arc lengths of the ends, shape (n,).
        points_mm: the ends as they are written, shape (n, dimensions).
    """
    part = np.linspace(0.0, 1.0, 9)[1:-1]
    s = ends_mm[:-1, None] + np.diff(ends_mm)[:, None] * part
    r = toolpath.evaluate(s.ravel()).r_mm.reshape(*s.shape, -1)
    start, chord = points_mm[:-1, None, :], np.diff(points_mm, axis=0)[:, None, :]
    length2 = np.maximum(np.sum(chord**2, axis=2), 1e-18)
    along = np.clip(np.sum((r - start) * chord, axis=2) / length2, 0.0, 1.0)
    distance = np.linalg.norm(r - start - along[..., None] * chord, axis=2)
    at_ends = np.linalg.norm(toolpath.evaluate(ends_mm).r_mm - points_mm, axis=1)
    return float(max(np.max(distance), np.max(at_ends)))
