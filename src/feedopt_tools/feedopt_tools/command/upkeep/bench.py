"""``feedopt bench``: run a benchmark; each is a module of ``benchmark/``."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import click

from feedopt_core.errors import ConfigError
from feedopt_tools.command.workspace import workspace_root


@click.command(context_settings={"ignore_unknown_options": True, "help_option_names": []})
@click.argument("name")
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def command(name: str, arguments: tuple[str, ...]) -> None:
    """Run the benchmark NAME, such as peers, with its own ARGUMENTS."""
    root = workspace_root()
    folder = root / "benchmark"
    names = benchmark_names(folder)
    if name not in names:
        known = ", ".join(names) or "none in this workspace"
        raise ConfigError(f"benchmark {name!r} is unknown; available: {known}")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])}
    process = subprocess.run(
        [sys.executable, "-m", f"benchmark.{name}", *arguments], cwd=Path.cwd(), env=environment, check=False
    )
    sys.exit(process.returncode)


def benchmark_names(folder: Path) -> tuple[str, ...]:
    """Names of the benchmarks: modules, and packages with a ``__main__``."""
    modules = [entry.stem for entry in folder.glob("[a-z]*.py")]
    packages = [entry.parent.name for entry in folder.glob("[a-z]*/__main__.py")]
    return tuple(sorted(modules + packages))
