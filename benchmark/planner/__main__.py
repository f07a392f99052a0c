"""The planner: every method against the mesh-converged optimum, windows, speed and scale, each figure with its audit.

Run: ``./feedopt bench planner [SECTION ...] [--runs N] [--json FILE]``. Sections: kinematic, drives, windows, speed,
scale; default: all. For other planners see ``./feedopt bench peers``. One process, one core.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

_THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def main(argv: list[str]) -> int:
    """Command line; returns the exit code."""
    os.environ.update(dict.fromkeys(_THREAD_COUNTS, "1"))
    from benchmark.planner.cases import SECTIONS, Failed
    from rich.console import Console

    parser = argparse.ArgumentParser(prog="feedopt bench planner", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"of {', '.join(SECTIONS)}; without one, all")
    parser.add_argument("--runs", type=int, default=3, help="runs of each plan; the compute time is their median")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every figure here")
    arguments = parser.parse_args(argv)
    unknown = [name for name in arguments.sections if name not in SECTIONS]
    if unknown or arguments.runs < 1:
        parser.error(f"unknown section {unknown[0]}" if unknown else "--runs must be at least 1")
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    load, out = os.getloadavg()[0], Console(width=None if sys.stdout.isatty() else 230)
    document: dict[str, Any] = {"runs": arguments.runs, "load_before": load}
    for name in arguments.sections or SECTIONS:
        rows = list(SECTIONS[name](arguments.runs))
        out.print(_table(name, rows))
        for row in rows:
            if isinstance(row, Failed):
                out.print(f"{row.case}, {row.method}: {row.cause}", highlight=False)
        document[name] = [asdict(row) for row in rows]
    out.print(f"one core, CPU time, median of {arguments.runs} runs; load of the machine before the run {load:.2f}")
    if arguments.json:
        arguments.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return 0


def _table(name: str, rows: list[Any]) -> Any:
    from benchmark.planner.cases import Failed, Scaled
    from rich.table import Table

    table = Table(title=name)
    scaled = any(isinstance(row, Scaled) for row in rows)
    for heading in _SCALE_HEADINGS if scaled else _HEADINGS:
        table.add_column(heading, justify="left" if heading in _TEXT else "right", no_wrap=heading in _TEXT)
    previous = ""
    for row in rows:
        if isinstance(row, Scaled):
            table.add_row(*_scale_cells(row))
            continue
        if previous and row.case != previous:
            table.add_section()
        case, previous = "" if row.case == previous else row.case, row.case
        cells = ["failed"] if isinstance(row, Failed) else _cells(row)
        table.add_row(case, row.method, row.setting, *cells)
    return table


_TEXT = ("case", "method", "setting", "closest", "solvers")
_HEADINGS = (
    "case",
    "method",
    "setting",
    "motion s",
    "compute s",
    "motion/compute",
    "first chunk s",
    "worst window",
    "windows",
    "fallbacks",
    "points",
    "1 kHz",
    "fine",
    "check",
    "closest",
    "solvers",
)
_SCALE_HEADINGS = ("m", "motion s", "compute s", "motion/compute", "resident MB", "worst window", "fallbacks")


def _cells(row: Any) -> list[str]:
    return [
        f"{row.motion_s:.4f}",
        f"{row.compute_s:.3f}",
        f"{row.motion_s / row.compute_s:.1f}",
        f"{row.first_chunk_s:.3f}",
        f"{row.window_share:.3f}",
        str(row.windows),
        str(row.fallbacks),
        str(row.control_points),
        f"{row.ratio_1khz:.4f}",
        f"{row.ratio_fine:.4f}",
        f"{row.ratio_check:.4f}",
        row.binding,
        ", ".join(f"{name} {count}" for name, count in row.solvers.items()),
    ]


def _scale_cells(row: Any) -> list[str]:
    return [
        f"{row.length_m:g}",
        f"{row.motion_s:.1f}",
        f"{row.compute_s:.2f}",
        f"{row.motion_s / row.compute_s:.1f}",
        f"{row.resident_mb:.1f}",
        f"{row.window_share:.3f}",
        str(row.fallbacks),
    ]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
