"""The audit of a motion that ends at an exact stop: the path behind the stop is none of its business."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_paths import kinematic_machine

from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.pipeline.read_program import read_program
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner

PROGRAM = "G21 G61 F9000\nG1 X40\nG1 X56 Y30\nM2\n"


@pytest.mark.parametrize("late", [False, True], ids=["before the next segment comes", "behind it"])
def test_ratio_of_the_first_motion_does_not_depend_on_the_segment_behind_its_stop(late: bool) -> None:
    """The second side moves Y, whose jerk limit is far lower: seen from the wrong side the stop would break it."""
    machine = kinematic_machine(
        feed=150.0, velocity=(150.0, 150.0), acceleration=(500.0, 500.0), jerk=(25000.0, 1000.0)
    )
    segments = list(read_program(PROGRAM, "corner.ngc", 2))
    first = replace(segments[0], place=replace(segments[0].place, last=True))
    alone = StreamPlanner(machine, PlannerParameters(method="lp"))
    alone.add_segment(first)
    chunk = alone.next_chunk()
    assert chunk is not None
    path = Toolpath()
    for segment in segments if late else segments[:1]:
        path.append(segment)
    report = audit_profile(path, chunk.profile, machine)
    assert report.holds
    (jerk_of_y,) = [row.ratio for row in report.rows if (row.quantity, row.axis) == ("jerk", "Y")]
    assert jerk_of_y == pytest.approx(0.0, abs=1e-9)
    assert np.max([row.ratio for row in report.rows]) > 0.99
