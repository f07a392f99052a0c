"""The comparison of interpolators: the contour of the thesis, the way feed is measured, and what the thesis reports."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from benchmark.curves.parameter_maps import NaturalMap

from feedopt_core.geometry.arc_length import map_arc_length

WORKSPACE = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def bench():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(WORKSPACE))
        yield importlib.import_module("benchmark.interpolators")


@pytest.fixture(scope="module")
def fan(bench):
    curves = bench.fan_curves()
    return curves, [map_arc_length(curve.evaluate, curve.joints).length_mm for curve in curves]


def test_feedrate_of_equal_steps_on_a_line(bench):
    positions = np.outer(np.arange(9) * 50.0 * bench.PERIOD_S, [0.6, 0.8])
    assert bench.feedrates_mm_s(positions) == pytest.approx(np.full(7, 50.0))


def test_natural_interpolation_fluctuates_as_published(bench, fan):
    """33.79 and 68.98 mm/s at a command of 50 mm/s (section 3.4)."""
    row = bench.measure("natural", NaturalMap, *fan, 50.0)
    assert 50.0 * (1.0 + row.least_ratio) == pytest.approx(33.79, abs=0.01)
    assert 50.0 * (1.0 + row.greatest_ratio) == pytest.approx(68.98, abs=0.02)


def test_own_map_leaves_only_the_chord(bench, fan):
    """Central differences over 0.1 mm fall short by at most (0.1 curvature)^2 / 24, nothing is too fast."""
    row = bench.measure("own", lambda curve, _: map_arc_length(curve.evaluate, curve.joints), *fan, 50.0)
    sharpest = 0.0
    for curve in fan[0]:
        _, r_u, r_uu, _ = curve.evaluate(np.linspace(0.0, 1.0, 2001))
        turn = np.abs(r_u[:, 0] * r_uu[:, 1] - r_u[:, 1] * r_uu[:, 0])
        sharpest = max(sharpest, float(np.max(turn / np.linalg.norm(r_u, axis=1) ** 3)))
    assert row.least_ratio > -((0.1 * sharpest) ** 2) / 24.0 - 1e-6
    assert row.greatest_ratio < 1e-6
