"""feedopt beside TOPP-RA and COPP: same path, same limits, same audit, one run, one core.

Run: ``./feedopt bench peers [--runs N] [--json FILE]``. The first run installs what requirements/bench.txt pins.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import shutil
import subprocess
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
    # Before numpy is loaded, whose BLAS reads these once; the comparison also keeps the process on one core.
    os.environ.update(dict.fromkeys(_THREAD_COUNTS, "1"))
    from benchmark.peers.comparison import document_of, missing_peers, run_peers, table_of
    from rich.console import Console

    progress = Console(stderr=True)
    if missing := missing_peers():
        progress.print(f"installing {', '.join(missing)} ...", highlight=False)
        _install_peers()
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


def _install_peers() -> None:
    """Install the pinned peers beside feedopt; they are no part of its own set-up. Raises CalledProcessError."""
    requirements = Path(__file__).resolve().parents[2] / "requirements" / "bench.txt"
    installer = [sys.executable, "-m", "pip", "install", "--quiet"]
    if uv := shutil.which("uv"):
        installer = [uv, "pip", "install", "--quiet", "--python", sys.executable]
    subprocess.run([*installer, "-r", str(requirements)], check=True)
    importlib.invalidate_caches()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
