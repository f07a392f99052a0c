"""Axis limits along the path: rows of the optimisation, standstill elements, on-grid ratios."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from core_paths import drive_machine, kinematic_machine, line, planar, polyline, spline, toolpath_of
from hypothesis import given
from hypothesis import strategies as st

from feedopt_core.arrays import FloatArray
from feedopt_core.constraints.axis_geometry import AxisGeometry, axis_geometry, q_limit, span_points
from feedopt_core.constraints.limit_rows import drop_repeated, limit_rows, release_start_state
from feedopt_core.constraints.standstill import standstill_length_mm, standstill_scale_limit
from feedopt_core.constraints.utilisation import limit_ratios
from feedopt_core.geometry.segments import SegmentKind
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.limits import KinematicLimits, MotionLimits
from feedopt_core.motion.profile import ElementKind, FeedProfile
from feedopt_core.planner.mesh import QuadraticSpline
from feedopt_core.solver.interior_point_data import Rows

Z = np.array([0.0, 0.3, 0.5, 1.0])
MACHINE = kinematic_machine(velocity=(90.0, 120.0), acceleration=(400.0, 700.0), jerk=(9000.0, 20000.0))
LIMITS = KinematicLimits.of(MACHINE)
MOTION = MotionLimits.of(MACHINE)
DRIVEN = MotionLimits.of(drive_machine())
WEDGE = spline([(0, 0), (9, 4), (16, 1), (22, 9), (33, 7)])


def on_spans(basis: FloatArray, control_points: FloatArray) -> FloatArray:
    """Values at the points from the local basis functions, shape (3, p, m) to (p, m)."""
    m = basis.shape[2]
    return np.asarray(sum(basis[i] * control_points[i : m + i] for i in range(3)))


@dataclass(frozen=True)
class Mesh:
    """Rows on a small mesh with everything needed to evaluate them directly."""

    rows: Rows
    geometry: AxisGeometry
    control_points: FloatArray
    q: FloatArray
    slope: FloatArray
    bend: FloatArray

    def used(self) -> FloatArray:
        """Every row over its limits up and down, shape (n, 2, p, m)."""
        c = np.stack([self.control_points[i : len(self.q[0]) + i] for i in range(3)], axis=-1)
        # Shape (3, m, p, 1).
        q, slope, bend = np.einsum("mpxl,ml->xmp", self.rows.basis, c)[..., None]
        row = self.rows.coefficients
        by_root = row["on_root"] + row["on_root_q"] * q + row["on_root_slope"] * slope + row["on_root_bend"] * bend
        y = row["on_q"] * q + row["on_slope"] * slope + np.sqrt(self.q.T)[..., None] * by_root
        return np.asarray((y[..., None] * [1.0, -1.0] * self.rows.inverse_limits).transpose(2, 3, 1, 0))


def mesh(seed: int = 1, limits: MotionLimits = MOTION, scale: float = 1.0) -> Mesh:
    toolpath = toolpath_of(WEDGE)
    on = QuadraticSpline.on(np.linspace(1.0, 30.0, 15))
    geometry = axis_geometry(toolpath, limits.kinematic.axis_matrix, span_points(on.knots_mm, Z))
    basis = on.basis(Z)
    shape = (len(Z), len(on.widths_mm))
    rows = limit_rows(geometry, limits, basis, np.ones(shape), np.full(shape, scale))
    control = np.random.default_rng(seed).uniform(200.0, 4000.0, len(on.knots_mm) + 1)
    return Mesh(rows, geometry, control, *(on_spans(part, control) for part in basis))


def axis_motion(here: Mesh) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Velocity, acceleration and jerk of the axes at the points, shape (n_axes, p, m) each."""
    g, root = here.geometry, np.sqrt(here.q)
    return (
        g.g1 * root,
        g.g2 * here.q + 0.5 * g.g1 * here.slope,
        root * (g.g3 * here.q + 1.5 * g.g2 * here.slope + 0.5 * g.g1 * here.bend),
    )


