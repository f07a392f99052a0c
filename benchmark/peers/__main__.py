"""feedopt compared with TOPP-RA and COPP: same path, same limits, same audit, one run, one core.

Run: ``./feedopt bench peers [--runs N] [--json FILE]``. The first run installs the packages of requirements/bench.txt.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

_THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")


def main(argv: list[str]) -> int:
    """Command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="feedopt bench peers", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--runs", type=int, default=3, help="runs of each planner; the compute time is their median")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every figure here")
    arguments = parser.parse_args(argv)
    if arguments.runs < 1:
        parser.error("--runs must be at least 1")
    # Before the import of numpy, whose BLAS reads these only once. The comparison also limits the process to one core.
    os.environ.update(dict.fromkeys(_THREAD_COUNTS, "1"))
    from benchmark.peer_packages import install_missing
    from benchmark.peers.comparison import PEERS, document_of, run_peers, table_of
    from rich.console import Console

    progress = Console(stderr=True)
    install_missing(*PEERS)
    load = os.getloadavg()[0]
    rows = run_peers(
        arguments.runs, lambda row: progress.print(f"{row.case}: {row.planner}, {row.setting}", highlight=False)
    )
    out = Console(width=None if sys.stdout.isatty() else 170)
    out.print(table_of(rows))
    for row in rows:
        if row.failure:
            out.print(f"{row.case}, {row.planner}, {row.setting}: {row.failure}")
    out.print(f"one core, median of {arguments.runs} runs; load of the machine before the run {load:.2f}")
    if arguments.json:
        arguments.json.write_text(json.dumps(document_of(rows, arguments.runs, load), indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
