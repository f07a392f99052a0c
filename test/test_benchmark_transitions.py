"""The comparison of layer transitions: its programs lead without a gap through the same contours."""

from __future__ import annotations

import importlib
import itertools
from pathlib import Path

import numpy as np
import pytest

from feedopt_core.programs.contours import move_ends
from feedopt_core.programs.moves import NurbsMove
from feedopt_core.smoothing.stage import smooth

WORKSPACE = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def bench():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(WORKSPACE))
        yield importlib.import_module("benchmark.transitions")


@pytest.fixture(params=["rounded rectangle, 80 x 50 mm", "fan contour, spline"])
def contour(bench, request):
    return bench.contours()[request.param]


def test_programs_have_no_gap_and_reach_every_layer(bench, contour):
    for way in bench.WAYS:
        program = bench.stacked(contour, way, 3, 1.0, 8.0)
        for before, after in itertools.pairwise(program):
            assert move_ends(before)[1] == pytest.approx(move_ends(after)[0], abs=1e-9)
        assert move_ends(program[-1])[1][2] == (0.0 if way == bench.WAYS[0] else -2.0)


def test_ways_reach_equally_far(bench, contour):
    """Farthest place beside the contour, measured from the tangent at its start, which is level here or nearly so."""
    start = move_ends(contour[0])[0]
    tangent = next(iter(smooth(iter(contour), 0.01, 3))).evaluate(np.zeros(1)).dr_ds[0]
    right = np.cross(tangent, [0.0, 0.0, 1.0])
    for way in ("quarter arcs", "half circles", "Euler spirals"):
        added = bench.stacked(contour, way, 2, 1.0, 8.0)[len(contour) : -len(contour)]
        reached = max(
            float(np.max((segment.evaluate(np.linspace(0.0, segment.length_mm, 200)).r_mm - start) @ right))
            for segment in smooth(iter(added), 0.01, 3)
        )
        assert reached == pytest.approx(8.0, rel=0.015)


def test_spirals_replace_every_step_down(bench, contour):
    program = bench.stacked(contour, "Euler spirals", 4, 1.0, 8.0)
    own = sum(isinstance(move, NurbsMove) for move in contour)
    assert sum(isinstance(move, NurbsMove) for move in program) == 4 * own + 3
    assert not any(segment.place.exact_stop for segment in smooth(iter(program), 0.01, 3))
