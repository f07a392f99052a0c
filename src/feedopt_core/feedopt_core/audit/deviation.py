"""Deviation of the smoothed path from the programmed one, measured on the two paths without data of the smoother.

Both paths are sampled as chains of points. The chords of a chain stay within a small part of the tolerance from their
curve. Each chain is then followed along the other: every point is compared with the part of the other chain at about
the same arc length. So a path that jumps to a neighbouring pass is detected; a plain distance between two sets of
points would not show it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.compiled import compiled
from feedopt_core.geometry.segments import Segment, SegmentKind
from feedopt_core.programs.moves import ArcMove, LineMoves, Move, NurbsMove, ProgramEvent

ALLOWED_RATIO = 1.005
"""Largest ratio of deviation to tolerance that passes; the part above 1 covers the chord errors of the two chains."""
_CHORD_SHARE = 2e-3
_BLOCK = 64
_SHRINK = 0.3
_STRETCH = 2.5
_SLACK = 64.0
_SAME_PLACE = 1.05
"""Places count as equally near if their distances differ by less than this, in tolerances. At a rounded corner, and on
a straight line that meets the corner, the path may pass the same place twice."""
_REFINEMENTS = 12


@dataclass(frozen=True)
class DeviationReport:
    """The worst place of a smoothed path.

    Attributes:
        worst_mm: distance between the two paths where its ratio to the tolerance is largest.
        tolerance_mm: tolerance there.
        ratio: worst_mm / tolerance_mm.
        line: line of the program there.
        at_mm: position there, shape (dimensions,).
    """

    worst_mm: float
    tolerance_mm: float
    ratio: float
    line: int
    at_mm: FloatArray

    @property
    def holds(self) -> bool:
        """Whether the tolerance holds everywhere, within the accuracy of the measurement."""
        return self.ratio <= ALLOWED_RATIO


@dataclass(frozen=True)
class DeviationCurve:
    """Deviation from the programmed path along the smoothed one, shape (n,) each.

    Attributes:
        s_mm: arc length, measured along chords, increasing.
        deviation_mm: distance there.
        tolerance_mm: tolerance there.
    """

    s_mm: FloatArray
    deviation_mm: FloatArray
    tolerance_mm: FloatArray


@dataclass(frozen=True)
class _Chain:
    """Points of a path, each with its arc length, tolerance and line of the program."""

    points_mm: FloatArray
    tolerance_mm: FloatArray
    line: IntArray

    @property
    def lengths_mm(self) -> FloatArray:
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points_mm, axis=0), axis=1))])


def measure_deviation(
    moves: Iterable[Move], segments: Sequence[Segment], tolerance_mm: float, rapid_tolerance_mm: float | None = None
) -> DeviationReport:
    """Largest distance between the programmed moves and the segments, measured from each to the other.

    Args:
        moves: of the program, with at least one motion.
        segments: of the whole smoothed path.
        tolerance_mm: of feed moves where the program gives none.
        rapid_tolerance_mm: of rapids; None: as for feed moves.
    """
    dimensions = len(segments[0].evaluate(np.zeros(1)).r_mm[0])
    programmed = _programmed_chain(moves, dimensions, tolerance_mm, rapid_tolerance_mm)
    smoothed = _smoothed_chain(segments, float(np.min(programmed.tolerance_mm)))
    reports = []
    for points, chain in ((smoothed, programmed), (programmed, smoothed)):
        distances, nearest = _follow(points.points_mm, chain, float(np.max(programmed.tolerance_mm)))
        own = points is programmed
        limits = points.tolerance_mm if own else chain.tolerance_mm[nearest]
        lines = points.line if own else chain.line[nearest]
        worst = int(np.argmax(distances / limits))
        ratio = float(distances[worst] / limits[worst])
        place = float(distances[worst]), float(limits[worst]), ratio, int(lines[worst])
        reports.append(DeviationReport(*place, points.points_mm[worst]))
    return max(reports, key=lambda report: report.ratio)


def deviation_along(
    moves: Iterable[Move], segments: Sequence[Segment], tolerance_mm: float, rapid_tolerance_mm: float | None = None
) -> DeviationCurve:
    """Deviation along the smoothed path, with the same largest ratio as :func:`measure_deviation`.

    The distance of a programmed point counts at the nearest point of the smoothed path. It is needed because a corner
    that is cut off is farther from the smoothed path than any point of that path is from the programmed one. For the
    arguments see :func:`measure_deviation`.
    """
    dimensions = len(segments[0].evaluate(np.zeros(1)).r_mm[0])
    programmed = _programmed_chain(moves, dimensions, tolerance_mm, rapid_tolerance_mm)
    smoothed = _smoothed_chain(segments, float(np.min(programmed.tolerance_mm)))
    largest_mm = float(np.max(programmed.tolerance_mm))
    distances, nearest = _follow(smoothed.points_mm, programmed, largest_mm)
    limits = programmed.tolerance_mm[nearest]
    back, places = _follow(programmed.points_mm, smoothed, largest_mm)
    # The programmed point with the largest ratio of each place: in rising order, the last one assigned stays.
    order = np.argsort(back / programmed.tolerance_mm, kind="stable")
    worst = np.full(len(distances), -1)
    worst[places[order]] = order
    at = np.flatnonzero(worst >= 0)
    at = at[back[worst[at]] * limits[at] > distances[at] * programmed.tolerance_mm[worst[at]]]
    distances[at], limits[at] = back[worst[at]], programmed.tolerance_mm[worst[at]]
    return DeviationCurve(smoothed.lengths_mm, distances, limits)


def _follow(points_mm: FloatArray, chain: _Chain, tolerance_mm: float) -> tuple[FloatArray, IntArray]:
    """Distance of each point from the chain, followed in order, and the nearest chord, shape (n,) each."""
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_mm, axis=0), axis=1))])
    points, vertices = np.ascontiguousarray(points_mm), np.ascontiguousarray(chain.points_mm)
    return _followed(points, travelled, vertices, chain.lengths_mm, tolerance_mm)


@compiled
def _followed(
    points: FloatArray, travelled: FloatArray, vertices: FloatArray, lengths: FloatArray, tolerance: float
) -> tuple[FloatArray, IntArray]:
    """See :func:`_follow`.

    The search covers places behind and ahead of equal arc length, by a part of the distance since the last anchor. The
    anchor is renewed every few points. Where the path meets itself, the place nearest to equal arc length is taken.
    """
    distances, nearest = np.empty(len(points)), np.zeros(len(points), dtype=np.int64)
    total, last, low = lengths[-1], len(vertices) - 2, 0
    anchor, anchor_at, passed = 0.0, 0.0, 0.0
    for i in range(len(points)):
        way = travelled[i] - anchor_at
        earliest = min(anchor - _SLACK * tolerance + _SHRINK * way, total)
        latest = max(anchor + _SLACK * tolerance + _STRETCH * way, 0.0)
        while low > 0 and lengths[low] > earliest:
            low -= 1
        while low < last and lengths[low + 1] < earliest:
            low += 1
        smallest = np.inf
        for choose in range(2):
            least_off = np.inf
            for j in range(low, last + 1):
                if lengths[j] > latest:
                    break
                width = lengths[j + 1] - lengths[j]
                place, distance = _chord_place(points[i], vertices[j], vertices[j + 1])
                if width > 0.0:
                    inside = min(max(place, (earliest - lengths[j]) / width), (latest - lengths[j]) / width)
                    inside = min(max(inside, 0.0), 1.0)
                    if inside != place:
                        place, distance = inside, _distance_at(points[i], vertices[j], vertices[j + 1], inside)
                if choose == 0:
                    smallest = min(smallest, distance)
                    continue
                off = abs(lengths[j] + place * width - anchor - way)
                if distance <= smallest + _SAME_PLACE * tolerance and off < least_off:
                    least_off, nearest[i], passed = off, j, lengths[j] + place * width
        distances[i] = smallest
        if i % _BLOCK == _BLOCK - 1:
            anchor, anchor_at = passed, travelled[i]
    return distances, nearest


@compiled
def _chord_place(point: FloatArray, start: FloatArray, end: FloatArray) -> tuple[float, float]:
    """Nearest point of a chord, as a part of its length from 0 to 1, and its distance, mm."""
    square, along = 0.0, 0.0
    for d in range(len(point)):
        step = end[d] - start[d]
        square += step * step
        along += step * (point[d] - start[d])
    place = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
    return place, _distance_at(point, start, end, place)


@compiled
def _distance_at(point: FloatArray, start: FloatArray, end: FloatArray, place: float) -> float:
    total = 0.0
    for d in range(len(point)):
        off = point[d] - start[d] - place * (end[d] - start[d])
        total += off * off
    return float(np.sqrt(total))


def _smoothed_chain(segments: Sequence[Segment], tolerance_mm: float) -> _Chain:
    """Points of the smoothed path, without tolerances and lines: only the programmed path has these."""
    parts = [_segment_points(segment, tolerance_mm) for segment in segments]
    points = np.concatenate([parts[0][:1], *(part[1:] for part in parts)])
    return _Chain(points, np.full(len(points), tolerance_mm), np.zeros(len(points), dtype=np.int64))


def _segment_points(segment: Segment, tolerance_mm: float) -> FloatArray:
    if segment.kind == SegmentKind.LINE:
        return segment.evaluate(np.linspace(0.0, segment.length_mm, 3)).r_mm
    joints = segment.joints_mm
    start = np.unique(np.linspace(joints[:-1], joints[1:], 9))
    return _refined(lambda s_mm: segment.evaluate(s_mm).r_mm, start, tolerance_mm)


def _refined(curve: Callable[[FloatArray], FloatArray], u: FloatArray, tolerance_mm: float) -> FloatArray:
    """Points of a curve, refined until the middle of each chord is close to the curve, shape (n, dimensions)."""
    points = curve(u)
    for _ in range(_REFINEMENTS):
        middles = 0.5 * (u[:-1] + u[1:])
        between = curve(middles)
        far = np.linalg.norm(between - 0.5 * (points[:-1] + points[1:]), axis=1) > _CHORD_SHARE * tolerance_mm
        if not np.any(far):
            break
        at = np.flatnonzero(far) + 1
        u, points = np.insert(u, at, middles[far]), np.insert(points, at, between[far], axis=0)
    return points


def _programmed_chain(
    moves: Iterable[Move], dimensions: int, tolerance_mm: float, rapid_tolerance_mm: float | None
) -> _Chain:
    points, tolerances, lines = list[FloatArray](), list[FloatArray](), list[IntArray]()
    for move in moves:
        if isinstance(move, ProgramEvent):
            if move.end:
                break
            continue
        own_mm = tolerance_mm if move.mode.tolerance_mm is None else move.mode.tolerance_mm
        if isinstance(move, LineMoves):
            start, found, line = move.start_mm, move.points_mm, move.lines
            if move.rapid and rapid_tolerance_mm is not None:
                own_mm = rapid_tolerance_mm
        else:
            curve = _arc_points(move, own_mm) if isinstance(move, ArcMove) else _nurbs_points(move, own_mm)
            start, found, line = curve[0], curve[1:], np.full(len(curve) - 1, move.line)
        if not points:
            points.append(start[None, :])
            tolerances.append(np.array([own_mm]))
            lines.append(line[:1])
        points.append(found)
        tolerances.append(np.full(len(found), own_mm))
        lines.append(line)
    # A chord has the tolerance and the line of the move to which its end point belongs.
    ends, limits, numbers = np.concatenate(points), np.concatenate(tolerances), np.concatenate(lines)
    return _Chain(ends[:, :dimensions], np.append(limits[1:], limits[-1]), np.append(numbers[1:], numbers[-1]))


def _arc_points(move: ArcMove, tolerance_mm: float) -> FloatArray:
    """Points of an arc by its defining formula; the rounding error of the program is spread over the arc."""
    radial = move.start_mm - move.center_mm
    across = np.cross(move.normal, radial)
    radius = float(np.linalg.norm(radial))
    step = 2.0 * np.arccos(max(0.5, 1.0 - _CHORD_SHARE * tolerance_mm / radius))
    part = np.linspace(0.0, 1.0, max(8, int(np.ceil(move.sweep_rad / step))) + 1)[:, None]
    angle = part * move.sweep_rad
    points = move.center_mm + radial * np.cos(angle) + across * np.sin(angle) + part * move.rise_mm * move.normal
    return np.asarray(points + part * (move.end_mm - points[-1]))


def _nurbs_points(move: NurbsMove, tolerance_mm: float) -> FloatArray:
    homogeneous = np.column_stack([move.control_points_mm * move.weights[:, None], move.weights])
    spline = BSpline(move.knots, homogeneous, move.degree)

    def curve(u: FloatArray) -> FloatArray:
        value = spline(u)
        return np.asarray(value[:, :-1] / value[:, -1:])

    u = np.unique(move.knots[move.degree : len(homogeneous) + 1])
    return _refined(curve, np.unique(np.linspace(u[:-1], u[1:], 17)), tolerance_mm)
