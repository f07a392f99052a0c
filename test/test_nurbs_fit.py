"""NURBS segments fitted to points: the thesis' printed result, G2 joints, and what is refused."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from appendix_a import PRINTED_BETAS, PRINTED_CONTROL_POINTS_MM, SET_BY_HAND
from benchmark.curves.nurbs_fit import (
    NurbsFit,
    chord_length_ratios,
    divide_points,
    fit_nurbs,
    knot_span_ratios,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from feedopt_core.config_files import find_config
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.programs.points_csv import read_points


def fan_points():
    contour = find_config("programs", "fan_contour", ".csv")
    return read_points(contour.read_text(encoding="utf-8").splitlines(), contour.name).points_mm


def circle_points(count: int, radius_mm: float = 20.0):
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    points = radius_mm * np.column_stack([np.cos(angle), np.sin(angle)])
    points[-1] = points[0]
    return points


def end_state(curve: NurbsCurve, u: float):
    """Position, unit tangent and curvature vector at a parameter."""
    r, r_u, r_uu, _ = (each[0] for each in curve.evaluate(np.array([u])))
    tangent = r_u / np.linalg.norm(r_u)
    return r, tangent, (r_uu - (r_uu @ tangent) * tangent) / (r_u @ r_u)


def joint_jumps(fit: NurbsFit, closed: bool):
    """Largest jumps of position, unit tangent and curvature vector over the joints."""
    pairs = list(itertools.pairwise(fit.curves)) + ([(fit.curves[-1], fit.curves[0])] if closed else [])
    jumps = []
    for before, after in pairs:
        jumps.append(
            [np.max(np.abs(a - b)) for a, b in zip(end_state(before, 1.0), end_state(after, 0.0), strict=True)]
        )
    return np.max(jumps, axis=0)


def test_control_points_of_appendix_a():
    fit = fit_nurbs(fan_points(), 5, PRINTED_BETAS)
    nets = [fit.curves[0].control_points_mm, *(curve.control_points_mm[1:] for curve in fit.curves[1:])]
    # Points, factors and result are printed to four digits behind the point.
    assert np.max(np.abs(np.concatenate(nets) - PRINTED_CONTROL_POINTS_MM)) < 5e-4
    assert [len(curve.control_points_mm) for curve in fit.curves] == [6] * 16 + [9]


def test_knots_of_appendix_a():
    segments = divide_points(fan_points(), 5)
    assert segments[0].knots[4:6] == pytest.approx([0.4789, 0.6476], abs=5e-5)
    assert segments[16].knots[4:9] == pytest.approx([0.3284, 0.4353, 0.5027, 0.5691, 0.6439], abs=5e-5)


def test_printed_factors_are_ratios_of_knot_spans():
    ratios = knot_span_ratios(divide_points(fan_points(), 5))
    free = np.setdiff1d(np.arange(17), SET_BY_HAND)
    assert ratios[free] == pytest.approx(PRINTED_BETAS[free], abs=1.5e-4)


def test_chord_ratios_of_a_regular_polygon_are_one():
    assert chord_length_ratios(divide_points(circle_points(20), 5)) == pytest.approx(np.ones(4))


@pytest.mark.parametrize("betas", [None, PRINTED_BETAS])
def test_joints_of_the_closed_fan_are_g2(betas):
    position, tangent, curvature = joint_jumps(fit_nurbs(fan_points(), 5, betas), closed=True)
    assert position < 1e-9
    assert tangent < 1e-9
    assert curvature < 1e-8


def test_open_curve_starts_and_ends_at_its_points():
    points = fan_points()[:23]
    fit = fit_nurbs(points)
    assert fit.curves[0].control_points_mm[0] == pytest.approx(points[0], abs=1e-10)
    assert fit.curves[-1].control_points_mm[-1] == pytest.approx(points[-1], abs=1e-10)
    assert joint_jumps(fit, closed=False)[2] < 1e-8


def test_single_segment_interpolates_without_joints():
    """As many control points as points, and nothing to join: the curve passes through all of them."""
    fit = fit_nurbs(fan_points()[:7], 5)
    assert len(fit.curves) == 1
    assert np.max(fit.distances_mm) < 1e-9


def test_straight_points_stay_straight():
    points = np.outer(np.cumsum([0.0, 1, 2, 1, 3, 1, 1, 2, 4, 1, 1, 1]), [0.6, 0.8, 0.0])
    fit = fit_nurbs(points, 4)
    for curve in fit.curves:
        placed = curve.evaluate(np.linspace(0.0, 1.0, 20))[0]
        assert np.max(np.abs(np.cross(placed, [0.6, 0.8, 0.0]))) < 1e-8


def test_circle_is_followed_closely():
    fit = fit_nurbs(circle_points(40))
    radii = np.concatenate([np.linalg.norm(curve.evaluate(np.linspace(0, 1, 50))[0], axis=1) for curve in fit.curves])
    # A cubic spline through 40 points of a circle is off by the fourth order of the step, here below 1e-3.
    assert np.max(np.abs(radii / 20.0 - 1.0)) < 1e-3


@settings(max_examples=12, deadline=None)
@given(
    st.floats(-3.0, 3.0), st.floats(0.2, 5.0),
    st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)),
)  # fmt: skip
def test_fit_turns_scales_and_moves_with_its_points(angle, scale, shift):
    points = fan_points()
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = points @ turn.T + shift
    moved[-1] = moved[0]
    for curve, other in zip(fit_nurbs(points).curves, fit_nurbs(moved).curves, strict=True):
        expected = curve.control_points_mm @ turn.T + shift
        assert np.max(np.abs(other.control_points_mm - expected)) < 1e-6 * (1.0 + scale)


@pytest.mark.parametrize(
    ("points", "intervals", "betas", "said"),
    [
        (np.zeros((4, 2)), 5, None, "4 points in segments of 5"),
        (circle_points(20), 2, None, "at least 3"),
        (np.repeat(circle_points(6), 2, axis=0), 5, None, "point 2 repeats"),
        (np.full((9, 2), np.nan), 5, None, "not finite"),
        (circle_points(20), 5, np.ones(3), "needs 4 finite factors"),
        (circle_points(20), 5, np.array([1.0, -1.0, 1.0, 1.0]), "above zero"),
    ],
)
def test_refused(points, intervals, betas, said):
    with pytest.raises(ToolpathError, match=said):
        fit_nurbs(points, intervals, betas)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.floats(width=32), st.floats(width=32)), max_size=15), st.integers(-1, 8))
def test_any_points_make_a_finite_curve_or_a_toolpath_error(points, intervals):
    try:
        fit = fit_nurbs(np.array(points, dtype=float).reshape(-1, 2), intervals)
    except ToolpathError:
        return
    assert all(np.all(np.isfinite(curve.control_points_mm)) for curve in fit.curves)
