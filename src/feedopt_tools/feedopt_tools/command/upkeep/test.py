"""``feedopt test``: all checks that a change must pass."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import time

import click

from feedopt_tools.command.exit_codes import FAILURE
from feedopt_tools.command.extras import EXTRA_OF_MODULE
from feedopt_tools.command.workspace import workspace_root

_PYTEST = (sys.executable, "-m", "pytest", "-q")
STAGES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("style (ruff)", (sys.executable, "-m", "ruff", "check", ".")),
    ("format (ruff)", (sys.executable, "-m", "ruff", "format", "--check", "--quiet", ".")),
    ("types (mypy)", (sys.executable, "-m", "mypy")),
    ("imports (import-linter)", ("lint-imports",)),
    ("unit tests", (*_PYTEST, "-m", "not graph")),
    ("graph tests", (*_PYTEST, "-m", "graph")),
)


@click.command()
def command() -> None:
    """Check style, types and imports, then run the unit tests and the graph tests; stop at the first failure."""
    for module in EXTRA_OF_MODULE:
        if importlib.util.find_spec(module) is None:
            raise ModuleNotFoundError(f"No module named {module!r}", name=module)
    root = workspace_root()
    for title, stage in STAGES:
        click.secho(f"== {title}", bold=True)
        began_s = time.monotonic()
        code = subprocess.run(stage, cwd=root, check=False).returncode
        if code:
            click.secho(f"== {title}: failed after {time.monotonic() - began_s:.0f} s", fg="red", bold=True)
            sys.exit(FAILURE)
    click.secho("== all passed", fg="green", bold=True)
