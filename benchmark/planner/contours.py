"""Paths of the planner's benchmarks, designed for this project: of the published contours only the fan is available.

Figures of these paths must not be quoted as figures of a published contour.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.segments import PlanarSegment, Segment, SegmentKind, SegmentPlace
from feedopt_core.smoothing.cubic_spline import interpolate_points

_FINGERS = (
    # angle of the finger from x, degrees; length and half width, mm; its start at the palm, mm
    (160.0, 62.0, 10.0, (-38.0, 8.0)),
    (112.0, 74.0, 8.5, (-25.0, 38.0)),
    (94.0, 82.0, 9.0, (-5.0, 45.0)),
    (78.0, 76.0, 8.5, (15.0, 41.0)),
    (58.0, 60.0, 7.5, (32.0, 29.0)),
)
_WRIST = ((28.0, -30.0), (20.0, -55.0), (0.0, -62.0), (-20.0, -55.0), (-30.0, -28.0))


def hand_like() -> list[Segment]:
    """A closed contour of a palm with five fingers, about a metre long, similar to figure 3-13 of the thesis."""
    outline: list[tuple[float, float]] = []
    for angle, length, half, (x, y) in _FINGERS:
        along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        across = np.array([along[1], -along[0]])
        root = np.array([x, y])
        # Along the first side, around the tip, back on the other side.
        for a, b in ((0.0, -1.15), (0.35, -1.0), (0.7, -0.95), (0.92, -0.72), (1.0, 0.0)):
            outline.append(tuple(root + a * length * along + b * half * across))
        for a, b in ((0.92, 0.72), (0.7, 0.95), (0.35, 1.0), (0.0, 1.15)):
            outline.append(tuple(root + a * length * along + b * half * across))
    points = np.array([*outline, *_WRIST])
    return _spline(np.concatenate([points, points[:1]]))


def long_smooth(length_mm: float = 18_500.0, chord_mm: float = 45.0, seed: int = 3) -> list[Segment]:
    """A winding path without sharp bends, long enough that planning in windows is needed."""
    random = np.random.default_rng(seed)
    count = int(length_mm / chord_mm)
    # The curvature is a random walk with a drift to zero: bends of both signs, radii from about 60 mm.
    turn = np.zeros(count)
    for i in range(1, count):
        turn[i] = 0.8 * turn[i - 1] + 0.16 * random.standard_normal()
    heading = np.cumsum(np.clip(turn, -0.7, 0.7))
    steps = chord_mm * np.column_stack([np.cos(heading), np.sin(heading)])
    return _spline(np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]))


def serpentine(length_mm: float, radius_mm: float = 12.0, spiral_mm: float = 14.0) -> Iterator[PlanarSegment]:
    """Euler spirals that bend left and right in turn, up to any length; continuous curvature."""
    sharpness = 1.0 / (radius_mm * spiral_mm)
    start_mm, heading_rad, curvature = np.zeros(2), 0.0, 0.0
    count = max(4, round(length_mm / spiral_mm))
    for index in range(count):
        rate = (sharpness, -sharpness, -sharpness, sharpness)[index % 4]
        tangent = np.array([np.cos(heading_rad), np.sin(heading_rad)])
        segment = PlanarSegment(
            kind=SegmentKind.CLOTHOID,
            place=SegmentPlace(index + 1, index + 1, index * spiral_mm, last=index == count - 1),
            length_mm=spiral_mm,
            start_mm=start_mm,
            tangent=tangent,
            normal=np.array([-tangent[1], tangent[0]]),
            rise=np.zeros(2),
            curvature_start_per_mm=curvature,
            sharpness_per_mm2=rate,
        )
        yield segment
        start_mm = segment.evaluate(np.array([spiral_mm])).r_mm[0]
        heading_rad += spiral_mm * (curvature + 0.5 * rate * spiral_mm)
        curvature += rate * spiral_mm


def _spline(points_mm: FloatArray) -> list[Segment]:
    return list(interpolate_points(points_mm, list(range(1, len(points_mm) + 1))))
