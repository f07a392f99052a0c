"""The corpus of planning problems: every row of corpus/problems.yaml, program to audited set points.

Where a row takes several windows they are at most 0.2 % slower than one window for the whole path.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from feedopt_core.errors import FeedoptError
from feedopt_core.machine.machine_file import Machine, load_machine
from feedopt_core.motion.certificate import ALLOWED_RATIO
from feedopt_core.pipeline.plan_program import Plan, plan_program
from feedopt_core.planner.stream_planner import PlannerParameters

Points = NDArray[np.float64]
PROBLEMS: list[dict[str, Any]] = yaml.safe_load((Path(__file__).parent / "corpus" / "problems.yaml").read_text("utf-8"))
PERIOD_S = 0.001


def circle(radius: float, count: int) -> Points:
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def zigzag(step: float, height: float, count: int) -> Points:
    index = np.arange(count)
    return np.column_stack([step * index, height * (index % 2)])


def sine(step: float, amplitude: float, count: int, frequency: float = 1.0) -> Points:
    x = step * np.arange(count)
    return np.column_stack([x, amplitude * np.sin(frequency * x)])


def corner(count: int) -> Points:
    along = np.arange(count, dtype=float)
    first = np.column_stack([along, np.zeros(count)])
    return np.concatenate([first, np.column_stack([np.full(count, float(count)), along])])


def spiral(radius: float, turns: float, count: int) -> Points:
    part = np.linspace(1.0, 0.1, count)
    angle = 2.0 * np.pi * turns * part
    return np.column_stack([radius * part * np.cos(angle), radius * part * np.sin(angle)])


def helix(radius: float, pitch: float, turns: float, count: int) -> Points:
    angle = np.linspace(0.0, 2.0 * np.pi * turns, count)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), pitch * angle / (2.0 * np.pi)])


def walk(seed: int, count: int) -> Points:
    draw = np.random.default_rng(seed)
    heading = np.cumsum(draw.uniform(-0.5 * np.pi, 0.5 * np.pi, count))
    chord = draw.uniform(1.0, 20.0, count)
    return np.cumsum(chord[:, None] * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)


FAMILIES: dict[str, Callable[..., Points]] = {
    family.__name__: family for family in (circle, zigzag, sine, corner, spiral, helix, walk)
}


def program_text(problem: dict[str, Any]) -> str:
    """Text of a row's program."""
    for key in ("text", "gcode"):
        if key in problem:
            return str(problem[key])
    points = problem["points"]
    if isinstance(points, dict):
        numbers = dict(points)
        points = FAMILIES[numbers.pop("family")](**numbers).tolist()
    return "".join(",".join(repr(float(value)) for value in point) + "\n" for point in points)


def rows() -> list[Any]:
    return [pytest.param(problem, id=problem["name"]) for problem in PROBLEMS]


def assert_holds(plan: Plan, machine: Machine, expect: dict[str, Any]) -> None:
    """The audit passes, and so do the differences of the set points without it; the motion covers the whole path."""
    assert plan.audit.holds, plan.audit.worst
    x = plan.setpoints.position_mm
    values = np.concatenate([np.repeat(x[:1], 4, axis=0), x, np.repeat(x[-1:], 4, axis=0)])
    for limits in (machine.velocity_limit_mm_s, machine.acceleration_limit_mm_s2, machine.jerk_limit_mm_s3):
        values = np.diff(values, axis=0) / PERIOD_S
        assert np.max(np.abs(values) / limits) <= ALLOWED_RATIO
    assert plan.setpoints.s_mm[0] == 0.0
    assert plan.setpoints.s_mm[-1] == pytest.approx(plan.toolpath.end_mm, abs=1e-9)
    assert not any(chunk.figures.fallback for chunk in plan.chunks)
    assert plan.motion_time_s <= expect.get("max_time_s", np.inf)
    assert plan.deviation is None or plan.deviation.holds
    if "stops" in expect:
        assert len(plan.toolpath.exact_stops_mm()) == expect["stops"]


@pytest.mark.parametrize("problem", rows())
def test_problem(problem: dict[str, Any], tmp_path: Path) -> None:
    machine, expect = load_machine(problem["machine"]), problem["expect"]
    program = tmp_path / ("program.ngc" if "gcode" in problem else "program.csv")
    program.write_text(program_text(problem), encoding="utf-8")
    if "error" not in expect:
        plan = plan_program(program, machine, PlannerParameters())
        assert_holds(plan, machine, expect)
        if len(plan.chunks) > 1 + len(plan.toolpath.exact_stops_mm()):
            whole = plan_program(program, machine, PlannerParameters(commitment_mm=1e6))
            assert plan.motion_time_s <= 1.002 * whole.motion_time_s
        return
    with pytest.raises(FeedoptError) as caught:
        plan_program(program, machine, PlannerParameters())
    assert type(caught.value).__name__ == expect["error"]
    for place in ("line", "column"):
        if place in expect:
            assert getattr(caught.value, place) == expect[place]


def test_rows_are_complete() -> None:
    """A row without a remark, or with a word nobody reads, is a mistake."""
    names = [problem["name"] for problem in PROBLEMS]
    assert len(set(names)) == len(names)
    for problem in PROBLEMS:
        assert len(problem.keys() & {"points", "text", "gcode"}) == 1
        assert problem.keys() - {"points", "text", "gcode"} == {"name", "remark", "machine", "expect"}
        assert problem["remark"]
        assert problem["expect"].keys() <= {"holds", "max_time_s", "stops"} or problem["expect"].keys() <= {
            "error",
            "line",
            "column",
        }
