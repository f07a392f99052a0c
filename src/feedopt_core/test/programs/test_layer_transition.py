"""Layer transitions: the curve's ends, its shape, and what of a program it replaces."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from level_contours import arc, circle, ends_of, polygon, square, stack, straight

from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.programs.layers.level_runs import LevelRun, PassedMoves, level_runs
from feedopt_core.programs.layers.transition_curve import Pose, transition_curve
from feedopt_core.programs.layers.transitions import TransitionSide, find_layer, with_layer_transitions
from feedopt_core.programs.moves import LineMoves, NurbsMove, PathMode, ProgramEvent
from feedopt_core.smoothing.stage import smooth

OUTSIDE, INSIDE = TransitionSide.OUTSIDE, TransitionSide.INSIDE


def curve_of(transition):
    net = transition.control_points_mm
    return NurbsCurve.from_control_net(5, transition.knots, net, np.ones(len(net)))


def states(curve: NurbsCurve, u):
    """Position, unit tangent and curvature vector at parameters."""
    r, r_u, r_uu, _ = curve.evaluate(np.asarray(u, dtype=float))
    tangent = r_u / np.linalg.norm(r_u, axis=1)[:, None]
    across = r_uu - np.einsum("nd,nd->n", r_uu, tangent)[:, None] * tangent
    return r, tangent, across / np.einsum("nd,nd->n", r_u, r_u)[:, None]


def pose(x, y, z, heading=0.0, curvature=0.0):
    return Pose(np.array([x, y, z], dtype=float), heading, curvature)


def changed(moves, reach=5.0, side=OUTSIDE):
    return list(with_layer_transitions(iter(moves), reach, side))


def transitions_in(moves):
    return [move for move in moves if isinstance(move, NurbsMove)]


def assert_same(moves, expected):
    """The same geometry in the same order, however straight moves are grouped."""

    def flat(every):
        return [ends_of([move])[1] if not isinstance(move, LineMoves) else point
                for move in every for point in (move.points_mm if isinstance(move, LineMoves) else [None])]  # fmt: skip

    assert np.array_equal(np.array(flat(moves)), np.array(flat(expected)))


poses = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-0.3, 0.3), st.floats(-0.03, 0.03))


@settings(max_examples=40, deadline=None)
@given(poses, st.floats(-0.03, 0.03), st.floats(-3.0, 3.0), st.sampled_from([-1.0, 1.0]), st.floats(2.0, 40.0))
def test_ends_agree_in_position_tangent_and_curvature(offset, bend, heading, away, reach):
    dx, dy, turn, end_bend = offset
    scale = reach / 10.0
    start = pose(30, 40, 5, heading, bend / scale)
    end = pose(30 + dx * scale, 40 + dy * scale, 4, heading + turn, end_bend / scale)
    found = transition_curve(start, end, away * 2.0 * math.pi + turn, reach)
    assert found is not None
    r, tangent, curvature = states(curve_of(found), [0.0, 1.0])
    for index, at in enumerate((start, end)):
        way = np.array([math.cos(at.heading_rad), math.sin(at.heading_rad), 0.0])
        assert r[index] == pytest.approx(at.point_mm, abs=1e-9)
        assert tangent[index] == pytest.approx(way, abs=1e-9)
        left = np.array([-way[1], way[0], 0.0])
        assert curvature[index] == pytest.approx(at.curvature_per_mm * left, abs=1e-9)


def test_closed_curve_is_symmetric_and_reaches_as_far_as_asked():
    found = transition_curve(pose(0, 0, 0), pose(0, 0, -1), -2.0 * math.pi, 10.0)
    r, _, _ = states(curve_of(found), np.linspace(0.0, 1.0, 401))
    assert -np.min(r[:, 1]) == pytest.approx(10.0, rel=0.01)
    assert np.max(r[:, 1]) < 1e-9
    assert r[::-1, :2] == pytest.approx(r[:, :2] * [-1.0, 1.0], abs=1e-8)


def test_seen_from_above_the_curvature_is_linear_on_four_pieces():
    """The quintics follow the spirals: second differences of the curvature vanish inside the pieces."""
    found = transition_curve(pose(0, 0, 0), pose(0, 0, 0), 2.0 * math.pi, 10.0)
    for first, last in itertools.pairwise([0.0, 0.1, 0.5, 0.9, 1.0]):
        u = np.linspace(first, last, 25)[1:-1]
        _, tangent, curvature = states(curve_of(found), u)
        signed = curvature[:, 1] * tangent[:, 0] - curvature[:, 0] * tangent[:, 1]
        line = np.polynomial.Polynomial.fit(u, signed, 1)
        assert np.max(np.abs(line(u) - signed)) < 2e-3 * np.max(np.abs(signed))


def test_descent_is_monotone_and_level_at_both_ends():
    found = transition_curve(pose(0, 0, 3), pose(0, 0, 1), 2.0 * math.pi, 10.0)
    r, tangent, _ = states(curve_of(found), np.linspace(0.0, 1.0, 201))
    assert np.all(np.diff(r[:, 2]) <= 0.0)
    assert tangent[[0, -1], 2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert r[100, 2] == pytest.approx(2.0)


def test_curvature_is_continuous_all_along():
    found = transition_curve(pose(0, 0, 0, 0.0, 0.05), pose(1, 0.5, -1, 0.2, 0.02), 0.2 - 2.0 * math.pi, 8.0)
    knots = np.unique(found.knots)[1:-1]
    _, _, before = states(curve_of(found), knots - 1e-10)
    _, _, behind = states(curve_of(found), knots)
    assert before == pytest.approx(behind, abs=1e-6)


def test_goal_out_of_reach_has_no_curve():
    assert transition_curve(pose(0, 0, 0), pose(500, 0, -1), -2.0 * math.pi, 5.0) is None


@pytest.mark.parametrize("contour", [circle, square])
def test_plunges_between_layers_are_replaced(contour):
    moves = stack([contour(0.0), contour(-1.0), contour(-2.0)])
    found = changed(moves)
    assert len(transitions_in(found)) == 2
    for before, after in itertools.pairwise(found):
        assert np.array_equal(ends_of([before])[1], ends_of([after])[0])
    assert_same(
        [move for move in found if not isinstance(move, NurbsMove)], contour(0.0) + contour(-1.0) + contour(-2.0)
    )


def test_smoothing_finds_nothing_to_do_at_a_transition():
    """The transition joins circles with their curvature: every curve of the program is there uncut."""
    found = changed(stack([circle(0.0), circle(-1.0)]))
    segments = list(smooth(iter(found), 0.01, 3))
    assert not any(segment.place.exact_stop for segment in segments)
    assert [segment.kind.name for segment in segments] == ["ARC", "NURBS", "ARC"]
    assert segments[0].length_mm == pytest.approx(40.0 * math.pi)


@pytest.mark.parametrize(("side", "clockwise"), list(itertools.product((OUTSIDE, INSIDE), (False, True))))
def test_transition_stays_on_its_side(side, clockwise):
    (transition,) = transitions_in(
        changed(stack([circle(0.0, clockwise=clockwise), circle(-1.0, clockwise=clockwise)]), side=side)
    )
    radii = np.linalg.norm(states(curve_of(transition), np.linspace(0.0, 1.0, 301))[0][:, :2], axis=1)
    if side is OUTSIDE:
        assert np.min(radii) > 20.0 - 1e-6
        assert np.max(radii) == pytest.approx(25.0, abs=0.5)
    else:
        assert np.max(radii) < 20.0 + 1e-6
        assert np.min(radii) == pytest.approx(15.0, abs=0.5)


def test_reach_is_reduced_where_the_contour_is_in_the_way():
    """Inside a circle of 4 mm there is no room for 7 mm."""
    moves = stack([circle(0.0, 4.0), circle(-1.0, 4.0)])
    (transition,) = transitions_in(changed(moves, reach=10.0, side=INSIDE))
    points = states(curve_of(transition), np.linspace(0.0, 1.0, 301))[0]
    assert np.max(points[:, 1]) - points[0, 1] == pytest.approx(5.0, rel=0.02)


def test_no_room_at_all_leaves_the_program_as_it_is():
    moves = stack([circle(0.0, 1.0), circle(-1.0, 1.0)])
    assert_same(changed(moves, reach=20.0, side=INSIDE), moves)


def test_lead_out_retract_and_lead_in_are_replaced():
    quarter = math.pi / 2.0
    moves = []
    for z in (0.0, -1.0):
        moves += [
            arc((-5, -25, z), (0, -20, z), (0, -25, z), quarter, clockwise=True),
            *circle(z),
            arc((0, -20, z), (5, -25, z), (0, -25, z), quarter, clockwise=True),
        ]
        if not z:
            moves += [
                straight((5, -25, 0), (5, -25, 10), (-5, -25, 10), rapid=True),
                straight((-5, -25, 10), (-5, -25, -1)),
            ]
    found = changed(moves)
    assert [type(move).__name__ for move in found] == ["ArcMove", "ArcMove", "NurbsMove", "ArcMove", "ArcMove"]
    assert np.array_equal(found[1].end_mm, found[2].control_points_mm[0])
    assert np.array_equal(found[2].control_points_mm[-1], found[3].start_mm)
    assert found[0].start_mm == pytest.approx([-5, -25, 0])
    assert found[-1].end_mm == pytest.approx([5, -25, -1])


def test_chords_of_a_curve_are_left_along_the_curve():
    """At a corner of a fine polygon the transition leaves along the circle, not along a chord."""
    (transition,) = transitions_in(changed(stack([polygon(0.0, 360), polygon(-1.0, 360)])))
    _, tangent, curvature = states(curve_of(transition), [0.0, 1.0])
    assert tangent == pytest.approx(np.array([[1.0, 0, 0], [1.0, 0, 0]]), abs=1e-9)
    assert curvature == pytest.approx(np.array([[0, 0.05, 0], [0, 0.05, 0]]), rel=1e-3)


def test_corner_is_gone_round_outside():
    """From the end of one side to the start of the next: a quarter turn less than a whole one."""
    corners = [(0, 0), (30, 0), (30, 30), (0, 30), (0, 0)]
    moves = stack([[straight(*[(x, y, z) for x, y in corners])] for z in (0.0, -1.0)])
    (transition,) = transitions_in(changed(moves))
    r, tangent, _ = states(curve_of(transition), np.linspace(0.0, 1.0, 301))
    assert tangent[0] == pytest.approx([0, -1, 0], abs=1e-9)
    assert tangent[-1] == pytest.approx([1, 0, 0], abs=1e-9)
    assert np.all(np.min(r[:, :2], axis=1) < 1e-6)


def test_feed_is_the_lower_one_of_both_contours():
    moves = stack([circle(0.0, feed=30.0), circle(-1.0, feed=20.0)])
    assert transitions_in(changed(moves))[0].feed_mm_s == 20.0


@pytest.mark.parametrize(
    "moves",
    [
        stack([circle(0.0), circle(0.0, 21.0)]),
        stack([circle(0.0), circle(-1.0, clockwise=True)]),
        stack([[straight((0, 0, 0), (10, 0, 0), (10, 10, 0))], circle(-1.0)]),
        [*circle(0.0), straight((0, -20, 0), (0, -20, 5), (200, -20, 5)), *square(5.0)],
    ],
)
def test_other_programs_pass_as_they_are(moves):
    assert_same(changed(moves), moves)


def test_events_and_exact_stops_between_layers_are_kept():
    event = ProgramEvent("M0", 3, stop=True)
    moves = stack([circle(0.0), circle(-1.0)])
    with_event = [*moves[:1], event, *moves[1:]]
    kept = changed(with_event)
    assert [id(move) for move in kept if isinstance(move, ProgramEvent)] == [id(event)]
    assert not transitions_in(kept)
    stopping = [moves[0], straight((0, -20, 0), (0, -20, -1), mode=PathMode(exact_stop=True)), moves[2]]
    assert not transitions_in(changed(stopping))


def test_moves_come_out_before_the_program_ends():
    """One layer is held, not the whole stack."""
    taken = []

    def program():
        for index, move in enumerate(stack([circle(-float(z)) for z in range(50)])):
            taken.append(index)
            yield move

    stream = with_layer_transitions(program(), 5.0, OUTSIDE)
    next(stream)
    assert len(taken) < 6


def test_layer_is_the_longest_closed_part():
    lead = [straight((-9, -9, 0), (0, -20, 0)), straight((0, -20, 0), (9, -30, 0))]
    layer = find_layer([lead[0], *square(0.0), lead[1]])
    assert layer.orientation == 1
    assert len(layer.lead_in) == len(layer.contour) == len(layer.lead_out) == 1
    assert ends_of(layer.contour)[0] == pytest.approx([0, -20, 0])
    assert find_layer([straight((0, 0, 0), (5, 0, 0), (0, 0, 0))]) is None


heights = st.lists(st.sampled_from([0.0, -1.0, -2.0]), min_size=2, max_size=12)


@settings(max_examples=100, deadline=None)
@given(heights, st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), min_size=12, max_size=12), st.booleans())
def test_runs_and_links_hold_every_move_in_order(levels, places, rapid):
    points = [(x, y, z) for (x, y), z in zip(places, levels, strict=False)]
    move = straight(*points, rapid=rapid)
    parts = [single for part in level_runs(iter([move])) for single in part.moves]
    assert_same(parts, [move])
    for part in level_runs(iter([move])):
        if isinstance(part, LevelRun):
            assert not rapid
            assert len({float(z) for each in part.moves for z in (each.start_mm[2], *each.points_mm[:, 2])}) == 1


def test_overlong_run_is_passed_on():
    points = np.column_stack([np.arange(150_001.0), np.zeros(150_001), np.zeros(150_001)])
    moves = [straight(*points), straight(points[-1], *(points[:-1][::-1]))]
    parts = list(level_runs(iter(moves)))
    assert [type(part) for part in parts] == [PassedMoves]


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(-4, 4), st.integers(-4, 4), st.integers(-2, 0)), min_size=3, max_size=25))
def test_any_program_keeps_its_ends_and_has_no_gaps(points):
    found = changed([straight(*points)], reach=1.0)
    assert np.array_equal(ends_of(found)[0], np.array(points[0], dtype=float))
    for before, after in itertools.pairwise(found):
        assert np.array_equal(ends_of([before])[1], ends_of([after])[0])
