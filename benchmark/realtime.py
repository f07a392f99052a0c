"""A minute of motion at 1 kHz through the whole graph: ticks, lateness, tracking, recorder.

Run: ``./feedopt bench realtime [--laps N] [--machine NAME]``. The program is the fan contour, lap after lap without a
stop. It runs in real time on the simulated router; all figures come from its recording.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from feedopt_core.config_files import find_config
from feedopt_core.programs.points_csv import read_points
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_tools.execute.client import ProgramRequest
from feedopt_tools.execute.execution import Execution, RunEvents, RunOptions, execute_program
from feedopt_tools.execute.judgement import judge_run


def main(argv: list[str]) -> int:
    """Command line; returns the exit code: 0 if every tick was recorded and every limit kept, else 1."""
    parser = argparse.ArgumentParser(prog="feedopt bench realtime", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--laps", type=int, default=12, help="laps of the fan contour, about 5.3 s each")
    parser.add_argument("--machine", default="router_simulation", help="machine file or its name")
    arguments = parser.parse_args(argv)
    if arguments.laps < 1:
        parser.error("--laps must be at least 1")
    progress = Console(stderr=True)
    load, stolen_s = os.getloadavg()[0], _stolen_s()
    with tempfile.TemporaryDirectory(prefix="feedopt-realtime-") as folder:
        program = Path(folder) / "laps.csv"
        program.write_text(laps_program(arguments.laps), encoding="utf-8")
        options = RunOptions(ProgramRequest(program.name, path=program), arguments.machine, Path(folder) / "run")
        execution = execute_program(options, RunEvents(stage=progress.print, progress=lambda _: None))
        if execution.failure is not None:
            raise execution.failure
        stolen_s = _stolen_s() - stolen_s
        judgement = judge_run(read_bag(execution.bag))
    punctuality = judgement.punctuality
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_row("result", _result(execution))
    table.add_row("motion time", f"{judgement.motion_time_s:.3f} s")
    table.add_row("set points", f"{punctuality.ticks}, missing {punctuality.missing_ticks}")
    table.add_row("lateness", f"p50 {1e6 * punctuality.p50_s:.0f} us, p99 {1e6 * punctuality.p99_s:.0f} us")
    table.add_row("late by a period or more", str(punctuality.late_ticks))
    starved = execution.starved_chunk_sequence
    table.add_row("stopped because a chunk was late", f"last after chunk {starved}" if starved else "never")
    table.add_row("worst ratio to a limit", f"{judgement.audit.worst.ratio:.4f} ({judgement.audit.worst.quantity})")
    table.add_row("recorder", f"{100.0 * judgement.recorder_cpu_ratio:.1f} % of a core")
    table.add_row("load before the run", f"{load:.2f}")
    table.add_row("used by other virtual machines", f"{stolen_s:.1f} s of processor time")
    Console().print(table)
    return 0 if judgement.holds and execution.succeeded else 1


def _result(execution: Execution) -> str:
    """Text for the end of the program and of the nodes."""
    outcome = execution.outcome
    ended = "no answer" if outcome is None else "executed to its end" if outcome.succeeded else str(outcome.failure)
    failed = [f"{name} ended with {code}" for name, code in execution.exit_codes.items() if code]
    return "; ".join([ended, *failed, *execution.remarks])


def _stolen_s() -> float:
    """Processor time that the host gave to other virtual machines since the start of the system, all cores, s."""
    first = Path("/proc/stat").read_text(encoding="ascii").partition("\n")[0]
    return int(first.split()[8]) / os.sysconf("SC_CLK_TCK")


def laps_program(laps: int) -> str:
    """Points of the fan contour, ``laps`` times without a stop in between."""
    contour = find_config("programs", "fan_contour", ".csv")
    points = read_points(contour.read_text(encoding="utf-8").splitlines(), contour.name).points_mm
    every = np.concatenate([np.tile(points[:-1], (laps, 1)), points[-1:]])
    return "".join(f"{x:.4f},{y:.4f}\n" for x, y in every)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
