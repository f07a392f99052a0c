"""Tracking error of the simulated servos for plans that limit it by the quasi-static model.

Run: ``./feedopt bench servo``. The fan contour on router_simulation with several jerk limits and reserves of the
tracking error: motion time, largest tracking error and control signal of the simulated drives, which share no code with
the planner. The benchmark reports figures, without pass or fail.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.table import Table

from feedopt_core.config_files import find_config
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine, load_machine
from feedopt_core.pipeline.plan_program import interpolate
from feedopt_core.pipeline.read_program import open_program, read_program
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner
from router_sim.machine_file import load_router_parameters
from router_sim.router import SimulatedRouter

MACHINE = "router_simulation"
PROGRAM = "fan_contour"
_FREE = (math.inf, math.inf)
# Method, jerk limits, reserve of the tracking error; the shipped machine is the last row.
_ROWS = (
    ("lp_nlp", _FREE, (0.0, 0.0)),
    ("lp_nlp", (63_000.0, 156_000.0), (0.0, 0.0)),
    ("lp_nlp", (20_000.0, 156_000.0), (0.0, 0.0)),
    ("lp", _FREE, (0.0, 0.0)),
    ("lp", _FREE, (0.001, 0.0)),
)
_SETTLING_TICKS = 200


@dataclass(frozen=True)
class Followed:
    """A motion and the response of the drives: largest magnitude for each axis, ticks with any axis in saturation."""

    motion_time_s: float
    error_mm: tuple[float, ...]
    control_volts: tuple[float, ...]
    saturated_ticks: int


def main(argv: list[str]) -> int:
    """Command line; returns the exit code."""
    argparse.ArgumentParser(prog="feedopt bench servo", description=(__doc__ or "").partition("\n")[0]).parse_args(argv)
    shipped = load_machine(MACHINE)
    columns = ("method", "jerk, mm/s3", "reserve, um", "motion, s", "error, um", "control, V", "saturated, ms")
    table = Table(*columns, title=f"{PROGRAM} on {MACHINE}, tracking error within 20 um by the model")
    for method, jerk, reserve in _ROWS:
        machine = replace(shipped, jerk_limit_mm_s3=jerk, tracking_error_reserve_mm=reserve)
        table.add_row(*_cells(method, machine, followed(machine, MACHINE, method)))
    for method in ("lp_nlp", "lp"):
        table.add_row(*_cells(f"{method}, as shipped", shipped, followed(shipped, MACHINE, method)))
    Console(width=None if sys.stdout.isatty() else 120).print(table)
    return 0


def followed(machine: Machine, drives: str, method: str) -> Followed:
    """Plan the fan contour on a machine and simulate the drives of a machine file, with standstill at both ends."""
    program, toolpath, chunks = find_config("programs", PROGRAM, ".csv"), Toolpath(), []
    planner = StreamPlanner(machine, PlannerParameters(method=method))
    for segment in read_program(open_program(program), program.name, machine.dimensions):
        toolpath.append(segment)
        planner.add_segment(segment)
        while (chunk := planner.next_chunk()) is not None:
            chunks.append(chunk)
    position_mm = interpolate(toolpath, chunks, machine).position_mm
    position_mm = np.concatenate([position_mm, np.repeat(position_mm[-1:], _SETTLING_TICKS, axis=0)])
    period_s = machine.period_s
    velocity_mm_s = np.gradient(position_mm, period_s, axis=0)
    acceleration_mm_s2 = np.gradient(velocity_mm_s, period_s, axis=0)
    router = SimulatedRouter(load_router_parameters(drives))
    router.reset(position_mm[0])
    states = [router.step(*rows) for rows in zip(position_mm, velocity_mm_s, acceleration_mm_s2, strict=True)]
    error_mm = np.max(np.abs([state.tracking_error_mm for state in states]), axis=0)
    control_volts = np.max(np.abs([state.control_signal_volts for state in states]), axis=0)
    saturated = sum(any(state.saturated) for state in states)
    return Followed(planner.committed_t_s, tuple(error_mm.tolist()), tuple(control_volts.tolist()), saturated)


def _cells(method: str, machine: Machine, row: Followed) -> tuple[str, ...]:
    reserve = machine.tracking_error_reserve_mm or (0.0,) * len(row.error_mm)
    return (
        method,
        " / ".join("-" if math.isinf(limit) else f"{limit:.0f}" for limit in machine.jerk_limit_mm_s3),
        " / ".join(f"{1e3 * value:.1f}" for value in reserve),
        f"{row.motion_time_s:.3f}",
        " / ".join(f"{1e3 * value:.1f}" for value in row.error_mm),
        " / ".join(f"{value:.2f}" for value in row.control_volts),
        str(row.saturated_ticks),
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
