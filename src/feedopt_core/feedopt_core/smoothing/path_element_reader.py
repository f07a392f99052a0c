"""From moves to path elements: straight moves, arcs, smooth parts of NURBS curves, curves for runs of short moves."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.geometry.segments import NurbsSegment, PlanarSegment, SegmentKind
from feedopt_core.programs.moves import ArcMove, LineMoves, NurbsMove, PathMode
from feedopt_core.smoothing.path_element import (
    AVAILABLE_SHARE,
    UNPLACED,
    PathElement,
    curve_between,
    nurbs_element_curve,
    rounding_mm,
)
from feedopt_core.smoothing.polyline import Polyline, PolylineKind

_SPANS = 16
"""Most knot spans per element: a longer curve arrives in several elements."""
_GAP = 1e-6
_G2_TURN = 1e-7
_G2_STEP = 1e-5


class PathElementReader:
    """Moves of one program in, elements out.

    Args:
        tolerance_mm: of feed moves, if the program gives none.
        dimensions: coordinates of the machine, 2 or 3.
        rapid_tolerance_mm: of rapids; None: as for feed moves.
    """

    def __init__(self, tolerance_mm: float, dimensions: int, rapid_tolerance_mm: float | None) -> None:
        self._tolerance_mm = tolerance_mm
        self._dimensions = dimensions
        self._rapid_tolerance_mm = rapid_tolerance_mm
        self._position_mm: FloatArray | None = None
        self._height_mm: float | None = None
        self._polyline: Polyline | None = None

    def take(self, move: LineMoves | ArcMove | NurbsMove) -> Iterator[PathElement]:
        """Path elements that became final with a move. Raises ToolpathError, see :func:`~.stage.smooth`."""
        if isinstance(move, LineMoves):
            yield from self._straight(move)
            return
        yield from self.flush()
        if isinstance(move, ArcMove):
            yield self._arc(move)
        elif move.degree == 1:
            count = len(move.control_points_mm) - 1
            lines, feed = np.full(count, move.line, dtype=np.int64), np.full(count, move.feed_mm_s)
            points_mm = move.control_points_mm
            yield from self._straight(LineMoves(points_mm[0], points_mm[1:], lines, feed, mode=move.mode))
        else:
            yield from self._nurbs(move)

    def flush(self) -> Iterator[PathElement]:
        """Path elements of the straight moves held so far; the next move is not straight."""
        polyline, self._polyline = self._polyline, None
        if polyline is not None:
            yield from polyline.finish()

    def _straight(self, move: LineMoves) -> Iterator[PathElement]:
        start_mm, points_mm = self._begin(move.start_mm, int(move.lines[0])), self._flat(move.points_mm, move.lines)
        self._position_mm = points_mm[-1]
        kind = PolylineKind(self._tolerance(move.mode, move.rapid), move.rapid, move.mode)
        if self._polyline is None or self._polyline.kind != kind:
            yield from self.flush()
            self._polyline = Polyline(start_mm, kind)
        yield from self._polyline.add(points_mm, move.lines, move.feed_mm_s)

    def _arc(self, move: ArcMove) -> PathElement:
        start_mm = self._begin(move.start_mm, move.line)
        curve = _arc_curve(move)
        self._flat(np.stack([move.start_mm, move.end_mm]), np.full(2, move.line))
        if self._dimensions == 2:
            if abs(abs(move.normal[2]) - 1.0) > 1e-9:
                raise _no_axis(move.line)
            curve = PlanarSegment(
                curve.kind,
                UNPLACED,
                curve.length_mm,
                start_mm,
                curve.tangent[:2],
                curve.normal[:2],
                np.zeros(2),
                curve.curvature_start_per_mm,
                0.0,
            )
        self._position_mm = move.end_mm[: self._dimensions]
        return self._element(curve, move.line, move.feed_mm_s, move.mode, last=True)

    def _nurbs(self, move: NurbsMove) -> Iterator[PathElement]:
        self._begin(move.control_points_mm[0], move.line)
        lines = np.full(len(move.control_points_mm), move.line)
        control_mm = self._flat(move.control_points_mm, lines)
        try:
            whole = NurbsCurve.from_control_net(move.degree, move.knots, control_mm, move.weights)
        except ToolpathError as error:
            raise ToolpathError(error.message, line=move.line) from error
        ends_mm = whole.evaluate(whole.joints[[0, -1]])[0]
        if np.max(np.abs(ends_mm - control_mm[[0, -1]])) > rounding_mm(control_mm):
            raise ToolpathError("the NURBS knots do not clamp the curve to its first and last point", line=move.line)
        self._position_mm = control_mm[-1]
        breaks, smooth = _breaks(whole)
        for index, (start_u, end_u) in enumerate(itertools.pairwise(breaks)):
            curve = nurbs_element_curve(curve_between(whole, start_u, end_u), move.line)
            last = index == len(breaks) - 2
            yield self._element(curve, move.line, move.feed_mm_s, move.mode, last=last, follows=smooth[index])

    def _element(
        self,
        curve: PlanarSegment | NurbsSegment,
        line: int,
        feed_mm_s: float,
        mode: PathMode,
        *,
        last: bool,
        follows: bool = False,
    ) -> PathElement:
        available_mm = AVAILABLE_SHARE * curve.length_mm
        return PathElement(
            curve,
            line,
            feed_mm_s,
            self._tolerance(mode, rapid=False),
            exact_stop=mode.exact_stop and last,
            follows=follows,
            available_start_mm=available_mm,
            available_end_mm=available_mm,
        )

    def _tolerance(self, mode: PathMode, rapid: bool) -> float:
        if rapid and self._rapid_tolerance_mm is not None:
            return self._rapid_tolerance_mm
        return self._tolerance_mm if mode.tolerance_mm is None else mode.tolerance_mm

    def _begin(self, start_mm: FloatArray, line: int) -> FloatArray:
        """Start of a move in the machine's coordinates."""
        here_mm = np.asarray(start_mm[: self._dimensions], dtype=np.float64)
        if not np.all(np.isfinite(start_mm)):
            raise ToolpathError("a coordinate is not finite", line=line)
        if self._position_mm is not None:
            gap_mm = float(np.linalg.norm(here_mm - self._position_mm))
            if gap_mm > _GAP * max(1.0, float(np.max(np.abs(here_mm)))):
                raise ToolpathError(f"the move starts {gap_mm:g} mm from the end of the one before", line=line)
        return here_mm

    def _flat(self, points_mm: FloatArray, lines: IntArray) -> FloatArray:
        """Points in the machine's coordinates, shape (n, dimensions)."""
        finite = np.all(np.isfinite(points_mm), axis=1)
        if not np.all(finite):
            raise ToolpathError("a coordinate is not finite", line=int(lines[int(np.argmin(finite))]))
        if self._dimensions == 3:
            return np.asarray(points_mm, dtype=np.float64)
        if self._height_mm is None:
            self._height_mm = float(points_mm[0, 2])
        moved = np.abs(points_mm[:, 2] - self._height_mm) > rounding_mm(points_mm)
        if np.any(moved):
            raise _no_axis(int(lines[int(np.argmax(moved))]))
        return np.asarray(points_mm[:, :2], dtype=np.float64)


