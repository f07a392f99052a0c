"""Our own programs and real ones, from G-code to an audited plan."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from core_paths import kinematic_machine

from feedopt_core.audit.deviation import measure_deviation
from feedopt_core.machine.machine_file import Machine
from feedopt_core.pipeline.plan_program import Plan, plan_program
from feedopt_core.pipeline.read_program import open_program, read_moves, read_program
from feedopt_core.planner.stream_planner import PlannerParameters

WORKSPACE = Path(__file__).resolve().parents[1]
sys.path.append(str(WORKSPACE))
programs = importlib.import_module("benchmark.programs.own")
REAL_PROGRAMS = Path(os.environ.get("FEEDOPT_PROGRAMS", WORKSPACE.parent / "shared" / "data" / "programs"))


def machine_with(dimensions: int) -> Machine:
    each = (1.0,) * dimensions
    return kinematic_machine(
        feed=150.0,
        velocity=tuple(150.0 * one for one in each),
        acceleration=tuple(500.0 * one for one in each),
        jerk=tuple(25000.0 * one for one in each),
    )


def planned(path: Path, dimensions: int, tolerance_mm: float = 0.01) -> Plan:
    return plan_program(path, machine_with(dimensions), PlannerParameters(method="lp"), tolerance_mm)


@pytest.mark.parametrize("name", programs.OWN_PROGRAMS)
def test_own_program_goes_from_file_to_audited_plan(tmp_path: Path, name: str) -> None:
    dimensions, text = programs.OWN_PROGRAMS[name]
    path = tmp_path / f"{name}.ngc"
    path.write_text(text(), encoding="utf-8")
    plan = planned(path, dimensions)
    assert plan.audit.holds
    assert plan.deviation is not None
    assert plan.deviation.holds
    assert not any(chunk.figures.fallback for chunk in plan.chunks)


def test_program_in_inches_gives_the_same_segments(tmp_path: Path) -> None:
    found = []
    for name, unit in (("mm", 1.0), ("inch", 25.4)):
        path = tmp_path / f"{name}.ngc"
        path.write_text(programs.circle_diamond_square(unit=unit), encoding="utf-8")
        found.append(list(read_program(open_program(path), str(path), 2)))
    assert [segment.kind for segment in found[0]] == [segment.kind for segment in found[1]]
    lengths = [[segment.length_mm for segment in segments] for segments in found]
    assert np.allclose(*lengths, atol=1e-5)
    feeds = [[segment.place.feed_limit_mm_s for segment in segments] for segments in found]
    assert np.allclose(*feeds, rtol=1e-6)


@pytest.mark.parametrize("name", ["butterfly-xy.ngc", "cds.ngc"])
def test_real_program_is_smoothed_within_the_tolerance(name: str) -> None:
    path = REAL_PROGRAMS / name
    if not path.exists():
        pytest.skip(f"{path} is not here; FEEDOPT_PROGRAMS names the folder of real programs")
    program = open_program(path)
    segments = list(read_program(program, name, 3))
    assert measure_deviation(read_moves(program, name), segments, 0.01).holds
    assert segments[-1].place.last
