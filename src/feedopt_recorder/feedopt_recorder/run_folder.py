"""Names in the folder of a run: the recorder writes them, whoever looks at the run finds them."""

from __future__ import annotations

from pathlib import Path

BAG_NAME = "recording"
"""Folder of the bag."""
SUMMARY_NAME = "recorder_summary.json"
"""What the recorder counted and missed; in the folder of the bag."""


def bag_of(path: Path) -> Path:
    """The bag of a run; ``path`` itself where it is not the folder of a run."""
    return path / BAG_NAME if (path / BAG_NAME).is_dir() else path
