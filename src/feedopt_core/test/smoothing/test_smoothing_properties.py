"""Properties of the smoothing stage over random programs."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from programmed_moves import TOLERANCE_MM, arc, assert_counted, assert_smooth, ends, smoothed, straight

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.deviation import measure_deviation
from feedopt_core.programs.moves import ArcMove, LineMoves, Move

_TURNS = st.floats(-math.pi, math.pi)
_SIDES = st.floats(-2.0, 2.0).map(lambda exponent: 10.0**exponent)


def end_of(move: Move) -> FloatArray:
    if isinstance(move, LineMoves):
        return move.points_mm[-1]
    assert isinstance(move, ArcMove)
    return move.end_mm


@st.composite
def programs(draw: st.DrawFn) -> list[Move]:
    """Straight moves and arcs in any order, tangent to each other or not."""
    moves, heading = list[Move](), 0.0
    at = np.zeros(3)
    for line in range(1, draw(st.integers(2, 7)) + 1):
        if draw(st.booleans()):
            heading += draw(st.one_of(st.just(0.0), _TURNS))
        size = draw(_SIDES)
        if draw(st.booleans()):
            way = np.array([math.cos(heading), math.sin(heading), 0.0])
            moves.append(straight(np.stack([at, at + size * way]), first_line=line))
        else:
            sweep, clockwise = draw(st.floats(0.05, 2.0 * math.pi)), draw(st.booleans())
            side = -1.0 if clockwise else 1.0
            center = at[:2] + size * side * np.array([-math.sin(heading), math.cos(heading)])
            moves.append(arc(tuple(at), tuple(center), sweep, clockwise=clockwise, line=line))
            heading += side * sweep
        at = end_of(moves[-1])
    return moves


@given(programs())
@settings(max_examples=60)
def test_lines_and_arcs_are_g2_within_the_tolerance_or_stop(moves: list[Move]) -> None:
    segments = smoothed(moves)
    assert_counted(segments)
    assert_smooth(segments)
    assert measure_deviation(moves, segments, TOLERANCE_MM).holds
    assert np.allclose(
        ends(segments[-1])[1].r_mm[0],
        end_of(moves[-1])[:2],
        atol=1e-9 * max(1.0, float(np.max(np.abs(end_of(moves[-1]))))),
    )


@given(
    st.lists(st.tuples(_TURNS, st.floats(0.5, 100.0)), min_size=2, max_size=12),
    st.sampled_from([2, 3]),
    st.floats(1e-4, 0.02),
)
@settings(max_examples=60)
def test_polylines_of_long_sides(walk: list[tuple[float, float]], dimensions: int, tolerance_mm: float) -> None:
    heading, climb = np.cumsum([turn for turn, _ in walk]), 0.3 * np.arange(len(walk))
    steps = np.column_stack([np.cos(heading), np.sin(heading), np.sin(climb)])[:, :dimensions]
    steps *= np.array([side for _, side in walk])[:, None] / np.linalg.norm(steps, axis=1)[:, None]
    points = np.concatenate([np.zeros((1, dimensions)), np.cumsum(steps, axis=0)])
    segments = smoothed([straight(points)], dimensions, tolerance_mm)
    assert_counted(segments)
    assert_smooth(segments)
    assert measure_deviation([straight(points)], segments, tolerance_mm).holds
    assert np.allclose(ends(segments[-1])[1].r_mm[0], points[-1], atol=1e-9 * max(1.0, float(np.max(np.abs(points)))))


@given(
    st.integers(3, 400),
    st.floats(0.002, 0.4),
    st.lists(st.tuples(st.floats(-0.2, 0.2), st.floats(0.02, 1.0)), min_size=1, max_size=4),
    st.integers(2, 4),
)
@settings(max_examples=40)
def test_runs_of_rounded_points_on_a_smooth_curve(
    count: int, chord_mm: float, waves: list[tuple[float, float]], decimals: int
) -> None:
    length = chord_mm * np.arange(count + 1)
    heading = sum(amplitude * np.sin(frequency * length) for amplitude, frequency in waves)
    steps = chord_mm * np.column_stack([np.cos(heading), np.sin(heading)])[:-1]
    points = np.round(np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), decimals)
    program = [straight(points)]
    if not np.any(points != points[0]):
        return
    segments = smoothed(program)
    assert_counted(segments)
    assert_smooth(segments)
    assert measure_deviation(program, segments, TOLERANCE_MM).holds
