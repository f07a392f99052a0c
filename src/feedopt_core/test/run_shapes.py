"""Runs of short moves that the tests of their smoothing share, and a distance check of its own."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.segments import NurbsSegment, SegmentPlace
from feedopt_core.smoothing.runs.smoother import RunPiece, RunSmoother

TOLERANCE_MM = 0.01


def smooth(
    points_mm: FloatArray,
    *,
    tolerance_mm: float = TOLERANCE_MM,
    blocks: Sequence[int] = (),
    feed_mm_s: FloatArray | None = None,
    start_direction: FloatArray | None = None,
    end_direction: FloatArray | None = None,
) -> list[RunPiece]:
    """Pieces of a whole run; blocks are the lengths of its first blocks, the last one takes the rest."""
    smoother = RunSmoother(tolerance_mm, start_direction)
    lines = np.arange(len(points_mm))
    feed = np.full(len(points_mm), 50.0) if feed_mm_s is None else feed_mm_s
    edges = np.minimum(
        np.concatenate([[0], np.cumsum(np.asarray(blocks, dtype=int)), [len(points_mm)]]), len(points_mm)
    )
    pieces = list[RunPiece]()
    for low, high in pairwise(edges):
        pieces += smoother.add(points_mm[low:high], lines[low:high], feed[low:high])
    return pieces + smoother.finish(end_direction)


def segments_of(pieces: Sequence[RunPiece]) -> list[NurbsSegment]:
    """The pieces as segments of a program."""
    segments, s_mm = list[NurbsSegment](), 0.0
    for index, piece in enumerate(pieces):
        place = SegmentPlace(index + 1, piece.line, s_mm, piece.feed_mm_s, last=index == len(pieces) - 1)
        segments.append(NurbsSegment(place, piece.curve, piece.arc_length_map))
        s_mm += segments[-1].length_mm
    return segments


def curve_points(pieces: Sequence[RunPiece], per_span: int = 24) -> FloatArray:
    """Points along all pieces, so many a span; the place where two pieces join stands once."""
    parts = []
    for piece in pieces:
        joints = piece.curve.joints
        z = np.arange(per_span) / per_span
        u = np.append((joints[:-1, None] + np.diff(joints)[:, None] * z).ravel(), joints[-1])
        parts.append(piece.curve.evaluate(u)[0][1 if parts else 0 :])
    return np.concatenate(parts)


def distances_to_polyline(points_mm: FloatArray, polyline_mm: FloatArray, reach: int = 2000) -> FloatArray:
    """Distance of each point to the nearest chord of a polyline, shape (n,); brute force in blocks of chords."""
    best = np.full(len(points_mm), np.inf)
    starts, chords = polyline_mm[:-1], np.diff(polyline_mm, axis=0)
    squares = np.maximum(np.sum(chords**2, axis=1), 1e-300)
    for low in range(0, len(starts), reach):
        part = slice(low, low + reach)
        offset = points_mm[:, None] - starts[None, part]
        along = np.clip(np.einsum("ncd,cd->nc", offset, chords[part]) / squares[part], 0.0, 1.0)
        gap = offset - along[:, :, None] * chords[part]
        best = np.minimum(best, np.sqrt(np.min(np.sum(gap**2, axis=2), axis=1)))
    return best


def worst_distance_mm(pieces: Sequence[RunPiece], polyline_mm: FloatArray) -> float:
    """Largest distance between curve and polyline, seen from either of them, by samples."""
    curve = curve_points(pieces)
    steps = np.linalg.norm(np.diff(polyline_mm, axis=0), axis=1)
    dense = [polyline_mm[:1]]
    for start, end, length in zip(polyline_mm[:-1], polyline_mm[1:], steps, strict=True):
        count = int(np.ceil(length / 0.05)) + 1
        dense.append(start + (end - start) * (np.arange(1, count + 1) / count)[:, None])
    towards_polyline = float(np.max(distances_to_polyline(curve, polyline_mm)))
    samples = np.concatenate(dense)
    nearest = cKDTree(curve).query(samples)[1]
    towards_curve = np.full(len(samples), np.inf)
    for offset in (-1, 0):
        first = np.clip(nearest + offset, 0, len(curve) - 2)
        chord = curve[first + 1] - curve[first]
        gap = samples - curve[first]
        along = np.clip(np.sum(gap * chord, axis=1) / np.maximum(np.sum(chord**2, axis=1), 1e-300), 0.0, 1.0)
        towards_curve = np.minimum(towards_curve, np.linalg.norm(gap - along[:, None] * chord, axis=1))
    return max(towards_polyline, float(np.max(towards_curve)))


def circle_points(radius_mm: float, count: int, turn_rad: float = 2.0 * np.pi) -> FloatArray:
    """Points on a circle around the origin, from the x axis."""
    t = np.linspace(0.0, turn_rad, count)
    return radius_mm * np.column_stack([np.cos(t), np.sin(t)])


def corner_points(turn_rad: float, side_mm: float = 10.0, chord_mm: float = 0.1) -> FloatArray:
    """Points along two straight sides that meet at an angle."""
    along = np.arange(0.0, side_mm, chord_mm)
    second = np.array([np.cos(turn_rad), np.sin(turn_rad)])
    first = np.column_stack([along, np.zeros(len(along))])
    return np.concatenate([first, [side_mm, 0.0] + np.append(along, side_mm)[:, None] * second])


def relief_points(rows: int = 3) -> FloatArray:
    """Finishing of a relief: long rows in x, z follows a surface, programmed to 3 decimals."""
    x = np.arange(0.0, 30.0, 0.15)
    parts = []
    for row in range(rows):
        y = np.full(len(x), 0.4 * row)
        z = 0.8 * np.sin(0.5 * x) * np.cos(0.3 * y) + 0.2 * np.sin(1.7 * x + y)
        points = np.column_stack([x, y, z])
        parts.append(points if row % 2 == 0 else points[::-1])
    return np.round(np.concatenate(parts), 3)