def shaped(limits: FloatArray) -> FloatArray:
    return limits[:, None, None]


def test_rows_are_the_kinematic_limits_evaluated_directly() -> None:
    here = mesh()
    used = here.used()
    _, acceleration, jerk = axis_motion(here)
    assert np.allclose(used[0, 0], here.q / q_limit(here.geometry, LIMITS), rtol=1e-12)
    assert np.all(used[0, 1] == 0.0), "velocity has one side"
    assert np.allclose(used[1:3, 0], acceleration / shaped(LIMITS.acceleration_mm_s2), rtol=1e-10, atol=1e-12)
    assert np.allclose(used[3:5, 0], jerk / shaped(LIMITS.jerk_mm_s3), rtol=1e-10, atol=1e-12)
    assert np.allclose(used[1:, 1], -used[1:, 0], rtol=1e-12)


@given(seed=st.integers(0, 1000))
def test_rows_reach_one_exactly_where_a_drive_limit_is_reached(seed: int) -> None:
    """1 - row is the room that is left, up to the offset and friction that belong to the limit's side."""
    here = mesh(seed, DRIVEN)
    used = here.used()[1 + 2 :]
    velocity, acceleration, jerk = axis_motion(here)
    control, tracking = DRIVEN.control, DRIVEN.tracking
    assert control is not None and tracking is not None
    constant = shaped(control.offset_volts) + shaped(control.coulomb_volts) * np.sign(velocity)
    moving = shaped(control.inertia_volts_s2_mm) * acceleration + shaped(control.viscous_volts_s_mm) * velocity
    limit = shaped(control.limit_volts)
    assert np.allclose(used[:2, 0], moving / (limit - constant), rtol=1e-9, atol=1e-12)
    assert np.allclose(used[:2, 1], -moving / (limit + constant), rtol=1e-9, atol=1e-12)
    error = (
        shaped(tracking.kv_s) * velocity + shaped(tracking.ka_s2) * acceleration + shaped(tracking.kj_s3) * jerk
    ) / shaped(tracking.limit_mm)
    assert np.allclose(used[4:6, 0], error, rtol=1e-9, atol=1e-12)
    assert np.allclose(used[4:6, 1], -error, rtol=1e-9, atol=1e-12)


def rows_of_a_line(y_share: float, limits: MotionLimits = DRIVEN, axis_matrix: FloatArray | None = None) -> Rows:
    """Along X; Y makes a share of the motion."""
    toolpath = toolpath_of([line(10.0)])
    on = QuadraticSpline.on(np.linspace(1.0, 9.0, 5))
    matrix = np.eye(2) if axis_matrix is None else axis_matrix
    geometry = axis_geometry(toolpath, matrix, span_points(on.knots_mm, Z))
    geometry.g1[-1] = y_share
    shape = (len(Z), len(on.widths_mm))
    return limit_rows(geometry, limits, on.basis(Z), np.ones(shape), np.ones(shape))


def test_axis_that_hardly_moves_has_friction_against_both_sides() -> None:
    rows = rows_of_a_line(1e-12)
    # u = 10 V, c = 0.148 V, d = 0.241 V: X moves forwards, Y rests.
    x, y = 1.0 / rows.inverse_limits[0, 0, 3:5]
    assert np.allclose(10.0 * x, [10.0 - 0.148 - 0.241, 10.0 + 0.148 + 0.241])
    assert np.allclose(10.0 * y, [10.0 - 0.148 - 0.241, 10.0 + 0.148 - 0.241])


def test_axis_that_stands_still_has_no_limits() -> None:
    moving, still = rows_of_a_line(1e-12).inverse_limits, rows_of_a_line(0.0).inverse_limits
    # Velocity of the path, then acceleration, control, jerk and tracking error of X and Y.
    assert np.all(moving[:, :, 1:] > 0.0)
    assert np.all(still[:, :, 2::2] == 0.0)
    np.testing.assert_array_equal(still[:, :, 1::2], moving[:, :, 1::2])


