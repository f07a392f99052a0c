"""A dwell behind an exact stop: the machine waits there for the dwell time, and loses no time elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from core_motion import PERIOD_S, plan_path
from core_paths import kinematic_machine, polyline

from feedopt_core.geometry.segments import PlanarSegment
from feedopt_core.planner.stream_planner import PlannerParameters

MACHINE = kinematic_machine()
SHORT_WINDOWS = PlannerParameters(look_ahead_mm=15.0, commitment_mm=10.0)
CORNERS: list[tuple[float, float]] = [(0, 0), (40, 0), (40, 30), (0, 30)]


def with_dwells(dwells_s: Sequence[float]) -> list[PlanarSegment]:
    return [
        replace(segment, place=replace(segment.place, dwell_s=dwell))
        for segment, dwell in zip(polyline(CORNERS), dwells_s, strict=True)
    ]


@pytest.mark.parametrize("dwells_s", [(0.25, 0.0, 0.0), (0.0, 0.125, 0.0), (0.25, 0.125, 0.0)])
def test_dwell_is_spent_at_rest_at_its_corner(dwells_s: tuple[float, ...]) -> None:
    without, planned = plan_path(MACHINE, polyline(CORNERS)), plan_path(MACHINE, with_dwells(dwells_s))
    assert planned.motion_time_s == pytest.approx(without.motion_time_s + sum(dwells_s), abs=1e-9)
    setpoints = planned.setpoints()
    for corner_mm, dwell_s in zip((40.0, 70.0), dwells_s, strict=False):
        rests = np.count_nonzero(np.abs(setpoints.s_mm - corner_mm) < 1e-9) * PERIOD_S
        assert rests == pytest.approx(dwell_s, abs=4.0 * PERIOD_S)


def test_dwell_at_the_end_is_waited_out() -> None:
    planned = plan_path(MACHINE, with_dwells((0.0, 0.0, 0.5)))
    setpoints = planned.setpoints()
    assert setpoints.t_s[-1] == pytest.approx(planned.motion_time_s + 0.5, abs=PERIOD_S)
    assert np.all(setpoints.s_mm[setpoints.t_s > planned.motion_time_s] == setpoints.s_mm[-1])


def test_short_windows_keep_the_dwell() -> None:
    dwells_s = (0.25, 0.125, 0.0)
    whole = plan_path(MACHINE, with_dwells(dwells_s))
    windows = plan_path(MACHINE, with_dwells(dwells_s), SHORT_WINDOWS)
    assert [chunk.dwell_s for chunk in windows.chunks if chunk.dwell_s] == [0.25, 0.125]
    assert windows.motion_time_s == pytest.approx(whole.motion_time_s, rel=2e-3)
