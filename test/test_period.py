"""The period of the set points comes from the machine file and holds from the plan to the judged recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from feedopt_core.errors import ConfigError
from feedopt_core.machine.machine_file import load_machine, parse_machine
from feedopt_core.pipeline.plan_program import Plan, plan_program
from feedopt_core.planner.stream_planner import PlannerParameters
from feedopt_tools.command.main import main
from feedopt_tools.export.motion import motion_of_plan
from feedopt_tools.export.samples import rows_every
from router_sim.machine_file import load_matching_router
from router_sim.router import SimulatedRouter

PERIODS_S = (0.00025, 0.001, 0.01)
PROGRAM = "G21 G90 F6000\nG1 X20\nX25 Y5\nG3 X20 Y10 I-5 J0\nG1 X0\nY0\nM2\n"


def machine_file(folder: Path, period_s: float, servo_period_s: float | None = None) -> Path:
    """router_simulation with another period; its loops are as slow as a period of 10 ms needs."""
    text = load_machine("router_simulation").yaml_text
    text = text.replace("    machine:\n", f"    machine:\n      period_s: {period_s}\n", 1)
    text = text.replace("servo_period_s: 0.001", f"servo_period_s: {servo_period_s or period_s}")
    if period_s > 0.001:
        text = text.replace("position_gain_per_s: [80.0, 80.0]", "position_gain_per_s: [8.0, 8.0]")
        text = text.replace("velocity_gain_volts_s_mm: [0.426, 0.25]", "velocity_gain_volts_s_mm: [0.0426, 0.025]")
        text = text.replace("velocity_integral_per_s: [60.0, 60.0]", "velocity_integral_per_s: [6.0, 6.0]")
    path = folder / "machine.yaml"
    path.write_text(text, "utf-8")
    return path


def planned(folder: Path, period_s: float) -> Plan:
    program = folder / "part.ngc"
    program.write_text(PROGRAM, "utf-8")
    return plan_program(program, load_machine(str(machine_file(folder, period_s))), PlannerParameters())


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_set_points_of_every_period_hold_the_limits(tmp_path: Path, period_s: float) -> None:
    plan = planned(tmp_path, period_s)
    machine = load_machine("router_simulation")
    np.testing.assert_allclose(np.diff(plan.setpoints.t_s), period_s, rtol=1e-9)
    assert plan.setpoints.t_s[-1] == pytest.approx(plan.motion_time_s, abs=period_s)
    assert {row.grid for row in plan.audit.rows} == {"fine", "set points"}
    assert plan.audit.holds
    judged = {row.quantity for row in plan.audit.rows if row.grid == "set points"}
    assert {"velocity", "jerk"} <= judged
    # Differences over 40 ms say nothing of a servo; the fine grid has the drive models at every period.
    assert ({"control", "tracking_error"} <= judged) == (period_s <= 0.0025)
    assert {"control", "tracking_error"} <= {row.quantity for row in plan.audit.rows if row.grid == "fine"}
    # By differences of the set points alone: a plan read with another period would be off by its powers.
    v = np.diff(plan.setpoints.position_mm, axis=0) / period_s
    j = np.diff(v, n=2, axis=0) / period_s**2
    assert np.all(np.max(np.abs(v), axis=0) <= 1.001 * np.array(machine.velocity_limit_mm_s))
    assert np.all(np.max(np.abs(j), axis=0) <= 1.001 * np.array(machine.jerk_limit_mm_s3))
    assert np.max(np.abs(v)) > 0.5 * min(machine.velocity_limit_mm_s)


def test_the_plan_does_not_depend_on_the_period(tmp_path: Path) -> None:
    times = {planned(tmp_path, period_s).motion_time_s for period_s in PERIODS_S}
    assert len(times) == 1


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_simulated_router_follows_every_period(tmp_path: Path, period_s: float) -> None:
    """The servo is tuned to the same error law at its period: the error stays of the size of the law."""
    plan = planned(tmp_path, period_s)
    router = SimulatedRouter(load_matching_router(str(machine_file(tmp_path, period_s))))
    x = plan.setpoints.position_mm
    v = np.gradient(x, period_s, axis=0)
    a = np.gradient(v, period_s, axis=0)
    router.reset(x[0].tolist())
    errors = [router.step(*(values[i].tolist() for values in (x, v, a))).tracking_error_mm for i in range(len(x))]
    worst_mm = float(np.max(np.abs(errors)))
    assert worst_mm < 0.04 if period_s <= 0.001 else worst_mm < 0.4, worst_mm


def test_export_knows_the_period_of_the_machine(tmp_path: Path) -> None:
    machine = load_machine(str(machine_file(tmp_path, 0.01)))
    motion = motion_of_plan(planned(tmp_path, 0.01), machine, tmp_path / "part.ngc")
    assert len(rows_every(motion, 0.01)) == len(motion.tick)
    assert np.max(np.abs(motion.velocity_mm_s)) <= 1.001 * max(machine.velocity_limit_mm_s)


@pytest.mark.parametrize("period_s", ["0.00001", "0.2", "-0.001", "fast"])
def test_impossible_period_is_refused_by_name(period_s: str) -> None:
    text = load_machine("case_a").yaml_text
    text = text.replace("    machine:\n", f"    machine:\n      period_s: {period_s}\n", 1)
    with pytest.raises(ConfigError, match="period_s"):
        parse_machine(text, "machine.yaml")


def test_machine_without_a_period_has_a_millisecond() -> None:
    machine = load_machine("case_a")
    assert machine.period_s == 0.001
    assert replace(machine, period_s=0.002) != machine


def test_router_whose_servo_has_another_period_is_refused(tmp_path: Path) -> None:
    path = machine_file(tmp_path, 0.001, servo_period_s=0.002)
    with pytest.raises(ConfigError, match=r"servo_period_s .* 0\.002 s, period_s .* 0\.001 s"):
        load_matching_router(str(path))


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_export_command_takes_the_period_of_the_machine(tmp_path: Path, period_s: float) -> None:
    machine, program, out = machine_file(tmp_path, period_s), tmp_path / "part.ngc", tmp_path / "part.csv"
    program.write_text(PROGRAM, "utf-8")
    arguments = ["export", str(program), "--machine", str(machine), "--format", "csv", "--out", str(out)]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    t_s = np.loadtxt(out, delimiter=",", skiprows=1)[:, 0]
    np.testing.assert_allclose(np.diff(t_s), period_s, rtol=1e-9)
