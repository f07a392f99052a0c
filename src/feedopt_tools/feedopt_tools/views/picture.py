"""A picture of a run: drawn by Rerun where it can draw, else by matplotlib with the same content."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from feedopt_tools.bags.run_data import RunData
from feedopt_tools.views.errors import ViewError
from feedopt_tools.views.matplotlib_picture import draw_by_matplotlib
from feedopt_tools.views.recording import save_recording
from feedopt_tools.views.rerun_picture import ViewFailure, draw_by_rerun
from feedopt_tools.views.signals import signals_of

# Where the time cursor stands: far enough for the tool to be seen on its way.
_CURSOR_RATIO = 0.42


@dataclass(frozen=True)
class Picture:
    """A picture that was drawn.

    Attributes:
        path: the PNG.
        drawn_by: ``rerun`` or ``matplotlib``.
        reason: why Rerun did not draw it; empty if it did.
        failures: views that Rerun could not show.
    """

    path: Path
    drawn_by: str
    reason: str
    failures: tuple[ViewFailure, ...]


def draw_picture(run: RunData, picture: Path, *, by: str = "any") -> Picture:
    """Draw a run.

    Args:
        run: what was recorded.
        picture: the PNG to write.
        by: ``rerun``, ``matplotlib``, or ``any``: Rerun first, matplotlib where it cannot.

    Raises:
        ViewError: there is nothing to draw, the picture cannot be written, or Rerun was demanded and cannot draw.
    """
    reason = ""
    try:
        if by != "matplotlib":
            try:
                with tempfile.TemporaryDirectory() as folder:
                    recording = Path(folder) / "run.rrd"
                    save_recording(run, recording)
                    failures = draw_by_rerun(recording, picture, at_s=round(_CURSOR_RATIO * run.motion_time_s, 2))
                return Picture(picture, "rerun", "", failures)
            except ViewError as error:
                if by == "rerun":
                    raise
                reason = str(error)
        draw_by_matplotlib(signals_of(run), picture)
    except OSError as error:
        raise ViewError(f"{picture}: cannot be written: {error.strerror}") from error
    return Picture(picture, "matplotlib", reason, ())