def _no_axis(line: int) -> ToolpathError:
    return ToolpathError("the move leaves its z, and the machine has no axis for it", line=line)


def _arc_curve(move: ArcMove) -> PlanarSegment:
    """Arc or helix as a segment in three dimensions that meets both programmed ends.

    Programs round centres and radii. The centre is moved into the plane between the two ends (by no more than half of
    what they are off), which turns both radii into one.
    """
    radial = move.start_mm - move.center_mm
    flat_end = move.end_mm - move.normal * float((move.end_mm - move.start_mm) @ move.normal)
    chord = flat_end - move.start_mm
    length2 = float(chord @ chord)
    turns = move.sweep_rad / (2.0 * np.pi)
    closed = abs(turns - round(turns)) * 2.0 * np.pi < 1e-6 or length2 <= rounding_mm(move.start_mm) ** 2
    sweep_rad = move.sweep_rad
    if not closed:
        # Distance of the centre from the plane between the ends, along the chord.
        offset = float((move.start_mm + flat_end) @ chord / 2.0 - move.center_mm @ chord) / length2
        radial = radial - offset * chord
        leaving, arriving = radial, flat_end - (move.start_mm - radial)
        angle = float(np.arctan2(np.cross(leaving, arriving) @ move.normal, leaving @ arriving))
        sweep_rad = angle + 2.0 * np.pi * round((move.sweep_rad - angle) / (2.0 * np.pi))
    radius = float(np.linalg.norm(radial))
    if not (radius > 0.0 and sweep_rad > 0.0):
        raise ToolpathError("the arc has no radius", line=move.line)
    rise_mm = float((move.end_mm - move.start_mm) @ move.normal)
    length = float(np.hypot(radius * sweep_rad, rise_mm))
    inwards = -radial / radius
    tangent = np.cross(move.normal, -inwards)
    return PlanarSegment(
        SegmentKind.ARC,
        UNPLACED,
        length,
        move.start_mm,
        tangent / np.linalg.norm(tangent),
        inwards,
        move.normal * (rise_mm / length),
        1.0 / radius,
        0.0,
    )


def _breaks(curve: NurbsCurve) -> tuple[list[float], list[bool]]:
    """Parameters that divide a curve where it is not G2, and where a part would have too many spans.

    Returns:
        The parameters, and for each part whether it follows the one before smoothly.
    """
    inner = curve.joints[1:-1]
    counts = np.count_nonzero(curve.knots == inner[:, None], axis=1)
    breaks, smooth, spans = [float(curve.joints[0])], [False], 0
    for u, count in zip(inner.tolist(), counts.tolist(), strict=True):
        spans += 1
        is_g2 = count <= curve.degree - 2 or _is_g2(curve, u)
        if not is_g2 or spans == _SPANS:
            breaks.append(u)
            smooth.append(is_g2)
            spans = 0
    return [*breaks, float(curve.joints[-1])], smooth


def _is_g2(curve: NurbsCurve, u: float) -> bool:
    """Direction and curvature agree on both sides of a knot."""
    index = int(np.searchsorted(curve.joints, u))
    before = u - 1e-12 * (u - curve.joints[index - 1])
    _, r_u, r_uu, _ = curve.evaluate(np.array([before, u]))
    speed = np.linalg.norm(r_u, axis=1)
    if not np.min(speed) > 1e-9 * np.max(speed):
        return False
    tangent = r_u / speed[:, None]
    across = r_uu - tangent * np.einsum("nd,nd->n", r_uu, tangent)[:, None]
    curvature = across / speed[:, None] ** 2
    turn, step = np.linalg.norm(tangent[1] - tangent[0]), np.linalg.norm(curvature[1] - curvature[0])
    return bool(turn <= _G2_TURN and step <= _G2_STEP * np.max(np.linalg.norm(curvature, axis=1)))