def test_drives_that_move_alike_share_the_lowest_kinematic_limits() -> None:
    gantry = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    motion = replace(
        LIMITS,
        axis_matrix=gantry,
        velocity_mm_s=np.full(3, 90.0),
        acceleration_mm_s2=np.array([400.0, 300.0, 700.0]),
        jerk_mm_s3=np.array([9000.0, 9000.0, 20000.0]),
    )
    rows = rows_of_a_line(0.5, MotionLimits(("XR", "XL", "Y"), motion), gantry)
    # Velocity, acceleration of the second X and of Y, jerk of the first X and of Y.
    assert rows.coefficients.shape[2] == 5
    assert np.allclose(rows.coefficients["on_slope"][0, 0, 1:3], [0.5 / 300.0, 0.25 / 700.0])
    assert np.allclose(rows.coefficients["on_root_bend"][0, 0, 3:5], [0.5 / 9000.0, 0.25 / 20000.0])


def test_limits_that_are_not_given_have_no_rows() -> None:
    infinite = np.full(2, np.inf)
    kinematic = KinematicLimits(LIMITS.axis_matrix, LIMITS.feed_mm_s, LIMITS.velocity_mm_s, infinite, infinite)
    assert mesh(limits=MotionLimits(("X", "Y"), kinematic)).rows.coefficients.shape[2] == 1


@pytest.mark.parametrize("limits", [MOTION, DRIVEN])
def test_what_is_dropped_at_the_end_of_a_span_stands_at_the_start_of_the_next(limits: MotionLimits) -> None:
    here = mesh(limits=limits)
    before = here.used()
    drop_repeated(here.rows)
    after = here.used()
    dropped = (after == 0.0) & (before != 0.0)
    assert np.any(dropped)
    assert not np.any(dropped[:, :, :-1]) and not np.any(dropped[..., -1])
    # Only rows without q'', and each is as large at the other side of the knot.
    assert not np.any(dropped[here.rows.over_root > 0.0])
    spans = np.nonzero(dropped[:, :, -1])
    np.testing.assert_allclose(
        before[:, :, -1][spans], before[:, :, 0][spans[0], spans[1], spans[2] + 1], rtol=1e-5, atol=1e-9
    )


def test_row_is_kept_where_the_limits_differ_on_the_two_sides_of_a_knot() -> None:
    here = mesh()
    here.rows.inverse_limits[4, -1] *= 1.01
    drop_repeated(here.rows)
    assert np.all(here.rows.inverse_limits[4, -1, 1:] > 0.0)


def test_scale_tightens_every_row() -> None:
    tight = mesh(scale=0.5)
    lowered = KinematicLimits(
        LIMITS.axis_matrix,
        0.5 * LIMITS.feed_mm_s,
        0.5 * LIMITS.velocity_mm_s,
        0.5 * LIMITS.acceleration_mm_s2,
        0.5 * LIMITS.jerk_mm_s3,
    )
    assert np.allclose(tight.used(), mesh(limits=MotionLimits(("X", "Y"), lowered)).used(), rtol=1e-12)


def test_scale_tightens_drive_limits_offset_and_friction_included() -> None:
    control, tracking = DRIVEN.control, DRIVEN.tracking
    assert control is not None and tracking is not None
    lowered = replace(
        DRIVEN,
        kinematic=replace(
            DRIVEN.kinematic,
            feed_mm_s=0.9 * DRIVEN.kinematic.feed_mm_s,
            velocity_mm_s=0.9 * DRIVEN.kinematic.velocity_mm_s,
            acceleration_mm_s2=0.9 * DRIVEN.kinematic.acceleration_mm_s2,
            jerk_mm_s3=0.9 * DRIVEN.kinematic.jerk_mm_s3,
        ),
        control=replace(control, limit_volts=0.9 * control.limit_volts),
        tracking=replace(tracking, limit_mm=0.9 * tracking.limit_mm),
    )
    assert np.allclose(mesh(limits=DRIVEN, scale=0.9).used(), mesh(limits=lowered).used(), rtol=1e-12)


