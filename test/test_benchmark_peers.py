"""The benchmark's own arithmetic: its second check of set points and its comparison at equal limits."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from feedopt_core.config_files import find_config
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.pipeline.read_program import open_program, read_program

WORKSPACE = Path(__file__).resolve().parents[1]


@pytest.fixture
def benchmark_module(monkeypatch):
    monkeypatch.syspath_prepend(str(WORKSPACE))

    def load(name: str) -> ModuleType:
        return importlib.import_module(f"benchmark.peers.{name}")

    return load


def test_differences_of_a_jerk_limited_move_are_its_limits(benchmark_module):
    jerk, ramp_s, period_s = 25000.0, 0.02, 0.001
    edges = ramp_s * np.arange(5)
    t = np.arange(81) * period_s
    # Jerk +J, -J, -J, +J: each switch adds a cubic from its instant on.
    switches = np.array([1.0, -2.0, 0.0, 2.0, -1.0]) * jerk
    position = sum(step * np.maximum(t - edge, 0.0) ** 3 / 6.0 for step, edge in zip(switches, edges, strict=True))
    worst = benchmark_module("finite_differences").worst_differences(position[:, None], period_s)
    assert worst["jerk"][0] == pytest.approx(jerk, rel=1e-6)
    assert worst["acceleration"][0] == pytest.approx(jerk * ramp_s, rel=0.06)
    assert worst["acceleration"][0] <= jerk * ramp_s * (1.0 + 1e-9)
    assert worst["velocity"][0] <= jerk * ramp_s**2 * (1.0 + 1e-9)


def test_differences_see_a_sudden_start(benchmark_module):
    worst = benchmark_module("finite_differences").worst_differences(np.arange(20.0)[:, None] * 0.1, 0.001)
    assert worst["acceleration"][0] == pytest.approx(0.1 / 0.001**2)


def test_the_second_path_is_the_planners_path(benchmark_module):
    program = find_config("programs", "fan_contour", ".csv")
    toolpath = Toolpath()
    for segment in read_program(open_program(program), str(program), 2):
        toolpath.append(segment)
    second = benchmark_module("finite_differences").ChordSpline(program)
    assert second.length_mm == pytest.approx(toolpath.end_mm, abs=1e-8)
    s_mm = np.linspace(0.0, toolpath.end_mm, 5001)
    # A jerk of 25000 mm/s^3 moves the third difference at 1 kHz by 2.5e-5 mm: errors must stay far below.
    np.testing.assert_allclose(second.position_mm(s_mm), toolpath.evaluate(s_mm).r_mm, rtol=0.0, atol=1e-9)


def test_slowing_follows_the_order_of_the_derivative(benchmark_module):
    comparison = benchmark_module("comparison")
    allowed = comparison.ALLOWED_RATIO
    within = {"velocity": 0.5, "acceleration": 0.5, "jerk": 1.0}
    assert comparison.slowing({"X": within}) == 1.0
    assert comparison.slowing({"X": within, "Y": within | {"jerk": 8.0 * allowed}}) == pytest.approx(2.0)
    assert comparison.slowing({"X": within | {"acceleration": 9.0 * allowed}}) == pytest.approx(3.0)
    assert comparison.slowing({"X": within | {"velocity": 1.5 * allowed}}) == pytest.approx(1.5)
