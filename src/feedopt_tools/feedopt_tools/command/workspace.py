"""Folder of the workspace."""

from __future__ import annotations

import os
from pathlib import Path


def workspace_root() -> Path:
    """Root folder of the workspace of ``./feedopt``; else of the source tree; else the current folder."""
    given = os.environ.get("FEEDOPT_ROOT")
    if given:
        return Path(given)
    for parent in Path(__file__).resolve().parents:
        if (parent / "src" / "feedopt_tools").is_dir():
            return parent
    return Path.cwd()
