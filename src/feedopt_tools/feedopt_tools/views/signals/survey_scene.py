"""All data drawn of a program and its smoothed path, computed once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.deviation import DeviationCurve, deviation_along
from feedopt_core.pipeline.survey import Survey, SurveyFigures, curvature_of, survey_figures
from feedopt_core.programs.moves import LineMoves
from feedopt_tools.views.signals.programmed import ProgrammedPath, path_of_moves

_CURVE_POINTS = 24
_LEAST_SAMPLES = 6000
"""Fewest samples of a curve along the path: with fewer, distant samples would be joined by a slope."""


@dataclass(frozen=True)
class SurveyScene:
    """All data of a survey view.

    Attributes:
        name: of the program.
        figures: of program and path.
        programmed: path before smoothing.
        strips_mm: smoothed path, one a segment, shape (n, 3) each.
        deviation: along the path; None where the programmed points are passed through.
        points_mm: ends of the straight moves, shape (n, 3).
        s_mm, curvature_per_mm: curvature along the path, shape (n,) each.
        peak_per_mm: largest curvature of each segment, shape (segments,).
        segment_s_mm, feed_mm_s: ends of the segments and the programmed feed behind them, NaN for none, shape
            (segments + 1,) each.
    """

    name: str
    figures: SurveyFigures
    programmed: ProgrammedPath
    strips_mm: tuple[FloatArray, ...]
    points_mm: FloatArray
    deviation: DeviationCurve | None
    s_mm: FloatArray
    curvature_per_mm: FloatArray
    peak_per_mm: FloatArray
    segment_s_mm: FloatArray
    feed_mm_s: FloatArray

    @property
    def path_mm(self) -> FloatArray:
        """Points of the smoothed path, shape (n, 3)."""
        return np.concatenate(self.strips_mm)


def survey_scene(name: str, survey: Survey) -> SurveyScene:
    """Data drawn of a survey."""
    strips, curvature = list[FloatArray](), list[tuple[FloatArray, FloatArray]]()
    for segment in survey.segments:
        along_mm = np.linspace(0.0, segment.length_mm, 2 if segment.kind == 0 else _CURVE_POINTS)
        points_mm = segment.evaluate(along_mm).r_mm
        strips.append(np.pad(points_mm, ((0, 0), (0, 3 - points_mm.shape[1]))))
        curvature.append(curvature_of(segment))
    last = survey.segments[-1]
    end_mm = last.place.s_start_mm + last.length_mm
    feeds = np.array([segment.place.feed_limit_mm_s for segment in (*survey.segments, last)])
    deviation = None
    if survey.deviation is not None:
        found = deviation_along(survey.moves, survey.segments, survey.tolerance_mm)
        at_mm, off_mm = _filled(found.s_mm, found.deviation_mm)
        deviation = DeviationCurve(at_mm, off_mm, np.interp(at_mm, found.s_mm, found.tolerance_mm))
    s_mm, curvature_per_mm = _filled(
        np.concatenate([at_mm for at_mm, _ in curvature]), np.concatenate([values for _, values in curvature])
    )
    points = [move.points_mm for move in survey.moves if isinstance(move, LineMoves)]
    return SurveyScene(
        name=name,
        figures=survey_figures(survey),
        programmed=path_of_moves(survey.moves),
        strips_mm=tuple(strips),
        points_mm=np.concatenate([np.empty((0, 3)), *points]),
        deviation=deviation,
        s_mm=s_mm,
        curvature_per_mm=curvature_per_mm,
        peak_per_mm=np.array([np.max(values) for _, values in curvature]),
        segment_s_mm=np.array([*(segment.place.s_start_mm for segment in survey.segments), end_mm]),
        feed_mm_s=np.where(np.isfinite(feeds), feeds, np.nan),
    )


def _filled(s_mm: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A curve with additional points on long chords."""
    more_mm = np.linspace(s_mm[0], s_mm[-1], _LEAST_SAMPLES)
    order = np.argsort(np.concatenate([s_mm, more_mm]), kind="stable")
    found = np.concatenate([values, np.interp(more_mm, s_mm, values)])
    return np.concatenate([s_mm, more_mm])[order], found[order]


def survey_rows(figures: SurveyFigures) -> list[tuple[str, str]]:
    """Figures as pairs of name and text, for tables."""
    kinds = ", ".join(f"{count} {kind}" for kind, count in figures.segments.items())
    by_kind = {
        "straight": figures.straight_moves,
        "rapid": figures.rapid_moves,
        "arc": figures.arc_moves,
        "NURBS": figures.nurbs_moves,
    }
    rows = [
        ("lines", f"{figures.lines}"),
        ("moves", ", ".join(f"{count} {kind}" for kind, count in by_kind.items() if count)),
        ("segments", kinds),
        ("length", f"{figures.length_mm:.3f} mm, of it {figures.rapid_length_mm:.3f} mm rapids"),
        ("box", " to ".join(_place(corner) for corner in (figures.low_mm, figures.high_mm)) + " mm"),
        ("corners above 10 degrees", f"{figures.corners}"),
        ("exact stops", f"{figures.exact_stops}" + (f", dwell {figures.dwell_s:g} s" if figures.dwell_s else "")),
        ("shortest segment", f"{figures.shortest_segment_mm:.4g} mm, line {figures.shortest_segment_line}"),
        ("curvature", _curvature(figures)),
        ("deviation", _deviation(figures)),
        ("programmed feed", _feed(figures)),
    ]
    if figures.events:
        rows.append(("events", ", ".join(f"{text} ({count})" for text, count in figures.events.items())))
    rows.append(("read in", f"{1e3 * figures.parse_time_s:.1f} ms"))
    rows.append(("smoothed in", f"{1e3 * figures.smoothing_time_s:.1f} ms"))
    return rows


def _place(corner_mm: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{value:.3f}" for value in corner_mm) + ")"


def _curvature(figures: SurveyFigures) -> str:
    if math.isinf(figures.smallest_radius_mm):
        return "none: all straight"
    return (
        f"up to {figures.largest_curvature_per_mm:.4g} 1/mm, radius {figures.smallest_radius_mm:.4g} mm, "
        f"line {figures.largest_curvature_line}"
    )


def _deviation(figures: SurveyFigures) -> str:
    if figures.worst_deviation_mm is None or figures.deviation_ratio is None:
        return "none: the programmed points are passed through"
    return (
        f"up to {figures.worst_deviation_mm:.6f} mm, {100.0 * figures.deviation_ratio:.1f} % of the tolerance, "
        f"line {figures.worst_deviation_line}"
    )


def _feed(figures: SurveyFigures) -> str:
    if figures.feed_mm_s is None:
        return "none: the machine's limits alone hold"
    low, high = figures.feed_mm_s
    return f"{low:.4g} mm/s" if low == high else f"{low:.4g} to {high:.4g} mm/s"
