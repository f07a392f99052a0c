"""Path elements: the pieces of a programmed path between two joints, and the cutting of their curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.arc_length import StandstillError, map_arc_length
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.geometry.segments import NurbsSegment, PlanarSegment, Segment, SegmentKind, SegmentPlace

UNPLACED = SegmentPlace(1, 1, 0.0)
"""Place of a curve before it becomes a segment of the toolpath."""
AVAILABLE_SHARE = 0.49
"""Share of an element that a blend at either end may replace: just below half, so that a usable part remains."""
_ROUNDING = 64.0 * float(np.finfo(np.float64).eps)
_REFERENCE_SHARE = 2e-3
_MOST_POINTS = 2000


@dataclass(frozen=True)
class PathElement:
    """A smooth piece of the path between two joints.

    Attributes:
        curve: the piece; its place is not set yet.
        line: its line in the program.
        feed_mm_s: programmed feed, infinity for rapids.
        tolerance_mm: largest distance of the smoothed from the programmed path here.
        rapid: it is a rapid.
        exact_stop: the machine stops at its end.
        follows: by construction, it continues the element before with the same direction and curvature.
        available_start_mm, available_end_mm: length at its ends that blends may replace.
        programmed_start_mm, programmed_end_mm: programmed points next to its ends, in order, where the curve itself is
            not the programmed one; they cover the room.
    """

    curve: Segment
    line: int
    feed_mm_s: float
    tolerance_mm: float
    rapid: bool = False
    exact_stop: bool = False
    follows: bool = False
    available_start_mm: float = 0.0
    available_end_mm: float = 0.0
    programmed_start_mm: FloatArray | None = None
    programmed_end_mm: FloatArray | None = None

    @property
    def length_mm(self) -> float:
        """Arc length of the whole curve."""
        return self.curve.length_mm

    @property
    def dimensions(self) -> int:
        """Coordinates of its points."""
        curve = self.curve
        return len(curve.start_mm) if isinstance(curve, PlanarSegment) else curve.curve.control_points_mm.shape[1]

    @property
    def straight(self) -> bool:
        """Its curve is a straight line."""
        return self.curve.kind == SegmentKind.LINE


def rounding_mm(*positions_mm: FloatArray) -> float:
    """Rounding error of points with such coordinates, mm: nearer points count as equal."""
    return _ROUNDING * max(float(np.max(np.abs(position), initial=0.0)) for position in positions_mm)


def straight_curve(start_mm: FloatArray, end_mm: FloatArray) -> PlanarSegment:
    """Straight line between two points that differ, shape (dimensions,) each."""
    step = end_mm - start_mm
    length = float(np.linalg.norm(step))
    tangent = step / length
    zero = np.zeros_like(tangent)
    return PlanarSegment(SegmentKind.LINE, UNPLACED, length, start_mm, tangent, perpendicular(tangent), zero, 0.0, 0.0)


def straight_element(
    start_mm: FloatArray, end_mm: FloatArray, line: int, feed_mm_s: float, tolerance_mm: float, rapid: bool
) -> PathElement:
    """Straight element between two points that differ, with the usual available length at both ends."""
    curve = straight_curve(start_mm, end_mm)
    available_mm = AVAILABLE_SHARE * curve.length_mm
    return PathElement(
        curve, line, feed_mm_s, tolerance_mm, rapid, available_start_mm=available_mm, available_end_mm=available_mm
    )


def perpendicular(direction: FloatArray) -> FloatArray:
    """Some unit vector perpendicular to a unit vector, shape (dimensions,)."""
    if len(direction) == 2:
        return np.array([-direction[1], direction[0]])
    axis = np.zeros(3)
    axis[int(np.argmin(np.abs(direction)))] = 1.0
    across = axis - direction * float(axis @ direction)
    return np.asarray(across / np.linalg.norm(across))


def part(curve: Segment, start_mm: float, end_mm: float) -> Segment:
    """The curve from one arc length to another, both from its start.

    Raises:
        ToolpathError: the part of a NURBS curve cannot be parametrised by arc length.
    """
    if start_mm == 0.0 and end_mm == curve.length_mm:
        return curve
    if isinstance(curve, NurbsSegment):
        return _nurbs_part(curve, start_mm, end_mm)
    at = curve.evaluate(np.array([start_mm]))
    slope = float(np.sqrt(max(0.0, 1.0 - float(curve.rise @ curve.rise))))
    in_plane = start_mm * slope
    angle = in_plane * (curve.curvature_start_per_mm + 0.5 * curve.sharpness_per_mm2 * in_plane)
    cos, sin = float(np.cos(angle)), float(np.sin(angle))
    return PlanarSegment(
        curve.kind,
        curve.place,
        end_mm - start_mm,
        at.r_mm[0],
        cos * curve.tangent + sin * curve.normal,
        cos * curve.normal - sin * curve.tangent,
        curve.rise,
        curve.curvature_start_per_mm + curve.sharpness_per_mm2 * in_plane,
        curve.sharpness_per_mm2,
    )


def _nurbs_part(segment: NurbsSegment, start_mm: float, end_mm: float) -> NurbsSegment:
    start_u, end_u = segment.arc_length_map.parameter(np.array([start_mm, end_mm]))
    low, high = segment.curve.joints[[0, -1]]
    if start_mm <= 0.0:
        start_u = low
    if end_mm >= segment.length_mm:
        end_u = high
    curve = curve_between(segment.curve, float(start_u), float(end_u))
    return NurbsSegment(segment.place, curve, map_arc_length(curve.evaluate, curve.joints))


def curve_between(curve: NurbsCurve, start_u: float, end_u: float) -> NurbsCurve:
    """The same curve on a part of its domain, clamped, by knot insertion; parameters are kept."""
    degree = curve.degree
    homogeneous = np.column_stack([curve.control_points_mm * curve.weights[:, None], curve.weights])
    spline = BSpline(curve.knots, homogeneous, degree)
    for u in (start_u, end_u):
        missing = degree - int(np.count_nonzero(spline.t == u))
        if missing > 0:
            spline = spline.insert_knot(u, m=missing)
    knots = spline.t
    inside = knots[(knots > start_u) & (knots < end_u)]
    first = int(np.searchsorted(knots, start_u, side="right")) - 1 - degree
    net = spline.c[first : first + len(inside) + degree + 1]
    own_knots = np.concatenate([np.full(degree + 1, start_u), inside, np.full(degree + 1, end_u)])
    return NurbsCurve.from_control_net(degree, own_knots, net[:, :-1] / net[:, -1:], net[:, -1])


def nurbs_element_curve(curve: NurbsCurve, line: int) -> NurbsSegment:
    """Curve with its arc-length map. Raises ToolpathError with the line of the program."""
    try:
        return NurbsSegment(UNPLACED, curve, map_arc_length(curve.evaluate, curve.joints))
    except StandstillError as error:
        error.line = line
        raise
    except ToolpathError as error:
        raise ToolpathError(error.message, line=line) from error


def sampled(curve: Segment, start_mm: float, end_mm: float, tolerance_mm: float) -> FloatArray:
    """Points of the curve, close enough that their chords stay within a small part of the tolerance, shape (n, d)."""
    if curve.kind == SegmentKind.LINE:
        return curve.evaluate(np.array([start_mm, end_mm])).r_mm
    probes = curve.evaluate(np.linspace(start_mm, end_mm, 17))
    bend = float(np.max(np.linalg.norm(probes.d2r_ds2, axis=1)))
    count = int(np.ceil((end_mm - start_mm) * np.sqrt(bend / (8.0 * _REFERENCE_SHARE * tolerance_mm))))
    return curve.evaluate(np.linspace(start_mm, end_mm, int(np.clip(count, 16, _MOST_POINTS)) + 1)).r_mm
