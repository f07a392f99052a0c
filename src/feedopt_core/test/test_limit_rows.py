"""Axis limits along the path: rows of the optimisation, the jerk tangent, rest elements, on-grid ratios."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from core_paths import kinematic_machine, line, planar, polyline, spline, toolpath_of
from hypothesis import given
from hypothesis import strategies as st

from feedopt_core.arrays import FloatArray
from feedopt_core.feedrate.mesh import QuadraticSpline
from feedopt_core.feedrate.profile import ElementKind, FeedProfile
from feedopt_core.limits.axis_limits import (
    AxisGeometry,
    KinematicLimits,
    LimitRows,
    axis_geometry,
    q_limit,
    span_points,
)
from feedopt_core.limits.excess import limit_ratios
from feedopt_core.limits.rest import rest_length_mm, rest_scale_limit
from feedopt_core.path.segments import SegmentKind
from feedopt_core.path.toolpath import Toolpath
from feedopt_core.solvers.banded_interior_point import local_products

Z = np.array([0.0, 0.3, 0.5, 1.0])
MACHINE = kinematic_machine(velocity=(90.0, 120.0), acceleration=(400.0, 700.0), jerk=(9000.0, 20000.0))
LIMITS = KinematicLimits.of(MACHINE)
WEDGE = spline([(0, 0), (9, 4), (16, 1), (22, 9), (33, 7)])


@dataclass(frozen=True)
class Mesh:
    """Rows on a small mesh with everything needed to evaluate them directly."""

    rows: LimitRows
    basis: tuple[FloatArray, FloatArray, FloatArray]
    geometry: AxisGeometry
    control_points: FloatArray

    @property
    def q(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        value, slope, bend = (local_products(part, self.control_points) for part in self.basis)
        return value, slope, bend


def mesh(seed: int = 1) -> Mesh:
    toolpath = toolpath_of(WEDGE)
    on = QuadraticSpline.on(np.linspace(1.0, 30.0, 15))
    geometry = axis_geometry(toolpath, LIMITS.axis_matrix, span_points(on.knots_mm, Z))
    basis = on.basis(Z)
    rows = LimitRows(geometry, LIMITS, basis, np.ones((len(Z), len(on.widths_mm))))
    control = np.random.default_rng(seed).uniform(200.0, 4000.0, len(on.knots_mm) + 1)
    return Mesh(rows, basis, geometry, control)


@given(q=st.floats(1e-3, 1e5), at=st.floats(1e-3, 1e5))
def test_tangent_of_the_jerk_limit_lies_inside_it(q: float, at: float) -> None:
    """3/2 / sqrt(q_k) - q / (2 q_k^1.5) <= 1 / sqrt(q): the tangent never allows more than the limit."""
    tangent = 1.5 / np.sqrt(at) - 0.5 * q / at**1.5
    assert tangent <= 1.0 / np.sqrt(q) * (1.0 + 1e-12)


@given(seed=st.integers(0, 1000), other=st.integers(0, 1000))
def test_what_obeys_the_rows_obeys_the_jerk_limit(seed: int, other: int) -> None:
    """Rows set at one q, another q that obeys them: its true jerk holds too."""
    first, second = mesh(seed), mesh(other)
    value, slope, bend = second.q
    rows = first.rows.tangent_at(first.q[0]).copy()
    axes, points = first.geometry.g1.shape[:2]
    used = local_products(rows, second.control_points)[points * (1 + 2 * axes) :]
    g = second.geometry
    jerk = (
        np.sqrt(value)
        * np.abs(g.g3 * value + 1.5 * g.g2 * slope + 0.5 * g.g1 * bend)
        / LIMITS.jerk_mm_s3[:, None, None]
    )
    per_axis = np.max(used.reshape(axes, 2, points, -1), axis=1)
    assert np.all(jerk[per_axis <= 1.0] <= 1.0 + 1e-12)


def test_rows_are_the_limits_evaluated_directly() -> None:
    """Rows of velocity and acceleration are exact; those of jerk touch the limit at their own q."""
    here = mesh()
    value, slope, bend = here.q
    axes, points = here.geometry.g1.shape[:2]
    used = local_products(here.rows.tangent_at(value), here.control_points)
    g = here.geometry
    assert np.allclose(used[:points], value / q_limit(g, LIMITS), rtol=1e-12)
    acceleration = (g.g2 * value + 0.5 * g.g1 * slope) / LIMITS.acceleration_mm_s2[:, None, None]
    jerk = np.sqrt(value) * (g.g3 * value + 1.5 * g.g2 * slope + 0.5 * g.g1 * bend) / LIMITS.jerk_mm_s3[:, None, None]
    rest = used[points:].reshape(2, axes, 2, points, -1)
    assert np.allclose(rest[0, :, 0], acceleration, rtol=1e-10, atol=1e-12)
    assert np.allclose(rest[0, :, 1], -acceleration, rtol=1e-10, atol=1e-12)
    # 1/3 + 2/3 of the ratio: equal to 1 exactly where the ratio is.
    assert np.allclose(rest[1, :, 0], (1.0 + 2.0 * jerk) / 3.0, rtol=1e-10, atol=1e-12)
    assert np.allclose(rest[1, :, 1], (1.0 - 2.0 * jerk) / 3.0, rtol=1e-10, atol=1e-12)


def test_scale_tightens_every_row() -> None:
    here = mesh()
    points, spans = here.geometry.g1.shape[1:]
    tight = LimitRows(here.geometry, LIMITS, here.basis, np.full((points, spans), 0.5))
    lowered = KinematicLimits(
        LIMITS.axis_matrix,
        0.5 * LIMITS.feed_mm_s,
        0.5 * LIMITS.velocity_mm_s,
        0.5 * LIMITS.acceleration_mm_s2,
        0.5 * LIMITS.jerk_mm_s3,
    )
    direct = LimitRows(here.geometry, lowered, here.basis, np.ones((points, spans)))
    value = here.q[0]
    assert np.allclose(tight.tangent_at(value), direct.tangent_at(value), rtol=1e-12)


def test_given_start_state_has_no_rows_of_velocity_and_acceleration() -> None:
    here = mesh()
    value = here.q[0]
    before = here.rows.tangent_at(value).copy()
    here.rows.release_start_state()
    after = here.rows.tangent_at(value)
    axes, points = here.geometry.g1.shape[:2]
    released = np.flatnonzero(np.any(before != after, axis=(0, 2)))
    assert released.tolist() == [points * k for k in range(1 + 2 * axes)]
    assert np.all(after[:, released, 0] == 0.0)
    assert np.array_equal(before[:, :, 1:], after[:, :, 1:])


def test_q_limit_is_the_slowest_of_feed_and_axes() -> None:
    toolpath = toolpath_of(polyline([(0, 0), (10, 0), (16, 8)], feed_limits_mm_s=[200.0, 100.0]))
    geometry = axis_geometry(toolpath, LIMITS.axis_matrix, np.array([5.0, 15.0]))
    assert np.allclose(q_limit(geometry, LIMITS), [90.0**2, 100.0**2])
    unlimited = toolpath_of(polyline([(0, 0), (10, 0), (16, 8)]))
    geometry = axis_geometry(unlimited, LIMITS.axis_matrix, np.array([5.0, 15.0]))
    # 0.6 and 0.8 of the feedrate go to the axes; the machine's feed limit is 150.
    assert np.allclose(q_limit(geometry, LIMITS), [90.0**2, min(90.0 / 0.6, 120.0 / 0.8, 150.0) ** 2])


def test_points_of_a_span_stay_inside_it() -> None:
    knots = np.array([0.0, 1.0, 1.0 + 1e-8, 3.0])
    points = span_points(knots, np.array([0.0, 1.0]))
    assert np.all(points[0] > knots[:-1]) and np.all(points[1] < knots[1:])


def test_ratios_of_a_profile_are_those_of_its_motion() -> None:
    toolpath = toolpath_of(WEDGE)
    s = np.array([2.0, 4.0, 7.0])
    profile = FeedProfile(
        np.zeros(2, dtype=np.int64),
        s,
        np.array([900.0, 1200.0]),
        np.array([100.0, 200.0]),
        np.array([50.0, -90.0]),
        np.zeros(2),
    )
    z = np.linspace(0.0, 1.0, 25)
    found = limit_ratios(toolpath, LIMITS, profile)
    for element in range(2):
        at = s[element] + z * (s[element + 1] - s[element])
        at = np.clip(at, s[element] + 1e-9, s[element + 1] - 1e-9)
        states = profile.states_at(profile.time_at(at))
        points = toolpath.evaluate(at)
        v, a, j = states.v_mm_s[:, None], states.a_mm_s2[:, None], states.j_mm_s3[:, None]
        worst = max(
            float(np.max(v / 150.0)),
            float(np.max(np.abs(points.dr_ds * v) / MACHINE.velocity_limit_mm_s)),
            float(np.max(np.abs(points.d2r_ds2 * v**2 + points.dr_ds * a) / MACHINE.acceleration_limit_mm_s2)),
            float(
                np.max(
                    np.abs(points.d3r_ds3 * v**3 + 3 * points.d2r_ds2 * v * a + points.dr_ds * j)
                    / MACHINE.jerk_limit_mm_s3
                )
            ),
        )
        assert found[element] == pytest.approx(worst, rel=1e-6)


def rest_ratios(toolpath: Toolpath, at_mm: float, length_mm: float, sign: int, p: float) -> FloatArray:
    """Largest velocity, acceleration and jerk of the element at rest over their limits, sampled in time."""
    jerk = 2.0 / 9.0 * p**1.5
    duration = np.cbrt(6.0 * length_mm / jerk)
    t = duration * np.linspace(1e-3, 1.0, 400)
    points = toolpath.evaluate(at_mm + sign * jerk * t**3 / 6.0)
    # The sense of travel is that of s: next to an end at rest, time runs backwards.
    v, a, j = (jerk * t**2 / 2.0)[:, None], (sign * jerk * t)[:, None], jerk
    return np.array(
        [
            np.max(np.abs(points.dr_ds * v) / LIMITS.velocity_mm_s),
            np.max(np.abs(points.d2r_ds2 * v**2 + points.dr_ds * a) / LIMITS.acceleration_mm_s2),
            np.max(np.abs(points.d3r_ds3 * v**3 + 3.0 * points.d2r_ds2 * v * a + points.dr_ds * j) / LIMITS.jerk_mm_s3),
        ]
    )


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("length_mm", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("at_part", [0.05, 0.3, 0.5, 0.77, 0.95])
def test_fastest_rest_element_just_holds_every_limit(sign: int, length_mm: float, at_part: float) -> None:
    toolpath = toolpath_of(WEDGE)
    at_mm = at_part * toolpath.end_mm
    p = rest_scale_limit(toolpath, LIMITS, at_mm, length_mm, sign, 1.0)
    ratios = rest_ratios(toolpath, at_mm, length_mm, sign, p)
    assert np.max(ratios) == pytest.approx(1.0, abs=2e-3)


def test_rest_element_on_a_line_has_the_axis_jerk() -> None:
    toolpath = toolpath_of([line(10.0)])
    length = rest_length_mm(toolpath, LIMITS, 0.0, +1)
    # A part of the distance in which 9000 mm/s^3 builds up 400 mm/s^2.
    assert 0.0 < length < 400.0**3 / (6.0 * 9000.0**2)
    p = rest_scale_limit(toolpath, LIMITS, 0.0, length, +1, 1.0)
    assert 2.0 / 9.0 * p**1.5 == pytest.approx(9000.0, rel=1e-12)
    half = rest_scale_limit(toolpath, LIMITS, 0.0, length, +1, 0.5)
    assert 2.0 / 9.0 * half**1.5 == pytest.approx(4500.0, rel=1e-12)


def test_rest_element_looks_at_its_own_side_of_a_corner() -> None:
    toolpath = toolpath_of(polyline([(0, 0), (10, 0), (10, 10)]))
    before = rest_scale_limit(toolpath, LIMITS, 10.0, 0.1, -1, 1.0)
    after = rest_scale_limit(toolpath, LIMITS, 10.0, 0.1, +1, 1.0)
    assert 2.0 / 9.0 * before**1.5 == pytest.approx(9000.0, rel=1e-9)
    assert 2.0 / 9.0 * after**1.5 == pytest.approx(20000.0, rel=1e-9)


def test_rest_element_on_an_arc_obeys_the_velocity_limit_too() -> None:
    slow = KinematicLimits(np.eye(2), 1.0, np.array([1.0, 1.0]), np.array([1e6, 1e6]), np.array([1e9, 1e9]))
    toolpath = toolpath_of([planar(SegmentKind.ARC, 10.0, curvature=0.1)])
    p = rest_scale_limit(toolpath, slow, 0.0, 2.0, +1, 1.0)
    assert p * 2.0 ** (4.0 / 3.0) == pytest.approx(1.0, rel=1e-12)


def test_kinds_of_elements_are_those_of_the_message() -> None:
    assert (ElementKind.QUADRATIC, ElementKind.REST_START, ElementKind.REST_END) == (0, 1, 2)
