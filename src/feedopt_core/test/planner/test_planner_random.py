"""Random smooth paths under random limits: every plan holds at 1 kHz and between the set points."""

from __future__ import annotations

import numpy as np
import pytest
from core_motion import ONE_WINDOW, difference_ratios, plan_path
from core_paths import drive_machine, kinematic_machine, spline, wandering_points
from hypothesis import given, settings
from hypothesis import strategies as st

from feedopt_core.motion.certificate import ALLOWED_RATIO
from feedopt_core.planner.stream_planner import PlannerParameters

WALK = st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(3.0, 15.0)), min_size=1, max_size=9)
WINDOWED = PlannerParameters(look_ahead_mm=25.0, commitment_mm=15.0)


@settings(max_examples=12)
@given(
    walk=WALK,
    feed=st.floats(5.0, 400.0),
    velocity=st.tuples(st.floats(20.0, 300.0), st.floats(20.0, 300.0)),
    acceleration=st.tuples(st.floats(50.0, 5000.0), st.floats(50.0, 5000.0)),
    jerk=st.tuples(st.floats(2e3, 2e5), st.floats(2e3, 2e5)),
    windowed=st.booleans(),
)
def test_plan_holds_every_limit(
    walk: list[tuple[float, float]],
    feed: float,
    velocity: tuple[float, float],
    acceleration: tuple[float, float],
    jerk: tuple[float, float],
    windowed: bool,
) -> None:
    machine = kinematic_machine(feed, velocity, acceleration, jerk)
    points = wandering_points(*zip(*walk, strict=True))
    planned = plan_path(machine, spline(points), WINDOWED if windowed else ONE_WINDOW)
    setpoints = planned.setpoints()
    assert planned.fine_audit().worst.ratio <= ALLOWED_RATIO
    ratios = difference_ratios(setpoints.position_mm, machine)
    assert max(ratios.values()) <= ALLOWED_RATIO, ratios
    assert np.all(np.diff(setpoints.s_mm) >= 0.0)
    assert np.allclose(setpoints.position_mm[[0, -1]], points[[0, -1]], atol=1e-7)


@settings(max_examples=6)
@given(walk=WALK, control_volts=st.floats(3.0, 10.0), tracking_error_mm=st.floats(0.012, 0.05))
def test_plan_holds_the_drive_limits(
    walk: list[tuple[float, float]], control_volts: float, tracking_error_mm: float
) -> None:
    machine = drive_machine(control_volts, tracking_error_mm)
    report = plan_path(machine, spline(wandering_points(*zip(*walk, strict=True))), WINDOWED).fine_audit()
    assert report.worst.ratio <= ALLOWED_RATIO
    assert {row.quantity for row in report.rows} >= {"control", "tracking_error"}


@settings(max_examples=4)
@given(walk=st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(5.0, 15.0)), min_size=6, max_size=9))
def test_windows_cost_little_time(walk: list[tuple[float, float]]) -> None:
    """Look-ahead above the stopping distance: what the windows cannot see hardly matters."""
    segments = spline(wandering_points(*zip(*walk, strict=True)))
    machine = kinematic_machine(feed=60.0)
    whole = plan_path(machine, segments)
    windowed = plan_path(machine, segments, PlannerParameters(look_ahead_mm=20.0, commitment_mm=10.0))
    assert windowed.motion_time_s == pytest.approx(whole.motion_time_s, rel=2e-3)
