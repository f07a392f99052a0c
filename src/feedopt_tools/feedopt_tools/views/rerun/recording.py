"""A run as a Rerun recording that contains its layout."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from feedopt_recorder.bags.run_data import RunData
from feedopt_tools.errors import ViewError
from feedopt_tools.views.pages import MOTION, Page
from feedopt_tools.views.rerun.drawing import draw_run
from feedopt_tools.views.rerun.layout import run_layout
from feedopt_tools.views.signals.scene import RunScene, scene_of

APPLICATION = "feedopt"


def save_recording(run: RunData, path: Path) -> RunScene:
    """Write a run as an ``.rrd`` file that opens with its layout.

    Args:
        run: the recorded run.
        path: the file to write.

    Returns:
        The scene that was drawn.

    Raises:
        ViewError: the run has nothing to draw, or the file cannot be written.
    """
    scene = scene_of(run)
    save_scene(scene, path)
    return scene


def save_scene(scene: RunScene, path: Path, page: Page = MOTION, over: str = "time") -> None:
    """Write a scene as an ``.rrd`` file that opens on a page.

    Raises:
        ViewError: the file cannot be written.
    """
    run = scene.signals.run
    name = f"{run.title} program {run.program_id}"
    write_recording(path, name, run_layout(scene, page, over), lambda recording: draw_run(recording, scene))


def write_recording(path: Path, name: str, layout: rrb.Blueprint, draw: Callable[[rr.RecordingStream], None]) -> None:
    """Write an ``.rrd`` file with its layout.

    Raises:
        ViewError: the file cannot be written.
    """
    recording = rr.RecordingStream(APPLICATION, recording_id=name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        recording.save(path, default_blueprint=layout)
    except (OSError, RuntimeError) as error:
        raise ViewError(f"{path}: cannot be written: {error}") from error
    recording.send_recording_name(name)
    draw(recording)
    recording.flush()
    recording.disconnect()
