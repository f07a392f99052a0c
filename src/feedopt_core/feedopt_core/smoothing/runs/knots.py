"""Knots and sites of the smooth curve through a polyline: dense at turns, sparse where it is gentle."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.compiled import compiled

LARGEST_SPAN_MM = 2.0
_TURN_SHARE = 6.0
_GROWTH = 0.5
_SITES_PER_SPAN = 2.0
_MOST_OF_ONE_CHORD = 4.0


def turns_rad(points_mm: FloatArray) -> FloatArray:
    """Turning angle at each vertex of a polyline, shape (n,); zero at both ends."""
    steps = np.diff(points_mm, axis=0)
    tangents = steps / np.linalg.norm(steps, axis=1)[:, None]
    half = 0.5 * np.linalg.norm(np.diff(tangents, axis=0), axis=1)
    return np.concatenate([[0.0], 2.0 * np.arcsin(np.minimum(half, 1.0)), [0.0]])


def span_lengths_mm(turn_rad: FloatArray, tolerance_mm: float) -> FloatArray:
    """Knot spacing needed at each vertex of the coarse polyline, shape (n,).

    A part of the length, about 8 e / t, over which a curve that leaves the polyline by no more than e makes the turn t;
    a smaller part at corners, where the curve changes faster than where a bend is divided among many vertices.
    """
    wanted = _TURN_SHARE * tolerance_mm / np.maximum(turn_rad, 1e-12) / (1.0 + turn_rad)
    return np.asarray(np.minimum(LARGEST_SPAN_MM, wanted))


def span_counts(chords_mm: FloatArray, spans_mm: FloatArray, start: float) -> FloatArray:
    """Estimated number of spans up to each vertex, shape (n,), starting with that of the first one.

    Chords between sharp turns count a few spans at most.
    """
    narrow = np.minimum(spans_mm[:-1], spans_mm[1:])
    counts = np.minimum(chords_mm / narrow, _MOST_OF_ONE_CHORD) + chords_mm / LARGEST_SPAN_MM
    return np.cumsum(np.append(start, counts))


@compiled
def graded_spans(u: FloatArray, spans_mm: FloatArray) -> FloatArray:
    """Spacings lowered so that they grow by no more than a part of the distance between vertices, shape (n,)."""
    out = spans_mm.copy()
    for j in range(1, len(out)):
        out[j] = min(out[j], out[j - 1] + _GROWTH * (u[j] - u[j - 1]))
    for j in range(len(out) - 2, -1, -1):
        out[j] = min(out[j], out[j + 1] + _GROWTH * (u[j + 1] - u[j]))
    return out


@compiled
def _spacing(u: FloatArray, graded_mm: FloatArray, at: float, chord: int) -> float:
    before: float = graded_mm[chord] + _GROWTH * (at - u[chord])
    behind: float = graded_mm[chord + 1] + _GROWTH * (u[chord + 1] - at)
    return min(before, behind, LARGEST_SPAN_MM)


@compiled
def graded_joints(u: FloatArray, graded_mm: FloatArray, start: float) -> FloatArray:
    """Knots from start to the last vertex, shape (n,), with the given spacing at both ends of each span.

    Args:
        u: parameters of the vertices.
        graded_mm: spacing at each, graded.
        start: first knot, on the first chord.
    """
    end = u[-1]
    joints = [start]
    low = 0
    while True:
        at = joints[-1]
        while low < len(u) - 2 and u[low + 1] <= at:
            low += 1
        step = _spacing(u, graded_mm, at, low)
        high = low
        while high < len(u) - 2 and u[high + 1] <= at + step:
            high += 1
        step = min(step, _spacing(u, graded_mm, min(at + step, end), high))
        if at + 1.5 * step >= end:
            break
        joints.append(at + step)
    joints.append(end)
    return np.array(joints)


@compiled
def place_sites(u: FloatArray, graded_mm: FloatArray, start: float) -> tuple[FloatArray, IntArray]:
    """Sites on the polyline where the curve must stay close: the start, every later vertex, some in each span.

    Args:
        u: parameters of the vertices; start is on the first chord.
        graded_mm: spacing of the knots at each.
        start: parameter of the first site.

    Returns:
        Parameters of the sites, increasing, and the index of the last vertex at or before each, shape (m,).
    """
    sites = [start]
    chord = [0]
    for j in range(len(u) - 1):
        width = u[j + 1] - u[j]
        count = max(1, int(np.ceil(_SITES_PER_SPAN * width / min(graded_mm[j], graded_mm[j + 1]))))
        # On long chords the knot spacing grows away from both turns, and so may that of the sites.
        if count > 16:
            at = u[j]
            while True:
                at += _spacing(u, graded_mm, at, j) / _SITES_PER_SPAN
                if at >= u[j + 1] - 0.5 * graded_mm[j + 1] / _SITES_PER_SPAN:
                    break
                if at > start:
                    sites.append(at)
                    chord.append(j)
        else:
            for i in range(1, count):
                at = u[j] + width * i / count
                if at > start:
                    sites.append(at)
                    chord.append(j)
        if u[j + 1] > start:
            sites.append(u[j + 1])
            chord.append(min(j + 1, len(u) - 2))
    return np.array(sites), np.array(chord)
