"""Opens a run in the Rerun viewer."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from feedopt_tools.bags.read_bag import read_bag
from feedopt_tools.views.errors import ViewError
from feedopt_tools.views.recording import save_recording


@dataclass(frozen=True)
class OpenedView:
    """What was done to look at a run.

    Attributes:
        recording: the ``.rrd`` file.
        viewer_pid: process of the viewer; None where there is no display.
        hint: how to look at it where there is no display; else empty.
    """

    recording: Path
    viewer_pid: int | None
    hint: str


def open_viewer(bag_or_recording: Path, recording: Path | None = None, program_id: int | None = None) -> OpenedView:
    """Show a bag, or an ``.rrd`` file made from one, in a viewer that outlives this process.

    Args:
        bag_or_recording: a bag, or a file ending in ``.rrd``.
        recording: where to put the recording made of a bag; None: ``run.rrd`` inside the bag's folder.
        program_id: which program of the bag; None: the last one.

    Raises:
        BagError: the bag cannot be read.
        ViewError: there is nothing to show, or the recording cannot be written.
    """
    if bag_or_recording.suffix == ".rrd":
        if not bag_or_recording.is_file():
            raise ViewError(f"{bag_or_recording}: no such recording")
        shown = bag_or_recording
    else:
        folder = bag_or_recording if bag_or_recording.is_dir() else bag_or_recording.parent
        shown = recording or folder / "run.rrd"
        save_recording(read_bag(bag_or_recording, program_id), shown)
    if not has_display():
        return OpenedView(shown, None, _hint(shown))
    command = [sys.executable, "-m", "rerun", str(shown)]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    return OpenedView(shown, process.pid, "")


def has_display() -> bool:
    """Whether a window can be opened here."""
    return sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _hint(recording: Path) -> str:
    return (
        f"no display here. Copy {recording} to a machine with one and open it with: rerun {recording.name}; "
        f"or serve it to a browser from here: rerun --serve-web {recording}"
    )