def test_given_start_state_keeps_only_rows_that_depend_on_the_second_derivative() -> None:
    here = mesh(limits=DRIVEN)
    before = here.rows.inverse_limits.copy()
    release_start_state(here.rows)
    after = here.rows.inverse_limits
    # One row of velocity, two each of acceleration, control, jerk and tracking error.
    assert np.all(after[0, 0, :5] == 0.0)
    assert np.array_equal(after[0, 0, 5:], before[0, 0, 5:]) and np.all(before[0, 0, 5:] > 0.0)
    assert np.array_equal(after[0, 1:], before[0, 1:]) and np.array_equal(after[1:], before[1:])


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
    found = limit_ratios(toolpath, MOTION, profile)
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
    """Largest velocity, acceleration and jerk of the standstill element over their limits, sampled in time."""
    jerk = 2.0 / 9.0 * p**1.5
    duration = np.cbrt(6.0 * length_mm / jerk)
    t = duration * np.linspace(1e-3, 1.0, 400)
    points = toolpath.evaluate(at_mm + sign * jerk * t**3 / 6.0)
    # The sense of travel is that of s: next to an end at standstill, time runs backwards.
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
    p = standstill_scale_limit(toolpath, MOTION, at_mm, length_mm, sign, 1.0)
    ratios = rest_ratios(toolpath, at_mm, length_mm, sign, p)
    assert np.max(ratios) == pytest.approx(1.0, abs=2e-3)


def test_rest_element_on_a_line_has_the_axis_jerk() -> None:
    toolpath = toolpath_of([line(10.0)])
    length = standstill_length_mm(toolpath, LIMITS, 0.0, +1)
    # A part of the distance in which 9000 mm/s^3 builds up 400 mm/s^2.
    assert 0.0 < length < 400.0**3 / (6.0 * 9000.0**2)
    p = standstill_scale_limit(toolpath, MOTION, 0.0, length, +1, 1.0)
    assert 2.0 / 9.0 * p**1.5 == pytest.approx(9000.0, rel=1e-12)
    half = standstill_scale_limit(toolpath, MOTION, 0.0, length, +1, 0.5)
    assert 2.0 / 9.0 * half**1.5 == pytest.approx(4500.0, rel=1e-12)


def test_rest_element_looks_at_its_own_side_of_a_corner() -> None:
    toolpath = toolpath_of(polyline([(0, 0), (10, 0), (10, 10)]))
    before = standstill_scale_limit(toolpath, MOTION, 10.0, 0.1, -1, 1.0)
    after = standstill_scale_limit(toolpath, MOTION, 10.0, 0.1, +1, 1.0)
    assert 2.0 / 9.0 * before**1.5 == pytest.approx(9000.0, rel=1e-9)
    assert 2.0 / 9.0 * after**1.5 == pytest.approx(20000.0, rel=1e-9)


def test_rest_element_on_an_arc_obeys_the_velocity_limit_too() -> None:
    slow = KinematicLimits(np.eye(2), 1.0, np.array([1.0, 1.0]), np.array([1e6, 1e6]), np.array([1e9, 1e9]))
    toolpath = toolpath_of([planar(SegmentKind.ARC, 10.0, curvature=0.1)])
    p = standstill_scale_limit(toolpath, MotionLimits(("X", "Y"), slow), 0.0, 2.0, +1, 1.0)
    assert p * 2.0 ** (4.0 / 3.0) == pytest.approx(1.0, rel=1e-6)


def test_kinds_of_elements_are_those_of_the_message() -> None:
    assert (ElementKind.QUADRATIC, ElementKind.REST_START, ElementKind.REST_END) == (0, 1, 2)
