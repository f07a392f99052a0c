"""Programmed moves that the tests of the smoothing stage share, and what they look at in its segments."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence

import numpy as np
from core_paths import toolpath_of

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.path_points import PathPoints
from feedopt_core.geometry.segments import Segment
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.programs.moves import ArcMove, LineMoves, Move, PathMode
from feedopt_core.smoothing.stage import smooth

TOLERANCE_MM = 0.01
FEED_MM_S = 150.0


def straight(
    points: Sequence[Sequence[float]] | FloatArray,
    *,
    feed_mm_s: float = FEED_MM_S,
    rapid: bool = False,
    mode: PathMode | None = None,
    first_line: int = 1,
) -> LineMoves:
    """Straight moves through points with two or three coordinates, one a line."""
    array = np.asarray(points, dtype=float)
    array = np.pad(array, ((0, 0), (0, 3 - array.shape[1])))
    count = len(array) - 1
    lines = np.arange(first_line, first_line + count, dtype=np.int64)
    feed = math.inf if rapid else feed_mm_s
    return LineMoves(array[0], array[1:], lines, np.full(count, feed), rapid, mode or PathMode())


def arc(
    start: Sequence[float],
    center: Sequence[float],
    sweep_rad: float,
    *,
    clockwise: bool = False,
    rise_mm: float = 0.0,
    line: int = 1,
    feed_mm_s: float = FEED_MM_S,
) -> ArcMove:
    """Arc or helix around z, from a start with two or three coordinates."""
    start_mm = np.pad(np.asarray(start, dtype=float), (0, 3 - len(start)))
    center_mm = np.array([center[0], center[1], start_mm[2]])
    normal = np.array([0.0, 0.0, -1.0 if clockwise else 1.0])
    radial = start_mm - center_mm
    turned = radial * math.cos(sweep_rad) + np.cross(normal, radial) * math.sin(sweep_rad)
    end_mm = center_mm + turned + rise_mm * normal
    return ArcMove(start_mm, end_mm, center_mm, normal, sweep_rad, rise_mm, line, feed_mm_s)


def smoothed(moves: Iterable[Move], dimensions: int = 2, tolerance_mm: float = TOLERANCE_MM) -> list[Segment]:
    """All segments of a program; they are known to form one toolpath."""
    segments = list(smooth(iter(moves), tolerance_mm, dimensions))
    assert toolpath_of(segments).complete
    return segments


def ends(segment: Segment) -> tuple[PathPoints, PathPoints]:
    """Start and end of a segment."""
    return segment.evaluate(np.zeros(1)), segment.evaluate(np.array([segment.length_mm]))


def assert_smooth(segments: Sequence[Segment], curvature_share: float = 1e-4) -> None:
    """Position, direction and curvature agree at every joint that is not an exact stop."""
    for before, after in itertools.pairwise(segments):
        end, start = ends(before)[1], ends(after)[0]
        assert np.allclose(end.r_mm, start.r_mm, atol=1e-9 * max(1.0, float(np.max(np.abs(end.r_mm)))))
        if before.place.exact_stop:
            continue
        assert np.linalg.norm(end.dr_ds - start.dr_ds) < 1e-7
        bend = max(np.max(np.linalg.norm(part.evaluate(_inside(part)).d2r_ds2, axis=1)) for part in (before, after))
        assert np.linalg.norm(end.d2r_ds2 - start.d2r_ds2) <= curvature_share * bend + 1e-9


def assert_counted(segments: Sequence[Segment]) -> None:
    """Sequence numbers and arc lengths run on, and the last segment says so."""
    assert [segment.place.sequence for segment in segments] == list(range(1, len(segments) + 1))
    s_mm = np.cumsum([segment.length_mm for segment in segments])
    assert np.allclose([segment.place.s_start_mm for segment in segments[1:]], s_mm[:-1], rtol=1e-12)
    assert [segment.place.last for segment in segments] == [False] * (len(segments) - 1) + [True]


def stops_mm(segments: Sequence[Segment]) -> list[FloatArray]:
    """Positions of the exact stops."""
    return [ends(segment)[1].r_mm[0] for segment in segments if segment.place.exact_stop]


def path_of(segments: Sequence[Segment]) -> Toolpath:
    """Toolpath with all segments."""
    return toolpath_of(segments)


def _inside(segment: Segment) -> FloatArray:
    return np.linspace(0.0, segment.length_mm, 33)
