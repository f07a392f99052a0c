"""Remakes golden bags, with a summary of the changes."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from feedopt_core.errors import FeedoptError
from feedopt_recorder.bags.messages import bag_files
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.bags.run_data import RunData
from feedopt_tools.errors import GoldenBagError
from feedopt_tools.execute.client import ProgramRequest
from feedopt_tools.execute.execution import RunOptions
from feedopt_tools.replay.comparison import Tolerances
from feedopt_tools.replay.golden import golden_entry, load_manifest, replace_bag
from feedopt_tools.replay.live import execute_whole
from feedopt_tools.replay.replay import replay_bag, short_text


def remake(path: Path, stage: Callable[[str], None]) -> Iterator[str]:
    """Record a golden bag again and replace it; yields lines for the commit message.

    Raises:
        GoldenBagError: no entry, too large, or its replay differs from the new recording. The old bag stays then.
        FeedoptError: the program could not be executed.
    """
    entry = golden_entry(path)
    if entry is None:
        raise GoldenBagError(f"{path}: has no entry in the manifest of its folder")
    tolerances = Tolerances(load_manifest(path.parent)[path.name].tolerances)
    before = _described(path)
    changes = _changes(path, tolerances)
    with tempfile.TemporaryDirectory(prefix="feedopt-golden-") as folder:
        program = (path.parent / entry.program).resolve()
        request = ProgramRequest(program.name, path=program)
        options = RunOptions(request, entry.machine, Path(folder) / "run", entry.method)
        made = execute_whole(options, stage)
        replay = replay_bag(made, tolerances)
        if not replay.agrees:
            found = "\n".join(short_text(replay))
            raise GoldenBagError(f"{path}: the new recording differs from its own replay:\n{found}")
        replace_bag(path, made)
    yield f"bags/{path.name}: was {before}, is {_described(path)}"
    yield from changes


def _described(path: Path) -> str:
    if not path.exists():
        return "not there"
    try:
        run = read_bag(path)
    except FeedoptError as error:
        return f"not readable ({_first_line(error)})"
    size = sum(file.stat().st_size for file in bag_files(path))
    return f"{run.motion_time_s:.3f} s, {len(run.chunks)} chunks by {_method(run)}, {size / 1e6:.2f} MB"


def _method(run: RunData) -> str:
    return run.chunks[0].figures.method if run.chunks else "no planner"


def _changes(path: Path, tolerances: Tolerances) -> list[str]:
    """Differences of the old bag's replay: the reason for remaking it."""
    if not path.exists():
        return []
    try:
        return [f"  {line}" for line in list(short_text(replay_bag(path, tolerances)))[1:]]
    except FeedoptError as error:
        return [f"  the old bag cannot be replayed: {_first_line(error)}"]


def _first_line(error: FeedoptError) -> str:
    return f"{type(error).__name__}: {str(error).splitlines()[0]}"
