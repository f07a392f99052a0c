"""Closed contours at a height, and programs that stack them, for tests of layer transitions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from feedopt_core.programs.moves import ArcMove, LineMoves, NurbsMove, PathMode

CONTINUOUS = PathMode()


def straight(*points, feed: float = 40.0, rapid: bool = False, line: int = 1, mode: PathMode = CONTINUOUS):
    """Straight moves from the first point through the others."""
    start, *others = np.array(points, dtype=float)
    count = len(others)
    return LineMoves(start, np.array(others), np.full(count, line), np.full(count, feed), rapid, mode)


def arc(start, end, center, sweep_rad: float, *, clockwise: bool = False, feed: float = 40.0):
    normal = np.array([0.0, 0.0, -1.0 if clockwise else 1.0])
    ends = (np.array(each, dtype=float) for each in (start, end, center))
    return ArcMove(*ends, normal, sweep_rad, 0.0, 1, feed)


def circle(z: float, radius: float = 20.0, *, clockwise: bool = False, feed: float = 40.0):
    """Full circle around the origin from (0, -radius)."""
    start = (0.0, -radius, z)
    return [arc(start, start, (0.0, 0.0, z), 2.0 * math.pi, clockwise=clockwise, feed=feed)]


def square(z: float, half: float = 20.0):
    """Anticlockwise square from the middle of its lower side."""
    corners = [(0, -half), (half, -half), (half, half), (-half, half), (-half, -half), (0, -half)]
    return [straight(*[(x, y, z) for x, y in corners])]


def polygon(z: float, count: int, radius: float = 20.0):
    """Anticlockwise regular polygon from its lowest corner, in short chords."""
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1) - 0.5 * np.pi
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count + 1, z)])
    points[-1] = points[0]
    return [straight(*points)]


def stack(contours: Sequence[list], *, rapid: bool = False):
    """Contours one after the other, straight moves between them."""
    moves = list(contours[0])
    for contour in contours[1:]:
        here, there = ends_of(moves)[1], ends_of(contour)[0]
        moves += [straight(here, there, rapid=rapid), *contour]
    return moves


def ends_of(moves: Iterable):
    """First and last place."""
    every = list(moves)

    def start(move):
        return move.control_points_mm[0] if isinstance(move, NurbsMove) else move.start_mm

    def end(move):
        if isinstance(move, NurbsMove):
            return move.control_points_mm[-1]
        return move.points_mm[-1] if isinstance(move, LineMoves) else move.end_mm

    return start(every[0]), end(every[-1])
