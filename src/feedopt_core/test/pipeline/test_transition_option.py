"""Layer transitions as an option: from the words of a goal to the segments of a program of stacked circles."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import Segment
from feedopt_core.pipeline.read_program import Program, read_moves, read_program
from feedopt_core.pipeline.survey import survey_program
from feedopt_core.programs.layers.transitions import LayerTransitions, TransitionSide

RADIUS_MM, REACH_MM = 20.0, 4.0


def stacked_circles(layers: int = 3) -> str:
    """Full circles of four rational quarters, anticlockwise, one below the other."""
    r, half = RADIUS_MM, math.sqrt(0.5)
    ring = [(r, 0), (r, r), (0, r), (-r, r), (-r, 0), (-r, -r), (0, -r), (r, -r), (r, 0)]
    curves = [
        {
            "degree": 2,
            "knots": [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4],
            "control_points_mm": [[x, y, -float(layer)] for x, y in ring],
            "weights": [1, half, 1, half, 1, half, 1, half, 1],
        }
        for layer in range(layers)
    ]
    return json.dumps({"feed_mm_s": 40, "curves": curves})


def read(transitions: LayerTransitions | None) -> list[Segment]:
    return list(read_program(stacked_circles(), "circles.json", 3, 0.01, transitions))


def farthest_mm(segments: list[Segment]) -> tuple[float, float]:
    """Least and largest distance from the axis of the circles."""
    points = [segment.evaluate(np.linspace(0.0, segment.length_mm, 50)).r_mm for segment in segments]
    distances = np.linalg.norm(np.concatenate(points)[:, :2], axis=1)
    return float(np.min(distances)), float(np.max(distances))


@pytest.mark.parametrize(
    ("words", "side"),
    [("", TransitionSide.OUTSIDE), ("outside", TransitionSide.OUTSIDE), ("inside", TransitionSide.INSIDE)],
)
def test_words_of_a_goal(words: str, side: TransitionSide) -> None:
    assert LayerTransitions.requested(4.0, words) == LayerTransitions(4.0, side)
    assert LayerTransitions.requested(0.0, words) is None


@pytest.mark.parametrize(
    ("reach_mm", "side", "message"),
    [(-1.0, "outside", "must be above zero"), (math.nan, "", "must be above zero"), (4.0, "above", "no side 'above'")],
)
def test_what_no_transition_can_be_is_refused(reach_mm: float, side: str, message: str) -> None:
    with pytest.raises(ToolpathError, match=message):
        LayerTransitions.requested(reach_mm, side)


def test_without_the_option_the_machine_stops_between_layers() -> None:
    segments = read(None)
    assert sum(segment.place.rapid for segment in segments) >= 2
    assert farthest_mm(segments)[1] == pytest.approx(RADIUS_MM, abs=0.011)


@pytest.mark.parametrize("side", list(TransitionSide))
def test_with_the_option_one_curve_leads_down_on_the_side_that_is_free(side: TransitionSide) -> None:
    segments = read(LayerTransitions(REACH_MM, side))
    assert not any(segment.place.rapid for segment in segments)
    assert not any(segment.place.exact_stop for segment in segments[:-1])
    low_mm, high_mm = farthest_mm(segments)
    if side is TransitionSide.OUTSIDE:
        assert high_mm == pytest.approx(RADIUS_MM + REACH_MM, rel=0.02)
        assert low_mm == pytest.approx(RADIUS_MM, abs=0.011)
    else:
        assert high_mm == pytest.approx(RADIUS_MM, abs=0.011)
        assert low_mm < RADIUS_MM - 0.9


def test_survey_measures_the_deviation_from_the_transitions(tmp_path: Path) -> None:
    path = tmp_path / "circles.json"
    path.write_text(stacked_circles(), encoding="utf-8")
    survey = survey_program(path, transitions=LayerTransitions(REACH_MM))
    assert survey.deviation is not None and survey.deviation.holds
    assert len(survey.moves) == len(list(read_moves(Program.from_text(stacked_circles()), "circles.json"))) == 5


def test_a_list_of_points_has_no_layers() -> None:
    with pytest.raises(ToolpathError, match="list of points"):
        list(read_program("0,0\n5,1\n9,4\n", "points.csv", 2, 0.01, LayerTransitions(4.0)))
