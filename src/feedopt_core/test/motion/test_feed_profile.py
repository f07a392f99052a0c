"""The exact time law of the feed profile against an integrator and closed forms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import SolverError
from feedopt_core.motion.profile import ElementKind, FeedProfile

BENDS = (200.0, -200.0, 3.0, -3.0, 1e-3, -1e-3, 1e-9, -1e-9, 0.0)


def quadratic(q: float, slope: float, bend: float, width_mm: float) -> FeedProfile:
    """One QUADRATIC element from s = 5 mm."""
    return profile([ElementKind.QUADRATIC], [5.0, 5.0 + width_mm], [q], [slope], [bend], [0.0])


def profile(
    kind: Sequence[int],
    s_mm: Sequence[float],
    q: Sequence[float],
    slope: Sequence[float],
    bend: Sequence[float],
    jerk: Sequence[float],
) -> FeedProfile:
    rows = (np.array(row, dtype=float) for row in (s_mm, q, slope, bend, jerk))
    return FeedProfile(np.array(kind, dtype=np.int64), *rows)


def rest_to_rest(jerk: float = 3000.0, width_mm: float = 0.5) -> FeedProfile:
    """Leaves standstill with constant jerk, passes elements of constant d2q/ds2, comes to standstill the same way."""
    q = (4.5 * jerk) ** (2.0 / 3.0) * width_mm ** (4.0 / 3.0)
    slope = 4.0 / 3.0 * q / width_mm
    bend = -2.0 * slope / 4.0
    kinds = [ElementKind.REST_START, ElementKind.QUADRATIC, ElementKind.QUADRATIC, ElementKind.REST_END]
    top = q + slope * 2.0 + 0.5 * bend * 4.0
    s = [0.0, width_mm, width_mm + 2.0, width_mm + 4.0, 2.0 * width_mm + 4.0]
    return profile(kinds, s, [0.0, q, top, q], [0.0, slope, 0.0, -slope], [0.0, bend, bend, 0.0], [jerk, 0, 0, jerk])


def integrated(q: float, slope: float, bend: float, t_s: FloatArray) -> FloatArray:
    """s - s0 and v by an integrator of order 8, shape (2, n)."""
    solution = solve_ivp(
        lambda _, y: [y[1], 0.5 * (slope + bend * y[0])],
        (0.0, float(t_s[-1])),
        [0.0, np.sqrt(q)],
        method="DOP853",
        t_eval=t_s,
        rtol=1e-12,
        atol=1e-13,
    )
    return np.asarray(solution.y)


@pytest.mark.parametrize("bend", BENDS)
@pytest.mark.parametrize(("q", "slope"), [(400.0, 300.0), (400.0, -250.0), (0.0, 300.0), (2500.0, 0.0)])
def test_quadratic_element_moves_as_an_integrator_finds(q: float, slope: float, bend: float) -> None:
    element = quadratic(q, slope, bend, 0.7)
    t = np.linspace(0.0, element.duration_s, 25)
    states = element.states_at(t)
    x, v = integrated(q, slope, bend, t)
    assert np.allclose(states.s_mm, 5.0 + x, rtol=0.0, atol=1e-9)
    assert np.allclose(states.v_mm_s, v, rtol=1e-8, atol=1e-8)
    assert np.allclose(states.a_mm_s2, 0.5 * (slope + bend * x), rtol=1e-8, atol=1e-7)
    assert np.allclose(states.j_mm_s3, 0.5 * bend * v, rtol=1e-8, atol=1e-7)
    assert states.s_mm[-1] == pytest.approx(5.7, abs=1e-12)


@pytest.mark.parametrize("bend", BENDS)
def test_time_of_an_element_is_the_integral_of_its_slowness(bend: float) -> None:
    element = quadratic(900.0, 100.0, bend, 2.0)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    x = 1.0 + nodes
    expected = float(weights @ (1.0 / np.sqrt(900.0 + 100.0 * x + 0.5 * bend * x**2)))
    assert element.duration_s == pytest.approx(expected, rel=1e-13)


def test_time_and_motion_are_smooth_in_the_bend() -> None:
    """Nothing happens where the formulas change from hyperbolic to series to trigonometric."""
    t = np.array([0.004])
    bends = np.linspace(-60.0, 60.0, 2001)
    s = np.array([quadratic(900.0, 100.0, float(bend), 2.0).states_at(t).s_mm[0] for bend in bends])
    times = np.array([quadratic(900.0, 100.0, float(bend), 2.0).duration_s for bend in bends])
    for values in (s, times):
        assert np.max(np.abs(np.diff(values, n=2))) < 1e-7


def test_constant_feed_is_uniform_motion() -> None:
    element = quadratic(1600.0, 0.0, 0.0, 8.0)
    assert element.duration_s == pytest.approx(0.2, rel=1e-15)
    assert element.states_at(np.array([0.05])).s_mm[0] == pytest.approx(7.0, rel=1e-15)


@pytest.mark.parametrize("jerk", [10.0, 25000.0, 1e7])
def test_elements_at_rest_have_constant_jerk(jerk: float) -> None:
    width = 0.3
    leaving = profile([ElementKind.REST_START], [0.0, width], [0.0], [0.0], [0.0], [jerk])
    duration = np.cbrt(6.0 * width / jerk)
    assert leaving.duration_s == pytest.approx(duration, rel=1e-14)
    t = np.linspace(0.0, duration, 21)
    states = leaving.states_at(t)
    assert np.allclose(states.s_mm, jerk * t**3 / 6.0, atol=1e-14)
    assert np.allclose(states.v_mm_s, jerk * t**2 / 2.0, rtol=1e-12)
    assert np.allclose(states.a_mm_s2, jerk * t, rtol=1e-12)
    assert np.all(states.j_mm_s3 == jerk)
    q = (4.5 * jerk) ** (2.0 / 3.0) * width ** (4.0 / 3.0)
    arriving = profile([ElementKind.REST_END], [0.0, width], [q], [-4.0 / 3.0 * q / width], [0.0], [jerk])
    assert arriving.duration_s == pytest.approx(duration, rel=1e-14)
    mirrored = arriving.states_at(duration - t)
    assert np.allclose(mirrored.s_mm, width - states.s_mm, atol=1e-14)
    assert np.allclose(mirrored.v_mm_s, states.v_mm_s, rtol=1e-9, atol=1e-12 * jerk)
    assert np.allclose(mirrored.a_mm_s2, -states.a_mm_s2, rtol=1e-9, atol=1e-12 * jerk)


def test_q_of_elements_agrees_with_their_motion() -> None:
    whole = rest_to_rest()
    states = whole.states_at(np.linspace(0.0, whole.duration_s, 300)[1:-1])
    q, slope, bend = whole.q_at(states.s_mm)
    assert np.allclose(q, states.v_mm_s**2, rtol=1e-9)
    assert np.allclose(slope, 2.0 * states.a_mm_s2, rtol=1e-8, atol=1e-7)
    assert np.allclose(bend * np.sqrt(q), 2.0 * states.j_mm_s3, rtol=1e-7)


def test_velocity_and_acceleration_are_continuous_at_joints() -> None:
    whole = rest_to_rest()
    inner = whole.times_s[1:-1]
    before, after = whole.states_at(inner - 1e-12), whole.states_at(inner + 1e-12)
    assert np.allclose(before.s_mm, after.s_mm, atol=1e-9)
    assert np.allclose(before.v_mm_s, after.v_mm_s, atol=1e-8)
    assert np.allclose(before.a_mm_s2, after.a_mm_s2, atol=1e-5)


def test_states_outside_the_profile_are_those_of_its_ends() -> None:
    whole = rest_to_rest()
    states = whole.states_at(np.array([-1.0, 0.0, whole.duration_s, whole.duration_s + 1.0]))
    assert np.allclose(states.s_mm, [0.0, 0.0, 5.0, 5.0], atol=1e-15)
    assert np.allclose(states.v_mm_s, 0.0, atol=1e-9)
    assert np.allclose(states.a_mm_s2, 0.0, atol=1e-9)


@given(
    q=st.floats(1.0, 2e4),
    slope=st.floats(-500.0, 500.0),
    bend=st.floats(-300.0, 300.0),
    part=st.floats(0.0, 1.0),
)
def test_time_and_place_are_inverse(q: float, slope: float, bend: float, part: float) -> None:
    width = 0.25
    if min(q + slope * x + 0.5 * bend * x**2 for x in np.linspace(0.0, width, 9)) < 0.1:
        return
    element = quadratic(q, slope, bend, width)
    s = np.array([5.0 + part * width])
    assert element.states_at(element.time_at(s)).s_mm[0] == pytest.approx(s[0], abs=1e-12)
    t = np.array([part * element.duration_s])
    assert element.time_at(element.states_at(t).s_mm)[0] == pytest.approx(t[0], abs=1e-12)


def test_time_and_place_are_inverse_over_rest_and_joints() -> None:
    whole = rest_to_rest()
    s = np.linspace(0.0, whole.s_mm[-1], 401)
    assert np.allclose(whole.states_at(whole.time_at(s)).s_mm, s, atol=1e-12)
    assert whole.time_at(s[[0, -1]]).tolist() == [0.0, pytest.approx(whole.duration_s, rel=1e-15)]


def test_slices_keep_the_motion() -> None:
    whole = rest_to_rest()
    for cut in (1, 2, 3):
        first, second = whole[:cut], whole[cut:]
        assert first.duration_s + second.duration_s == pytest.approx(whole.duration_s, rel=1e-14)
        assert np.allclose(second.times_s, whole.times_s[cut:] - whole.times_s[cut], atol=1e-15)
        for name in ("kind", "q_mm2_s2", "dq_ds_mm_s2", "d2q_ds2_per_s2", "jerk_mm_s3"):
            parts = np.concatenate([getattr(first, name), getattr(second, name)])
            assert np.array_equal(parts, getattr(whole, name))


@pytest.mark.parametrize(
    ("q", "slope", "bend"),
    [
        (1.0, -10.0, 0.0),
        (1.0, -10.0, 20.0),
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 5.0),
        (-1.0, 10.0, 0.0),
        (float("nan"), 0.0, 0.0),
        (1.0, float("nan"), 0.0),
        (float("inf"), 0.0, 0.0),
    ],
)
def test_profile_that_stops_or_is_not_finite_is_refused(q: float, slope: float, bend: float) -> None:
    with pytest.raises(SolverError, match="stops or reverses at s = 5 mm"):
        quadratic(q, slope, bend, 1.0)


def test_profile_names_the_element_it_stops_in() -> None:
    with pytest.raises(SolverError, match="stops or reverses at s = 6 mm"):
        profile([0, 0, 0], [5.0, 6.0, 7.0, 8.0], [4.0, 4.0, 4.0], [0.0, -9.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])


@pytest.mark.parametrize("jerk", [0.0, -5.0, float("nan")])
def test_element_at_rest_needs_a_positive_jerk(jerk: float) -> None:
    with pytest.raises(SolverError):
        profile([ElementKind.REST_START], [0.0, 1.0], [0.0], [0.0], [0.0], [jerk])


def test_element_may_end_exactly_at_zero_feed() -> None:
    """Uniform braking to standstill: q falls linearly to 0, s and t are those of constant acceleration."""
    element = quadratic(100.0, -50.0, 0.0, 2.0)
    assert element.duration_s == pytest.approx(10.0 / 25.0, rel=1e-12)
    assert element.states_at(np.array([element.duration_s])).v_mm_s[0] == pytest.approx(0.0, abs=1e-9)
