"""Windows on random smooth paths with random limits and sizes: windows without a plan, and plans of each solver.

Run: ``./feedopt bench windows [--windows N] [--seed S] [--method NAME]``. Every case is a random walk through a C2
spline on a machine with random limits: kinematic ones, those of the drives, or both. Look-ahead and commitment are
random too, from the stopping distance upwards. Exit code 1 if a window had no plan or violated a limit.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from rich.console import Console
from rich.table import Table

from feedopt_core.errors import InfeasibleLimitsError, SolverError
from feedopt_core.geometry.segments import Segment
from feedopt_core.machine.machine_file import DriveModel, Machine, TrackingModel
from feedopt_core.motion.certificate import ALLOWED_RATIO
from feedopt_core.pipeline.warm_up import warm_up_planning
from feedopt_core.planner.methods import make_method
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner
from feedopt_core.smoothing.cubic_spline import interpolate_points

_INFINITE = (float("inf"),) * 2
_MOST_WINDOWS = 40
"""Largest number of windows per case."""


@dataclass(frozen=True)
class Case:
    """One program on one machine with its windows."""

    machine: Machine
    segments: Sequence[Segment]
    parameters: PlannerParameters


@dataclass
class Tally:
    """Totals over the windows of all cases."""

    windows: int = 0
    iterations: int = 0
    solvers: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)
    worst_ratio: float = 0.0
    worst_share: float = 0.0
    slowest_s: float = 0.0


def random_case(seed: int, index: int, method: str) -> Case:
    """Case number ``index`` of a seed; equal numbers give the same case."""
    rng = np.random.default_rng([seed, index])
    machine = _random_machine(rng)
    stopping_mm = make_method(method, machine, 0.25).stopping_mm
    look_ahead_mm = max(stopping_mm, 1.0) * float(rng.uniform(1.0, 2.0))
    commitment_mm = max(stopping_mm, 1.0) * float(rng.uniform(0.3, 4.0))
    count = int(rng.integers(4, 25))
    heading = np.cumsum(rng.uniform(-1.0, 1.0, count) * rng.uniform(0.1, 1.0))
    chords = rng.uniform(3.0, 15.0, count) * _log_uniform(rng, 0.3, 3.0)
    steps = chords[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    segments = list(interpolate_points(points, list(range(1, count + 2))))
    return Case(machine, segments, PlannerParameters(method, _log_uniform(rng, 0.2, 1.0), look_ahead_mm, commitment_mm))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _pair(rng: np.random.Generator, low: float, high: float) -> tuple[float, float]:
    return _log_uniform(rng, low, high), _log_uniform(rng, low, high)


def _random_machine(rng: np.random.Generator) -> Machine:
    """Two axes; drives within a factor of about two of the thesis' router."""
    machine = Machine(
        name="random",
        yaml_text="",
        axis_names=("X", "Y"),
        axis_map=((1.0, 0.0), (0.0, 1.0)) if rng.uniform() < 0.8 else ((1.0, 1.0), (1.0, -1.0)),
        feed_limit_mm_s=_log_uniform(rng, 10.0, 400.0),
        velocity_limit_mm_s=_pair(rng, 30.0, 300.0),
        acceleration_limit_mm_s2=_pair(rng, 100.0, 5000.0),
        jerk_limit_mm_s3=_pair(rng, 3e3, 2e5),
    )
    kind = rng.integers(4)
    if kind & 1:
        friction = _pair(rng, 0.05, 0.6)
        drive = DriveModel(
            _pair(rng, 8e-4, 4e-3), _pair(rng, 0.02, 0.09), (float(rng.uniform(-0.3, 0.3)), 0.0), friction
        )
        machine = replace(machine, drive=drive, control_limit_volts=_pair(rng, 3.0, 10.0))
    if kind & 2:
        tracking = TrackingModel(_pair(rng, 2e-5, 2e-4), _pair(rng, 1e-6, 4e-5), _pair(rng, 1e-8, 1e-7))
        machine = replace(machine, tracking=tracking, tracking_error_limit_mm=_pair(rng, 0.01, 0.05))
        # The tracking error limits acceleration and jerk, so their own limits can be absent.
        if rng.uniform() < 0.7:
            machine = replace(machine, acceleration_limit_mm_s2=_INFINITE, jerk_limit_mm_s3=_INFINITE)
        if kind & 1 and rng.uniform() < 0.5:
            machine = replace(machine, velocity_limit_mm_s=_INFINITE)
    return machine


def run_case(case: Case, tally: Tally, name: str) -> None:
    """Plan one case window by window and add it to the totals."""
    warm_up_planning()
    planner = StreamPlanner(case.machine, case.parameters)
    for segment in case.segments:
        planner.add_segment(segment)
        while True:
            began = time.process_time()
            try:
                chunk = planner.next_chunk()
            except (SolverError, InfeasibleLimitsError) as error:
                tally.windows += 1
                tally.failures.append(f"{name}: {error}")
                return
            if chunk is None or chunk.sequence > _MOST_WINDOWS:
                break
            took_s = time.process_time() - began
            tally.windows += 1
            tally.iterations += chunk.figures.iterations
            tally.solvers[chunk.figures.solver] += 1
            tally.slowest_s = max(tally.slowest_s, took_s)
            tally.worst_share = max(tally.worst_share, took_s / (chunk.t_commit_s - chunk.t_start_s))
            tally.worst_ratio = max(tally.worst_ratio, chunk.certificate.worst_ratio)
            if chunk.figures.fallback:
                tally.failures.append(f"{name}: no plan from s = {chunk.s_start_mm:.3f} mm, stopped instead")
            planner.discard_before(chunk.s_start_mm)


def main(argv: list[str]) -> int:
    """Command line; returns the exit code: 0 if every window has a plan without violation, else 1."""
    parser = argparse.ArgumentParser(prog="feedopt bench windows", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--windows", type=int, default=10_000, help="smallest number of windows to plan")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random cases")
    parser.add_argument("--method", default="lp_nlp", help="planning method")
    arguments = parser.parse_args(argv)
    tally, index = Tally(), 0
    console = Console()
    while tally.windows < arguments.windows:
        run_case(random_case(arguments.seed, index, arguments.method), tally, f"case {index}")
        index += 1
    table = Table(title=f"{tally.windows} windows of {index} random cases, method {arguments.method}")
    table.add_column("figure")
    table.add_column("value", justify="right")
    for solver, count in sorted(tally.solvers.items()):
        table.add_row(f"windows planned by {solver}", str(count))
    table.add_row("windows without a plan", str(len(tally.failures)))
    table.add_row("iterations a window", f"{tally.iterations / tally.windows:.1f}")
    table.add_row("worst ratio to a limit", f"{tally.worst_ratio:.6f}")
    table.add_row("slowest window, s", f"{tally.slowest_s:.3f}")
    table.add_row("largest planning time / committed motion time", f"{tally.worst_share:.3f}")
    console.print(table)
    for failure in tally.failures[:20]:
        console.print(failure, soft_wrap=True)
    return 0 if not tally.failures and tally.worst_ratio <= ALLOWED_RATIO else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
