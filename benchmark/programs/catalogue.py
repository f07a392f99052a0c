"""Every program of the benchmarks, and its machine."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from benchmark.programs.own import OWN_PROGRAMS

from feedopt_core.pipeline.read_program import SUFFIXES

MACHINES = {2: "case_a", 3: "router_heng"}
"""Machine for each number of coordinates."""
_WORKSPACE = Path(__file__).resolve().parents[2]


def all_programs(folder: Path) -> Iterator[tuple[str, Path]]:
    """Our own programs, written into a folder, and the available real ones."""
    for name, (_, text) in OWN_PROGRAMS.items():
        path = folder / f"{name}.ngc"
        path.write_text(text(), encoding="utf-8")
        yield name, path
    real = Path(os.environ.get("FEEDOPT_PROGRAMS", _WORKSPACE.parent / "shared" / "data" / "programs"))
    yield from ((path.name, path) for path in sorted(real.glob("*")) if path.suffix.lower() in SUFFIXES)
