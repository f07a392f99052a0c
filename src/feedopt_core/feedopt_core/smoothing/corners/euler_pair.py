"""Corners between straight sides: a symmetric pair of Euler spirals (thesis, chapter 5 and section 2.2.3).

Both spirals meet at the bisector with the peak curvature and leave the sides with none. With the turning angle th and
unit length, the heading of the first is ``th s^2 / 2``; its end lies at X (along the side) and Y (across it). For one
length L

- half side used: ``L (X + Y tan(th/2))``
- distance of the corner from the path: ``L Y / cos(th/2)``, the largest both ways.

All of it works in the plane of the two sides, in two and three dimensions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.quadrature import gauss_legendre
from feedopt_core.geometry.segments import PlanarSegment, SegmentKind
from feedopt_core.smoothing.side import UNPLACED

_NODES, _WEIGHTS = gauss_legendre(16)


@dataclass(frozen=True)
class EulerPair:
    """Shape of the pair for one turning angle and spirals of unit length.

    Attributes:
        angle_rad: turning angle, above 0 and below pi.
        half_side: length of each side that the pair replaces.
        deviation: distance of the corner from the pair.
        forward, sideways: end of the first spiral along and across its side.
    """

    angle_rad: float
    half_side: float
    deviation: float
    forward: float
    sideways: float

    @classmethod
    def turning(cls, angle_rad: float) -> EulerPair:
        """Pair for a turning angle above 0 and below pi."""
        heading = 0.5 * angle_rad * _NODES**2
        forward, sideways = float(np.cos(heading) @ _WEIGHTS), float(np.sin(heading) @ _WEIGHTS)
        half = 0.5 * angle_rad
        return cls(
            angle_rad, forward + sideways * float(np.tan(half)), sideways / float(np.cos(half)), forward, sideways
        )

    def length_mm(self, tolerance_mm: float, room_mm: float) -> float:
        """Longest spiral within the tolerance and the room on each side."""
        return min(tolerance_mm / self.deviation, room_mm / self.half_side)

    def curves(
        self, corner_mm: FloatArray, before: FloatArray, after: FloatArray, length_mm: float
    ) -> tuple[PlanarSegment, PlanarSegment]:
        """The two spirals at a corner.

        Args:
            corner_mm: the corner, shape (dimensions,).
            before, after: unit directions of the sides, in the direction of motion.
            length_mm: length of each spiral.
        """
        across = after - before * float(after @ before)
        across /= np.linalg.norm(across)
        start_mm = corner_mm - before * (self.half_side * length_mm)
        middle_mm = start_mm + length_mm * (self.forward * before + self.sideways * across)
        half = 0.5 * self.angle_rad
        along = np.cos(half) * before + np.sin(half) * across
        normal = np.cos(half) * across - np.sin(half) * before
        peak, sharpness, zero = self.angle_rad / length_mm, self.angle_rad / length_mm**2, np.zeros_like(before)
        kind = SegmentKind.CLOTHOID
        return (
            PlanarSegment(kind, UNPLACED, length_mm, start_mm, before, across, zero, 0.0, sharpness),
            PlanarSegment(kind, UNPLACED, length_mm, middle_mm, along, normal, zero, peak, -sharpness),
        )


def turning_angle(before: FloatArray, after: FloatArray) -> float:
    """Angle between two unit directions, 0 to pi, accurate for small ones too."""
    return 2.0 * float(np.arctan2(np.linalg.norm(after - before), np.linalg.norm(after + before)))
