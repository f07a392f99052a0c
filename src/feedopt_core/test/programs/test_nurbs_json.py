"""NURBS programs in JSON: what is read, what is refused, and where it says so."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.programs.moves import LineMoves, NurbsMove
from feedopt_core.programs.nurbs_json import read_nurbs_json

QUARTER = {
    "degree": 2,
    "knots": [0, 0, 0, 1, 1, 1],
    "control_points_mm": [[10, 0], [10, 10], [0, 10]],
    "weights": [1, math.sqrt(0.5), 1],
}


def program(*curves, **keys):
    return json.dumps({"curves": list(curves), **keys}, indent=1)


def moves_of(text):
    return list(read_nurbs_json(text, "part.json"))


def changed(**keys):
    return QUARTER | keys


def test_quarter_circle_is_one_move_on_the_circle():
    (move,) = moves_of(program(QUARTER, feed_mm_s=40))
    assert isinstance(move, NurbsMove)
    assert move.feed_mm_s == 40.0
    assert move.line == 3
    assert move.control_points_mm.shape == (3, 3)
    curve = NurbsCurve.from_control_net(move.degree, move.knots, move.control_points_mm, move.weights)
    assert np.linalg.norm(curve.evaluate(np.linspace(0, 1, 50))[0], axis=1) == pytest.approx(np.full(50, 10.0))


def test_weights_default_to_one_and_feed_to_the_machines_limits():
    curve = {key: value for key, value in QUARTER.items() if key != "weights"}
    (move,) = moves_of(program(curve))
    assert move.weights == pytest.approx(np.ones(3))
    assert move.feed_mm_s == math.inf


def test_a_curves_own_feed_comes_before_the_programs():
    first, second = moves_of(
        program(QUARTER, changed(control_points_mm=[[0, 10], [5, 10], [9, 9]], feed_mm_s=7), feed_mm_s=5)
    )
    assert (first.feed_mm_s, second.feed_mm_s) == (5.0, 7.0)


def test_rapid_leads_to_a_curve_that_starts_elsewhere():
    apart = changed(control_points_mm=[[20, 0, 1], [20, 10, 1], [0, 20, 1]])
    first, rapid, second = moves_of(program(QUARTER, apart))
    assert isinstance(rapid, LineMoves) and rapid.rapid
    assert rapid.start_mm == pytest.approx(first.control_points_mm[-1])
    assert rapid.points_mm[0] == pytest.approx([20, 0, 1])
    assert rapid.lines[0] == second.line > first.line


def test_curve_that_starts_at_the_end_but_for_rounding_starts_there_exactly():
    near = changed(control_points_mm=[[1e-8, 10], [5, 10], [9, 9]])
    first, second = moves_of(program(QUARTER, near))
    assert np.array_equal(second.control_points_mm[0], first.control_points_mm[-1])


def test_degree_one_is_straight_moves():
    corner = {"degree": 1, "knots": [0, 0, 1, 3, 3], "control_points_mm": [[0, 0], [1, 0], [1, 2]]}
    (move,) = moves_of(program(corner, feed_mm_s=3))
    assert isinstance(move, LineMoves) and not move.rapid
    assert move.points_mm == pytest.approx(np.array([[1, 0, 0], [1, 2, 0]]))
    assert move.feed_mm_s == pytest.approx([3, 3])


REFUSED = {
    "zero weight": (changed(weights=[1, 0, 1]), "curve 1: weight 2 is 0"),
    "negative weight": (changed(weights=[1, -2, 1]), "weight 2 is -2"),
    "weights too different": (changed(weights=[1, 1e-9, 1]), "factor of"),
    "too few weights": (changed(weights=[1, 1]), "2 weights for 3"),
    "weights of text": (changed(weights=[1, "1", 1]), "entry 2 is not a finite number"),
    "falling knots": (changed(knots=[0, 0, 0.5, 0.4, 1, 1]), "knot 4 is smaller"),
    "knots of one value": (changed(knots=[1] * 6), "whole span"),
    "knots a hair apart": (
        changed(knots=[0, 0, 0, 1e-12, 1, 1, 1], control_points_mm=[[0, 0], [1, 0], [2, 1], [3, 3]], weights=[1] * 4),
        "make them equal",
    ),
    "unclamped knots": (changed(knots=[0, 1, 2, 3, 4, 5]), "not clamped"),
    "too few knots": (changed(knots=[0, 0, 0, 1, 1]), "5 knots; degree 2 with 3 control points needs 6"),
    "broken inside": (
        {"degree": 2, "knots": [0, 0, 0, 1, 1, 1, 2, 2, 2], "control_points_mm": [[i, i * i] for i in range(6)]},
        "repeats a knot inside 3 times",
    ),
    "end knot once too often": (
        {"degree": 2, "knots": [0, 0, 0, 0, 1, 1, 1], "control_points_mm": [[i, i * i] for i in range(4)]},
        "end knot more than 3",
    ),
    "degree": (changed(degree=2.5), "degree from 1"),
    "degree too high": (changed(degree=1000), "degree from 1"),
    "degree true": (changed(degree=True), "degree from 1"),
    "too few points": (changed(degree=3), "3 control points; degree 3"),
    "points of mixed dimensions": (changed(control_points_mm=[[0, 0], [1, 1, 1], [2, 0]]), "control point 2 has 3"),
    "points of one coordinate": (changed(control_points_mm=[[0], [1], [2]]), "control point 1 has 1"),
    "points are a number": (changed(control_points_mm=3), "needs control_points_mm"),
    "null point": (changed(control_points_mm=[[0, 0], None, [2, 0]]), "control point 2"),
    "coordinate out of range": (changed(control_points_mm=[[0, 0], [1e9, 1], [2, 0]]), "further than"),
    "all points one": (changed(control_points_mm=[[1, 1]] * 3), "no length"),
    "feed zero": (changed(feed_mm_s=0), "feed_mm_s must be"),
    "unknown key": (changed(wieghts=[1, 1, 1]), "'wieghts'; there are: degree"),
    "no object": ([1, 2], "needs an object"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_curve_and_line(name):
    curve, said = REFUSED[name]
    with pytest.raises(ToolpathError, match=said) as caught:
        moves_of(program(curve))
    assert caught.value.source == "part.json"
    assert caught.value.line == (1 if name == "no object" else 3)


def test_refused_curve_is_named_by_its_own_line():
    text = program(QUARTER, changed(weights=[1, 0, 1]))
    with pytest.raises(ToolpathError, match="curve 2") as caught:
        moves_of(text)
    assert text.splitlines()[caught.value.line - 1].strip() == "{"
    assert '"degree"' in text.splitlines()[caught.value.line]
    assert caught.value.line > 10


@pytest.mark.parametrize(
    ("text", "line", "column", "said"),
    [
        ('{"curves": [\n  degree\n]}', 2, 3, "is not JSON"),
        ("", 1, 1, "is not JSON"),
        ("[" * 100_000, 1, 0, "nested too deeply"),
        ('{"curves": []}', 1, 0, "at least one curve"),
        ('{"curves": {}}', 1, 0, "at least one curve"),
        ('{"curves": [{"degree": 1, "control_points_mm": [[0, 1e999], [1, 1]]}]}', 1, 0, "entry 2 is not a finite"),
        ("[]", 1, 0, "needs an object"),
        ('{"curves": [{}], "feed": 3}', 1, 0, "'feed'; there are: curves"),
        ('{"curves": [{}], "feed_mm_s": "fast"}', 1, 0, "feed_mm_s must be"),
        ('{"curves": [{"degree": NaN}]}', 1, 0, "holds NaN"),
        ('{"curves": [], "curves": []}', 1, 0, "'curves' twice"),
        ('{"curves": [{"degree": ' + "9" * 5000 + "}]}", 1, 0, "degree from 1"),
    ],
)  # fmt: skip
def test_broken_documents(text, line, column, said):
    with pytest.raises(ToolpathError, match=said) as caught:
        moves_of(text)
    assert (caught.value.line, caught.value.column) == (line, column)


numbers = st.one_of(st.floats(), st.integers(), st.sampled_from([0, 1, 2, 0.5, 1e-12, 1e300]))
things = st.recursive(
    st.one_of(st.none(), st.booleans(), numbers, st.text(max_size=5)),
    lambda inner: st.one_of(st.lists(inner, max_size=6), st.dictionaries(st.text(max_size=5), inner, max_size=4)),
    max_leaves=12,
)
broken_curves = st.fixed_dictionaries(
    {},
    optional={
        "degree": st.one_of(st.integers(-1, 5), things),
        "knots": st.one_of(st.lists(numbers, max_size=8), st.just([0, 0, 0, 1, 1, 1]), things),
        "control_points_mm": st.one_of(st.lists(st.lists(numbers, min_size=2, max_size=3), max_size=5), things),
        "weights": st.one_of(st.lists(numbers, max_size=5), things),
        "feed_mm_s": things,
    },
)


@settings(max_examples=400, deadline=None)
@given(
    st.one_of(things, st.fixed_dictionaries({"curves": st.lists(broken_curves, max_size=3)})).map(json.dumps)
    | st.text()
)
def test_anything_is_moves_or_a_toolpath_error(text):
    try:
        moves = moves_of(text)
    except ToolpathError:
        return
    for move in moves:
        values = move.points_mm if isinstance(move, LineMoves) else move.control_points_mm
        assert np.all(np.isfinite(values))
