"""Pictures of a run: drawn by Rerun if it works on this computer, otherwise by matplotlib with the same content."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from feedopt_recorder.bags.run_data import RunData
from feedopt_tools.errors import ViewError
from feedopt_tools.views.matplotlib.comparison import draw_comparison_by_matplotlib
from feedopt_tools.views.matplotlib.picture import draw_by_matplotlib
from feedopt_tools.views.matplotlib.survey import draw_survey_by_matplotlib
from feedopt_tools.views.pages import MOTION, Page, pages_of
from feedopt_tools.views.rerun.comparison_recording import save_comparison
from feedopt_tools.views.rerun.picture import Cursor, ViewFailure, draw_by_rerun
from feedopt_tools.views.rerun.recording import save_scene
from feedopt_tools.views.rerun.survey_recording import OVER, save_survey
from feedopt_tools.views.signals.comparison import Comparison
from feedopt_tools.views.signals.scene import RunScene, scene_of
from feedopt_tools.views.signals.survey_scene import SurveyScene

DRAWERS = ("any", "rerun", "matplotlib")
# Position of the time cursor: the tool is then visible on its path.
_CURSOR_RATIO = 0.42


@dataclass(frozen=True)
class Picture:
    """A drawn picture.

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
    """Draw the motion page of a run: see :func:`draw_page`. Raises ViewError."""
    return draw_page(scene_of(run), picture, by=by)


def draw_page(
    scene: RunScene, picture: Path, page: Page = MOTION, over: str | None = None, *, by: str = "any"
) -> Picture:
    """Draw one page of a run.

    Args:
        scene: the run.
        picture: the PNG to write.
        page: the page to draw.
        over: horizontal axis, ``time`` or ``arc-length``; None: that of the page.
        by: ``rerun``, ``matplotlib``, or ``any``: Rerun, or matplotlib if Rerun cannot draw.

    Raises:
        ViewError: the page is empty, the file cannot be written, or Rerun cannot draw although ``by`` requires it.
    """
    there = pages_of(scene)
    if page not in there:
        raise ViewError(
            f"{scene.signals.run.path}: has no data for the page {page.key}; "
            f"available: {', '.join(one.key for one in there)}"
        )
    line = over or page.over
    return _draw(
        picture,
        by,
        _cursor(scene, line),
        lambda recording: save_scene(scene, recording, page, line),
        lambda: draw_by_matplotlib(scene, picture, page),
    )


def draw_pages(scene: RunScene, folder: Path, *, by: str = "any") -> tuple[Picture, ...]:
    """Draw every page of a run into a folder, as ``<page>.png``. Raises ViewError."""
    pictures = list[Picture]()
    for page in pages_of(scene):
        # If Rerun cannot draw one page, matplotlib draws the others.
        drawer = "matplotlib" if pictures and pictures[-1].drawn_by == "matplotlib" else by
        pictures.append(draw_page(scene, folder / f"{page.key}.png", page, by=drawer))
    return tuple(pictures)


def draw_comparison_picture(
    comparison: Comparison, picture: Path, over: str = "arc-length", *, by: str = "any"
) -> Picture:
    """Draw the comparison of two runs. Raises ViewError."""
    return _draw(
        picture,
        by,
        _cursor(comparison.first, over),
        lambda recording: save_comparison(comparison, recording, over),
        lambda: draw_comparison_by_matplotlib(comparison, picture, over),
    )


def draw_survey_picture(scene: SurveyScene, picture: Path, *, by: str = "any") -> Picture:
    """Draw a program with its smoothed path. Raises ViewError."""
    return _draw(
        picture,
        by,
        Cursor(OVER, 0.0, _CURSOR_RATIO * float(scene.s_mm[-1])),
        lambda recording: save_survey(scene, recording),
        lambda: draw_survey_by_matplotlib(scene, picture),
    )


def _cursor(scene: RunScene, over: str) -> Cursor:
    signals = scene.signals
    t_s = round(_CURSOR_RATIO * signals.run.motion_time_s, 2)
    return Cursor(over, t_s, _CURSOR_RATIO * float(signals.s_mm[-1]))


def _draw(
    picture: Path, by: str, cursor: Cursor, record: Callable[[Path], None], draw_otherwise: Callable[[], None]
) -> Picture:
    reason = ""
    try:
        if by != "matplotlib":
            try:
                with tempfile.TemporaryDirectory() as folder:
                    recording = Path(folder) / "run.rrd"
                    record(recording)
                    failures = draw_by_rerun(recording, picture, cursor)
                return Picture(picture, "rerun", "", failures)
            except ViewError as error:
                if by == "rerun":
                    raise
                reason = str(error)
        draw_otherwise()
    except OSError as error:
        raise ViewError(f"{picture}: cannot be written: {error.strerror}") from error
    return Picture(picture, "matplotlib", reason, ())
