"""Corners between straight elements: a symmetric pair of Euler spirals (thesis, chapter 5 and section 2.2.3).

The curvature is zero where the spirals join the elements, and largest where the spirals meet, on the bisector. With the
turning angle th and unit length, the heading of the first spiral is ``th s^2 / 2``; its end lies at X (along the
element) and Y (across it). For a spiral of length L,

- length cut from each element: ``L (X + Y tan(th/2))``
- distance of the corner from the path: ``L Y / cos(th/2)``. This is the largest distance between the path and the
  corner, measured from either of them.

The pair lies in the plane of the two elements, in two and in three dimensions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.quadrature import gauss_legendre
from feedopt_core.geometry.segments import PlanarSegment, SegmentKind
from feedopt_core.smoothing.path_element import UNPLACED

_NODES, _WEIGHTS = gauss_legendre(16)


@dataclass(frozen=True)
class EulerPair:
    """Shape of the pair for one turning angle and spirals of unit length.

    Attributes:
        angle_rad: turning angle, above 0 and below pi.
        cut: length of each element that the pair replaces.
        deviation: distance of the corner from the pair.
        forward, sideways: end of the first spiral along and across its element.
    """

    angle_rad: float
    cut: float
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

    def length_mm(self, tolerance_mm: float, available_mm: float) -> float:
        """Longest spiral that keeps the tolerance and cuts at most the available length from each element."""
        return min(tolerance_mm / self.deviation, available_mm / self.cut)

    def curves(
        self, corner_mm: FloatArray, before: FloatArray, after: FloatArray, length_mm: float
    ) -> tuple[PlanarSegment, PlanarSegment]:
        """The two spirals at a corner.

        Args:
            corner_mm: the corner, shape (dimensions,).
            before, after: unit directions of the elements, in the direction of motion.
            length_mm: length of each spiral.
        """
        across = after - before * float(after @ before)
        across /= np.linalg.norm(across)
        start_mm = corner_mm - before * (self.cut * length_mm)
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
    """Angle between two unit directions, 0 to pi; accurate for small angles as well."""
    return 2.0 * float(np.arctan2(np.linalg.norm(after - before), np.linalg.norm(after + before)))
