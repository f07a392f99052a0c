"""What is said of a program: figures that can be counted by hand, and curvature and deviation of known shapes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from feedopt_core.audit.deviation import deviation_along, measure_deviation
from feedopt_core.errors import ToolpathError
from feedopt_core.pipeline.survey import count_corners, needed_dimensions, survey_figures, survey_program
from feedopt_core.programs.moves import ArcMove, LineMoves, NurbsMove

UP = np.array([0.0, 0.0, 1.0])
POCKET = """G21 G90 G94 G64 P0.02
M3 S12000
G0 X10 Y0
F1200
G1 X20
G3 X20 Y10 I0 J5
M8
G1 X10 F600
G61
Y0
M2
"""


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def lines_through(*points: tuple[float, ...], rapid: bool = False) -> LineMoves:
    points_mm = np.array([[*point, 0.0][:3] for point in points])
    count = len(points) - 1
    return LineMoves(points_mm[0], points_mm[1:], np.arange(1, count + 1), np.full(count, 10.0), rapid)


def test_figures_of_a_pocket(tmp_path: Path) -> None:
    figures = survey_figures(survey_program(written(tmp_path, "pocket.ngc", POCKET)))
    assert figures.lines == 11
    assert (figures.straight_moves, figures.rapid_moves, figures.arc_moves, figures.nurbs_moves) == (3, 1, 1, 0)
    assert sum("M3" in text for text in figures.events) == 1
    # Line to arc and arc to line are tangent; the last corner is an exact stop or rounded, and a corner either way.
    assert figures.corners == 1
    assert figures.feed_mm_s == (10.0, 20.0)
    assert figures.rapid_length_mm == pytest.approx(10.0, abs=0.1)
    assert figures.length_mm == pytest.approx(10.0 + 10.0 + 5.0 * math.pi + 10.0 + 10.0, rel=2e-3)
    assert figures.deviation_ratio is not None and figures.deviation_ratio <= 1.005
    assert np.allclose(figures.low_mm, [0.0, 0.0], atol=0.02)
    assert np.allclose(figures.high_mm, [25.0, 10.0], atol=0.02)


def test_circle_has_its_radius(tmp_path: Path) -> None:
    text = "G21 G90 F600\nG3 X0 Y0 I8 J0\nM2\n"
    figures = survey_figures(survey_program(written(tmp_path, "circle.ngc", text)))
    assert figures.largest_curvature_per_mm == pytest.approx(0.125, rel=1e-9)
    assert figures.smallest_radius_mm == pytest.approx(8.0, rel=1e-9)
    assert figures.length_mm == pytest.approx(16.0 * math.pi, rel=1e-12)
    assert figures.segments == {"arc": 1}
    assert figures.corners == 0


def test_straight_program_has_no_radius(tmp_path: Path) -> None:
    figures = survey_figures(survey_program(written(tmp_path, "line.ngc", "G21 G90 F600\nG1 X10\nM2\n")))
    assert math.isinf(figures.smallest_radius_mm)
    assert figures.length_mm == 10.0
    assert figures.deviation_ratio == 0.0


def test_points_are_passed_through(tmp_path: Path) -> None:
    survey = survey_program(written(tmp_path, "points.csv", "0,0\n4,1\n8,0\n10,3\n"))
    figures = survey_figures(survey)
    assert survey.deviation is None and figures.deviation_ratio is None
    assert (figures.straight_moves, figures.feed_mm_s) == (3, None)
    through = [segment.evaluate(np.zeros(1)).r_mm[0] for segment in survey.segments]
    assert np.allclose(through[0], [0.0, 0.0])


def test_dimensions_are_those_that_the_program_needs(tmp_path: Path) -> None:
    flat = survey_program(written(tmp_path, "flat.ngc", "G21 G90 F600\nG0 Z5\nG1 X10\nM2\n"))
    deep = survey_program(written(tmp_path, "deep.ngc", "G21 G90 F600\nG0 Z5\nG1 X10 Z4\nM2\n"))
    assert (flat.dimensions, deep.dimensions) == (2, 3)
    with pytest.raises(ToolpathError, match="no axis for it") as caught:
        survey_program(tmp_path / "deep.ngc", dimensions=2)
    assert caught.value.line == 3 and caught.value.source.endswith("deep.ngc")
    with pytest.raises(ToolpathError, match="no axis for it"):
        survey_program(written(tmp_path, "points.csv", "0,0,0\n4,1,2\n8,0,0\n"), dimensions=2)


def test_tilted_circle_needs_three_coordinates() -> None:
    start, normal = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    tilted = ArcMove(start, start, np.zeros(3), normal, 2.0 * math.pi, 0.0, 1, 10.0)
    assert needed_dimensions([tilted]) == 3
    assert needed_dimensions([ArcMove(start, start, np.zeros(3), UP, 2.0 * math.pi, 0.0, 1, 10.0)]) == 2


@pytest.mark.parametrize(("turn_deg", "corners"), [(0.0, 0), (9.0, 0), (11.0, 1), (90.0, 1), (180.0, 1)])
def test_corners_are_joints_that_turn_by_more_than_ten_degrees(turn_deg: float, corners: int) -> None:
    turn = math.radians(turn_deg)
    along = (5.0 + math.cos(turn), math.sin(turn))
    assert count_corners([lines_through((0.0, 0.0), (5.0, 0.0), along)]) == corners
    # The same joint between two moves of different kinds.
    quarter = ArcMove(
        np.array([5.0, 0.0, 0.0]),
        np.array([5.0 + math.sin(0.5), 1.0 - math.cos(0.5), 0.0]),
        np.array([5.0, 1.0, 0.0]),
        UP,
        0.5,
        0.0,
        2,
        10.0,
    )
    end = quarter.end_mm[:2]
    behind = (float(end[0] + math.cos(0.5 + turn)), float(end[1] + math.sin(0.5 + turn)))
    moves = [lines_through((0.0, 0.0), (5.0, 0.0)), quarter, lines_through((*end.tolist(),), behind)]
    assert count_corners(moves) == corners


def test_corner_at_the_end_of_a_curve_counts_once() -> None:
    control_mm = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 1.0, 0.0], [2.0, 2.0, 0.0]])
    curve = NurbsMove(3, np.repeat([0.0, 1.0], 4), control_mm, np.ones(4), 1, 10.0)
    assert count_corners([curve, lines_through((2.0, 2.0), (4.0, 2.0))]) == 1
    assert count_corners([curve, lines_through((2.0, 2.0), (2.0, 5.0))]) == 0


def test_zero_length_moves_have_no_direction() -> None:
    assert count_corners([lines_through((0.0, 0.0), (5.0, 0.0), (5.0, 0.0), (9.0, 0.0))]) == 0


def test_deviation_along_the_path_agrees_with_its_worst_place(tmp_path: Path) -> None:
    """At a corner of 90 degrees the corner point is farthest from the curve, and the curve shows it there."""
    text = "G21 G90 F600\nG1 X20\nY20\nM2\n"
    survey = survey_program(written(tmp_path, "corner.ngc", text), tolerance_mm=0.05)
    along = deviation_along(survey.moves, survey.segments, 0.05)
    worst = measure_deviation(survey.moves, survey.segments, 0.05)
    assert np.all(np.diff(along.s_mm) >= 0.0)
    assert along.s_mm[-1] == pytest.approx(survey_figures(survey).length_mm, rel=1e-6)
    assert worst.worst_mm == pytest.approx(0.05, rel=1e-2)
    assert np.max(along.deviation_mm) == worst.worst_mm
    # Beside the corner the curve is nearer to the lines than the corner is to the curve, by sqrt 2 on the diagonal.
    others = np.sort(along.deviation_mm)[:-1]
    assert np.max(others) == pytest.approx(worst.worst_mm / math.sqrt(2.0), rel=1e-3)
    assert np.all(along.tolerance_mm == 0.05)
    corner_s_mm = along.s_mm[int(np.argmax(along.deviation_mm))]
    assert corner_s_mm == pytest.approx(20.0, abs=0.1)


def test_lines_of_a_file_are_counted_with_and_without_a_last_newline(tmp_path: Path) -> None:
    text = "G21 G90 F600\nG1 X10\nM2"
    assert survey_program(written(tmp_path, "a.ngc", text)).lines == 3
    assert survey_program(written(tmp_path, "b.ngc", text + "\n")).lines == 3
