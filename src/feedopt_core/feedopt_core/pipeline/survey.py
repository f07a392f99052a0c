"""Survey of a program without a machine: figures of its moves and of its smoothed path."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.audit.deviation import DeviationReport, measure_deviation
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import Segment, SegmentKind
from feedopt_core.pipeline.read_program import ProgramKind, open_program, read_moves
from feedopt_core.pipeline.warm_up import warm_up_reading
from feedopt_core.programs.layers.transitions import LayerTransitions
from feedopt_core.programs.moves import ArcMove, LineMoves, Move, NurbsMove, ProgramEvent
from feedopt_core.programs.points_csv import read_points
from feedopt_core.smoothing.cubic_spline import DEFAULT_TOLERANCE_MM, interpolate_points
from feedopt_core.smoothing.stage import smooth

_CORNER_RAD = math.radians(10.0)
_LEVEL_MM = 1e-9
_BLOCK_BYTES = 1 << 20
_SPAN_POINTS = 16


@dataclass(frozen=True)
class Survey:
    """A program with its smoothed path.

    Attributes:
        moves: programmed moves; for a list of points, the straight moves between them.
        segments: segments of the smoothed path, at least one.
        dimensions: coordinates of the path, 2 or 3.
        tolerance_mm: largest deviation where the program gives none.
        deviation: of the smoothed from the programmed path; None for points, which are passed through.
        lines: number of lines in the file.
        parse_time_s: time to read the file into moves.
        smoothing_time_s: time to smooth the moves into segments.
    """

    moves: tuple[Move, ...]
    segments: tuple[Segment, ...]
    dimensions: int
    tolerance_mm: float
    deviation: DeviationReport | None
    lines: int
    parse_time_s: float
    smoothing_time_s: float


@dataclass(frozen=True)
class SurveyFigures:
    """Figures of a program and of its smoothed path.

    Attributes:
        lines: number of lines in the file.
        straight_moves, rapid_moves, arc_moves, nurbs_moves: number of programmed moves of each kind.
        events: number of words without motion, by their text.
        segments: number of segments of the smoothed path, by kind.
        length_mm: length of the smoothed path.
        rapid_length_mm: length of its rapid moves.
        corners: programmed joints that turn by more than 10 degrees.
        exact_stops: places of the smoothed path where the machine comes to standstill, without its end.
        dwell_s: sum of the programmed dwells.
        shortest_segment_mm, shortest_segment_line: shortest segment of the smoothed path, and its line.
        largest_curvature_per_mm, largest_curvature_line: largest curvature of the smoothed path, and its line.
        smallest_radius_mm: one over the largest curvature; infinity where the whole path is straight.
        worst_deviation_mm, worst_deviation_line: deviation where its ratio to the tolerance is largest, and its line;
            None for points.
        deviation_ratio: deviation over tolerance there; None for points.
        feed_mm_s: least and largest programmed feed; None where there is none.
        low_mm, high_mm: corners of the bounding box of the smoothed path.
        parse_time_s, smoothing_time_s: see :class:`Survey`.
    """

    lines: int
    straight_moves: int
    rapid_moves: int
    arc_moves: int
    nurbs_moves: int
    events: dict[str, int]
    segments: dict[str, int]
    length_mm: float
    rapid_length_mm: float
    corners: int
    exact_stops: int
    dwell_s: float
    shortest_segment_mm: float
    shortest_segment_line: int
    largest_curvature_per_mm: float
    largest_curvature_line: int
    smallest_radius_mm: float
    worst_deviation_mm: float | None
    worst_deviation_line: int | None
    deviation_ratio: float | None
    feed_mm_s: tuple[float, float] | None
    low_mm: tuple[float, ...]
    high_mm: tuple[float, ...]
    parse_time_s: float
    smoothing_time_s: float


def survey_program(
    path: Path,
    dimensions: int | None = None,
    tolerance_mm: float = DEFAULT_TOLERANCE_MM,
    transitions: LayerTransitions | None = None,
) -> Survey:
    """Read and smooth a program file.

    Args:
        path: program file.
        dimensions: coordinates of the machine, 2 or 3; None: as many as the program needs.
        tolerance_mm: largest distance of the smoothed from the programmed path, above zero.
        transitions: replace the moves between layers of closed contours; None: keep all as programmed.

    Raises:
        ToolpathError: see :func:`feedopt_core.pipeline.read_program.read_program`.
    """
    program, source = open_program(path), str(path)
    warm_up_reading()
    began_s = time.perf_counter()
    try:
        if program.kind is ProgramKind.POINTS and transitions is None:
            points = read_points(program.lines(source), source)
            points_mm, lines = points.points_mm, np.array(points.lines)
            moves: tuple[Move, ...] = (_straight_moves(points_mm, lines),)
        else:
            moves = tuple(read_moves(program, source, transitions))
        parsed_s = time.perf_counter()
        coordinates = dimensions or needed_dimensions(moves)
        if program.kind is ProgramKind.POINTS:
            if needed_dimensions(moves) > coordinates:
                raise ToolpathError("has a z coordinate, the machine has no axis for it", line=int(lines[0]), column=1)
            through_mm = np.pad(points_mm, ((0, 0), (0, 3 - points_mm.shape[1])))[:, :coordinates]
            segments = tuple[Segment, ...](interpolate_points(through_mm, points.lines, tolerance_mm))
        else:
            segments = tuple(smooth(iter(moves), tolerance_mm, coordinates))
    except ToolpathError as error:
        error.source = source
        raise
    smoothed_s = time.perf_counter()
    deviation = None if program.kind is ProgramKind.POINTS else measure_deviation(moves, segments, tolerance_mm)
    times_s = parsed_s - began_s, smoothed_s - parsed_s
    return Survey(moves, segments, coordinates, tolerance_mm, deviation, _count_lines(path), *times_s)


def needed_dimensions(moves: Sequence[Move]) -> int:
    """Number of coordinates that a machine needs for moves: 2 if all of them stay at one height, else 3."""
    heights = [_heights_mm(move) for move in moves if not isinstance(move, ProgramEvent)]
    tilted = any(isinstance(move, ArcMove) and abs(abs(move.normal[2]) - 1.0) > _LEVEL_MM for move in moves)
    return 3 if tilted or (heights and float(np.ptp(np.concatenate(heights))) > _LEVEL_MM) else 2


def survey_figures(survey: Survey) -> SurveyFigures:
    """Figures of a survey."""
    places = [segment.place for segment in survey.segments]
    lengths_mm = np.array([segment.length_mm for segment in survey.segments])
    curvature = [float(np.max(curvature_of(segment)[1])) for segment in survey.segments]
    sharpest, shortest = int(np.argmax(curvature)), int(np.argmin(lengths_mm))
    feeds_mm_s = [place.feed_limit_mm_s for place in places if math.isfinite(place.feed_limit_mm_s)]
    lines = [move for move in survey.moves if isinstance(move, LineMoves)]
    points_mm = np.concatenate([segment.evaluate(_stations_mm(segment)).r_mm for segment in survey.segments])
    worst = survey.deviation
    return SurveyFigures(
        lines=survey.lines,
        straight_moves=sum(len(move.lines) for move in lines if not move.rapid),
        rapid_moves=sum(len(move.lines) for move in lines if move.rapid),
        arc_moves=sum(isinstance(move, ArcMove) for move in survey.moves),
        nurbs_moves=sum(isinstance(move, NurbsMove) for move in survey.moves),
        events=dict(Counter(move.text for move in survey.moves if isinstance(move, ProgramEvent) and move.text)),
        segments=dict(Counter(SegmentKind(segment.kind).name.lower() for segment in survey.segments)),
        length_mm=float(np.sum(lengths_mm)),
        rapid_length_mm=float(np.sum(lengths_mm[[place.rapid for place in places]])),
        corners=count_corners(survey.moves),
        exact_stops=sum(place.exact_stop and not place.last for place in places),
        dwell_s=sum(place.dwell_s for place in places),
        shortest_segment_mm=float(lengths_mm[shortest]),
        shortest_segment_line=places[shortest].source_line,
        largest_curvature_per_mm=curvature[sharpest],
        largest_curvature_line=places[sharpest].source_line,
        smallest_radius_mm=1.0 / curvature[sharpest] if curvature[sharpest] > 0.0 else math.inf,
        worst_deviation_mm=None if worst is None else worst.worst_mm,
        worst_deviation_line=None if worst is None else worst.line,
        deviation_ratio=None if worst is None else worst.ratio,
        feed_mm_s=(min(feeds_mm_s), max(feeds_mm_s)) if feeds_mm_s else None,
        low_mm=tuple(np.min(points_mm, axis=0).tolist()),
        high_mm=tuple(np.max(points_mm, axis=0).tolist()),
        parse_time_s=survey.parse_time_s,
        smoothing_time_s=survey.smoothing_time_s,
    )


def count_corners(moves: Sequence[Move]) -> int:
    """Joints of programmed moves that turn by more than 10 degrees."""
    ends = [_end_directions(move) for move in moves if not isinstance(move, ProgramEvent)]
    if not ends:
        return 0
    leaving, arriving = (np.concatenate([pair[side] for pair in ends]) for side in (0, 1))
    chord = np.linalg.norm(leaving[1:] - arriving[:-1], axis=1)
    return int(np.count_nonzero(chord > 2.0 * math.sin(0.5 * _CORNER_RAD)))


def curvature_of(segment: Segment) -> tuple[FloatArray, FloatArray]:
    """Curvature along a segment.

    Returns:
        Arc lengths from the start of the program, increasing, and curvature there, 1/mm, shape (n,) each.
    """
    at_mm = _stations_mm(segment)
    return segment.place.s_start_mm + at_mm, np.linalg.norm(segment.evaluate(at_mm).d2r_ds2, axis=1)


def _straight_moves(points_mm: FloatArray, lines: IntArray) -> LineMoves:
    inside_mm = np.pad(points_mm, ((0, 0), (0, 3 - points_mm.shape[1])))
    return LineMoves(inside_mm[0], inside_mm[1:], lines[1:], np.full(len(lines) - 1, math.inf))


def _heights_mm(move: LineMoves | ArcMove | NurbsMove) -> FloatArray:
    if isinstance(move, LineMoves):
        return move.points_mm[:, 2]
    if isinstance(move, ArcMove):
        return np.array([move.start_mm[2], move.end_mm[2]])
    return move.control_points_mm[:, 2]


def _stations_mm(segment: Segment) -> FloatArray:
    """Arc lengths from the start of a segment with its joints, dense enough to find the largest curvature."""
    if segment.kind is SegmentKind.LINE:
        return segment.joints_mm
    joints = segment.joints_mm
    return np.unique(np.linspace(joints[:-1], joints[1:], _SPAN_POINTS + 1))


def _end_directions(move: LineMoves | ArcMove | NurbsMove) -> tuple[FloatArray, FloatArray]:
    """Unit directions in which each piece of a move starts and ends, shape (n, 3) each."""
    if isinstance(move, ArcMove):
        radial = move.start_mm - move.center_mm
        across, rise = np.cross(move.normal, radial), move.normal * (move.rise_mm / move.sweep_rad)
        leaving = across + rise
        arriving = across * math.cos(move.sweep_rad) - radial * math.sin(move.sweep_rad) + rise
        return _units(leaving[None, :]), _units(arriving[None, :])
    if isinstance(move, LineMoves):
        each = _units(np.diff(np.concatenate([move.start_mm[None, :], move.points_mm]), axis=0))
        return each, each
    legs = _units(np.diff(move.control_points_mm, axis=0))
    return legs[:1], legs[-1:]


def _units(ways: FloatArray) -> FloatArray:
    """Unit directions of the displacements that are not zero, shape (m, dimensions)."""
    lengths = np.linalg.norm(ways, axis=1)
    return np.asarray(ways[lengths > 0.0] / lengths[lengths > 0.0, None])


def _count_lines(path: Path) -> int:
    with path.open("rb") as file:
        count, last = 0, b"\n"
        while block := file.read(_BLOCK_BYTES):
            count, last = count + block.count(b"\n"), block[-1:]
    return count + (last != b"\n")
