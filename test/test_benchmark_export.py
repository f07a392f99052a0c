"""The models of ordinary controllers that exported programs are timed on, against closed forms."""

from __future__ import annotations

import importlib
import math
from pathlib import Path

import numpy as np
import pytest

GRBL = ("grbl", (100.0, 100.0), (500.0, 1000.0), 0.01, 0.0, 16)
KLIPPER = ("klipper", (100.0, 100.0), (500.0, 1000.0), 0.0, 5.0, 0)


@pytest.fixture
def ride(monkeypatch):
    """Rides on a controller given by the fields of its class."""
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[1])
    lookahead = importlib.import_module("benchmark.export.lookahead")
    return lambda fields, points, feeds: lookahead.ride(lookahead.Controller(*fields), points, feeds)


@pytest.mark.parametrize("controller", [GRBL, KLIPPER])
def test_straight_move_is_a_trapezoid(ride, controller):
    """60 mm at 80 mm/s with 500 mm/s^2: 0.16 s up and down over 12.8 mm, the rest at full speed."""
    one = ride(controller, np.array([[0.0, 0.0], [60.0, 0.0]]), np.array([80.0]))
    assert one.total_s == pytest.approx(2 * 0.16 + (60.0 - 12.8) / 80.0)


def test_short_move_is_a_triangle(ride):
    one = ride(GRBL, np.array([[0.0, 0.0], [0.0, 10.0]]), np.array([500.0]))
    assert one.total_s == pytest.approx(2.0 * math.sqrt(10.0 / 1000.0))
    assert one.peak_mm_s[0] == pytest.approx(math.sqrt(1000.0 * 10.0))


def test_straight_moves_in_a_row_are_one_for_a_long_look_ahead(ride):
    x = np.linspace(0.0, 60.0, 61)
    points = np.stack([x, 0.0 * x], axis=1)
    whole = ride(KLIPPER, points[[0, -1]], np.array([80.0])).total_s
    assert ride(KLIPPER, points, np.full(60, 80.0)).total_s == pytest.approx(whole)
    # From no more than sqrt(2 a l) can the machine stop within sixteen moves of 0.1 mm.
    short = ride(GRBL, np.stack([np.linspace(0.0, 60.0, 601), np.zeros(601)], axis=1), np.full(600, 80.0))
    assert np.max(short.start_mm_s) <= math.sqrt(2.0 * 500.0 * 16 * 0.1) + 1e-9
    assert np.max(short.start_mm_s) == pytest.approx(math.sqrt(2.0 * 500.0 * 16 * 0.1))
    assert short.total_s > 1.5 * whole


def test_right_angle_is_taken_at_the_speed_of_each_rule(ride):
    points, feeds = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 30.0]]), np.array([80.0, 80.0])
    grbl, klipper = ride(GRBL, points, feeds), ride(KLIPPER, points, feeds)
    half = math.sqrt(0.5)
    # Along the bisector the weaker axis allows 500 / cos 45 degrees.
    expected = math.sqrt(500.0 / half * 0.01 * half / (1.0 - half))
    assert grbl.start_mm_s[1] == pytest.approx(expected)
    assert klipper.start_mm_s[1] == pytest.approx(5.0)


def test_polygon_of_a_circle_is_driven_at_the_centripetal_limit_by_klipper(ride):
    """Chords of 1 mm of a circle of 10 mm: v^2 = a r, as the moves become short."""
    angle = np.linspace(0.0, 6.0, 2401)
    points = 10.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    one = ride(("klipper", (1e3, 1e3), (500.0, 500.0), 0.0, 50.0, 0), points, np.full(2400, 1e3))
    assert np.median(one.start_mm_s) == pytest.approx(math.sqrt(500.0 * 10.0), rel=1e-3)


def test_samples_end_where_the_moves_end_and_agree_with_the_speed(ride):
    rng = np.random.default_rng(5)
    points = np.cumsum(rng.uniform(-4.0, 4.0, (60, 2)), axis=0)
    one = ride(GRBL, points, rng.uniform(5.0, 90.0, 59))
    s, v = one.sampled(1e-4)
    assert s[0] == 0.0 and np.sum(one.length_mm) - s[-1] < 1e-3
    assert np.all(np.diff(s) >= -1e-9)
    np.testing.assert_allclose(np.diff(s) / 1e-4, 0.5 * (v[1:] + v[:-1]), atol=0.11)
    # Speeds at the ends of moves are those that were promised, and never above the feeds.
    assert np.all(one.peak_mm_s <= 90.0 + 1e-9)
    np.testing.assert_allclose(one.end_mm_s[:-1], one.start_mm_s[1:], atol=1e-9)
