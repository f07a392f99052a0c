"""The segments a smoothed toolpath is made of, parametrised by arc length."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.arc_length import ArcLengthMap
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.geometry.packed_path import PackedSegment
from feedopt_core.geometry.path_kernels import NURBS, PIECE, PLANAR
from feedopt_core.geometry.path_points import PathPoints


class SegmentKind(IntEnum):
    """Kinds of segments; the numbers are those of the message."""

    LINE = 0
    ARC = 1
    CLOTHOID = 2
    NURBS = 3


@dataclass(frozen=True)
class SegmentPlace:
    """Where a segment stands in its program.

    Attributes:
        sequence: 1, 2, 3, ... within the program.
        source_line: line of the program the segment starts on, from 1.
        s_start_mm: arc length from the start of the program.
        feed_limit_mm_s: programmed feed; infinity where only the machine's limits hold.
        exact_stop: the machine comes to rest at the end of the segment.
        last: no segment follows.
        rapid: a rapid (G0): moves without cutting.
        dwell_s: time to wait at rest behind an exact stop at its end.
        events: words of the program that take effect at its start (spindle, coolant, tool change).
    """

    sequence: int
    source_line: int
    s_start_mm: float
    feed_limit_mm_s: float = float("inf")
    exact_stop: bool = False
    last: bool = False
    rapid: bool = False
    dwell_s: float = 0.0
    events: tuple[str, ...] = ()


@dataclass(frozen=True)
class PlanarSegment:
    """Line, arc or clothoid: curvature linear in arc length in one plane, plus a constant rise out of it (helix).

    Attributes:
        kind: LINE, ARC or CLOTHOID.
        place: where the segment stands in its program.
        length_mm: arc length.
        start_mm: tool position at the start, shape (dimensions,).
        tangent: unit in-plane direction at the start.
        normal: unit vector perpendicular to it; positive curvature turns towards it.
        rise: out-of-plane part of dr/ds.
        curvature_start_per_mm: in-plane curvature at the start.
        sharpness_per_mm2: its change with in-plane arc length.
    """

    kind: SegmentKind
    place: SegmentPlace
    length_mm: float
    start_mm: FloatArray
    tangent: FloatArray
    normal: FloatArray
    rise: FloatArray
    curvature_start_per_mm: float
    sharpness_per_mm2: float

    def __post_init__(self) -> None:
        values = np.concatenate([self.start_mm, self.tangent, self.normal, self.rise, [self.length_mm]])
        if not np.all(np.isfinite([*values, self.curvature_start_per_mm, self.sharpness_per_mm2])):
            raise ToolpathError(
                f"segment {self.place.sequence} holds a value that is not finite", line=self.place.source_line
            )
        if self.length_mm <= 0.0:
            raise ToolpathError(
                f"segment {self.place.sequence} has length {self.length_mm:g} mm", line=self.place.source_line
            )

    @property
    def joints_mm(self) -> FloatArray:
        """Arc lengths from the start of the segment between which every derivative is continuous."""
        return np.array([0.0, self.length_mm])

    @cached_property
    def packed(self) -> PackedSegment:
        """The segment as it is evaluated."""
        pieces, dimensions = np.zeros(1, PIECE), len(self.start_mm)
        pieces["segment_length_mm"], pieces["kind"] = self.length_mm, PLANAR
        pieces["slope"] = np.sqrt(max(0.0, 1.0 - float(self.rise @ self.rise)))
        pieces["curvature_per_mm"], pieces["sharpness_per_mm2"] = self.curvature_start_per_mm, self.sharpness_per_mm2
        for name in ("start_mm", "tangent", "normal", "rise"):
            pieces[name][:, :dimensions] = getattr(self, name)
        return PackedSegment(dimensions, np.zeros(1), pieces, np.empty(0))

    def evaluate(self, s_mm: FloatArray) -> PathPoints:
        """Path at arc lengths from the start of the segment, shape (n,)."""
        return self.packed.points(s_mm)


@dataclass(frozen=True)
class NurbsSegment:
    """A NURBS curve with its arc-length map.

    Attributes:
        place: where the segment stands in its program.
        curve: the control net.
        arc_length_map: parameter of the curve by arc length; its ``error_mm`` states the bound.
    """

    place: SegmentPlace
    curve: NurbsCurve
    arc_length_map: ArcLengthMap
    kind: SegmentKind = field(default=SegmentKind.NURBS, init=False)

    @property
    def length_mm(self) -> float:
        """Arc length."""
        return self.arc_length_map.length_mm

    @property
    def joints_mm(self) -> FloatArray:
        """Arc lengths from the start of the segment between which every derivative is continuous."""
        if len(self.curve.joints) == 2:
            return self.arc_length_map.s_mm[[0, -1]]
        starts = self.arc_length_map.coefficients[:, 0]
        at_knot = np.isin(starts, self.curve.joints)
        return np.append(self.arc_length_map.s_mm[:-1][at_knot], self.length_mm)

    @cached_property
    def packed(self) -> PackedSegment:
        """The segment as it is evaluated."""
        starts, coefficients = self.arc_length_map.s_mm, self.arc_length_map.coefficients
        spans = self.curve.spans
        pieces = np.zeros(len(coefficients), PIECE)
        pieces["segment_length_mm"], pieces["kind"] = self.length_mm, NURBS
        pieces["map_start_mm"], pieces["map_length_mm"], pieces["map_u"] = starts[:-1], np.diff(starts), coefficients
        own = np.clip(np.searchsorted(self.curve.joints, coefficients[:, 0], side="right") - 1, 0, len(spans) - 1)
        pieces["degree"], pieces["last_span"] = self.curve.degree, spans.shape[1] * (len(spans) - 1)
        pieces["own_span"] = spans.shape[1] * own
        return PackedSegment(self.curve.control_points_mm.shape[1], starts[:-1], pieces, spans.ravel())

    def evaluate(self, s_mm: FloatArray) -> PathPoints:
        """Path at arc lengths from the start of the segment, shape (n,)."""
        return self.packed.points(s_mm)


Segment = PlanarSegment | NurbsSegment
