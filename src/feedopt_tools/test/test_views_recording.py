"""The Rerun recording of a run and the pictures drawn from it."""

from __future__ import annotations

import itertools
import socket
import subprocess
import sys
import time
import urllib.request
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from recorded_run import motion, write_run

from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.bags.run_data import RunData
from feedopt_tools.errors import ViewError
from feedopt_tools.views.colours import feed_colours
from feedopt_tools.views.matplotlib.picture import draw_by_matplotlib
from feedopt_tools.views.picture import draw_picture
from feedopt_tools.views.rerun import picture as rerun_picture
from feedopt_tools.views.rerun import viewer
from feedopt_tools.views.rerun.recording import save_recording
from feedopt_tools.views.signals.scene import scene_of
from feedopt_tools.views.signals.signals import jerk_of, signals_of, speed_pieces
from feedopt_tools.views.signals.summary import summary_markdown

DURATION_S = 2.0


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("views")
    return write_run(folder / "run", folder / "share", duration_s=DURATION_S)


@pytest.fixture(scope="module")
def run(bag: Path) -> RunData:
    return read_bag(bag)


def pixels(path: Path) -> np.ndarray:
    return np.round(255 * matplotlib.image.imread(path)[:, :, :3]).astype(int)


def colour_count(image: np.ndarray, colour: tuple[int, int, int], tolerance: int = 24) -> int:
    return int(np.sum(np.max(np.abs(image - np.array(colour)), axis=2) <= tolerance))


def assert_drawn(path: Path) -> None:
    """Not blank: the slow, the middle and the fast colour of the path are there, in many shades, in the left half."""
    image = pixels(path)
    assert image.shape == (900, 1600, 3)
    left = image[:, :640]
    for colour in feed_colours(np.array([0.35, 0.6, 0.95]), 1.0):
        assert colour_count(left, tuple(int(part) for part in colour)) > 20
    saturation = np.max(left, axis=2) - np.min(left, axis=2)
    assert len(np.unique(left[saturation > 80], axis=0)) > 40
    right = image[:, 660:]
    saturation = np.max(right, axis=2) - np.min(right, axis=2)
    assert np.sum(saturation > 60) > 2000


def test_recording_is_valid_and_holds_every_curve(run: RunData, tmp_path: Path) -> None:
    path = tmp_path / "deep" / "run.rrd"
    save_recording(run, path)
    verified = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(path)], capture_output=True, check=False
    )
    assert verified.returncode == 0, verified.stderr
    printed = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "print", "-vv", str(path)], capture_output=True, text=True, check=False
    ).stdout
    entities = [
        "paths/feed",
        "paths/limit",
        "contour/actual",
        "active/limit",
        "use/X/jerk",
        "events",
        "tool",
        "feed/feedrate",
        "feed/limit",
        "interpolator/lateness",
        "planner/solve",
        "summary",
    ]
    entities += [f"{key}/{axis}/commanded" for key in ("velocity", "acceleration", "jerk") for axis in "XY"]
    for key in ("control_signal", "tracking_error"):
        entities += [f"{key}/{axis}/{kind}" for axis in "XY" for kind in ("actual", "predicted", "limit")]
    missing = [entity for entity in entities if f"/{entity}" not in printed]
    assert missing == []
    assert "motion_time" in printed


def test_predictions_are_those_of_the_drive_model(run: RunData) -> None:
    signals = signals_of(run)
    expected = motion(DURATION_S)
    error = signals.quantities["tracking_error"]
    assert error.commanded is not None
    assert error.measured is not None
    v, a = expected.velocity_mm_s, expected.acceleration_mm_s2
    j = np.concatenate([np.zeros((1, 2)), np.diff(a, axis=0) / 1e-3])
    model_um = 1e3 * (v * [4.49e-5, 8.07e-5] + a * [1.99e-5, 1.52e-6] + j * [5.2e-8, 1.8e-8])
    np.testing.assert_allclose(error.commanded, model_um, rtol=1e-9, atol=1e-9)
    # The made-up state is the model with noise of 0.2 um.
    assert np.std(error.measured - error.commanded) < 0.4
    assert error.limit == (20.0, 20.0)
    control = signals.quantities["control_signal"]
    np.testing.assert_allclose(control.commanded, expected.control_volts, rtol=1e-9, atol=1e-9)


def test_jerk_is_the_mean_over_the_ticks_in_between(run: RunData) -> None:
    setpoints = run.setpoints
    rows = 900 + np.array([0, 1, 2, 5, 6])
    thinned = setpoints.rows(rows)
    a = setpoints.acceleration_mm_s2[900:]
    expected = [[0, 0], (a[1] - a[0]) / 1e-3, (a[2] - a[1]) / 1e-3, (a[5] - a[2]) / 3e-3, (a[6] - a[5]) / 1e-3]
    np.testing.assert_allclose(jerk_of(thinned), expected)


def test_pieces_of_the_path_touch_and_cover_it() -> None:
    s_mm = np.concatenate([np.zeros(40), np.linspace(0, 10, 500) ** 2, np.full(30, 100.0)])
    pieces = speed_pieces(s_mm, 64)
    assert pieces[0][0] == 0
    assert pieces[-1][1] == len(s_mm) - 1
    assert all(before[1] == after[0] for before, after in itertools.pairwise(pieces))
    assert max(s_mm[last] - s_mm[first] for first, last in pieces) < 2 * 100 / 64


def test_summary_says_what_matters(run: RunData) -> None:
    text = summary_markdown(scene_of(run))
    assert "| motion time | 2.0" in text
    assert "| recording | complete |" in text
    assert "97.00 % of acceleration of X" in text
    assert "of 20 µm" in text


def test_summary_tells_what_the_recorder_took(run: RunData) -> None:
    record = {"summary": '{"cpu_share_ratio": 0.043}'}
    told = replace(run, provenance={**run.provenance, "feedopt/recorder": record})
    assert "| recorder | 4.3 % of a core |" in summary_markdown(scene_of(told))
    for broken in ("", "[]", '{"cpu_share_ratio": null}'):
        untold = replace(run, provenance={**run.provenance, "feedopt/recorder": {"summary": broken}})
        assert "| recorder |" not in summary_markdown(scene_of(untold))


def test_matplotlib_picture_is_not_blank(run: RunData, tmp_path: Path) -> None:
    picture = draw_picture(run, tmp_path / "run.png", by="matplotlib")
    assert (picture.drawn_by, picture.failures) == ("matplotlib", ())
    assert_drawn(picture.path)


def test_blank_picture_is_told_from_a_drawn_one(tmp_path: Path) -> None:
    matplotlib.image.imsave(tmp_path / "blank.png", np.full((900, 1600, 3), 0.08))
    with pytest.raises(AssertionError):
        assert_drawn(tmp_path / "blank.png")


def test_rerun_picture_has_no_failed_view(run: RunData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [rerun_picture._free_port()]
    monkeypatch.setattr(rerun_picture, "_free_port", lambda: ports[0])
    try:
        picture = draw_picture(run, tmp_path / "run.png", by="rerun")
    except ViewError as error:
        pytest.skip(str(error))
    assert picture.drawn_by == "rerun"
    assert picture.failures == ()
    assert_drawn(picture.path)
    # The viewer is gone: nobody listens any more.
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", ports[0]))


def test_matplotlib_takes_over_where_rerun_cannot_draw(
    run: RunData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # No driver at all: neither Vulkan nor OpenGL finds a file to load.
    for name in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES", "__EGL_VENDOR_LIBRARY_FILENAMES"):
        monkeypatch.setenv(name, str(tmp_path / "none.json"))
    monkeypatch.setenv("LIBGL_DRIVERS_PATH", str(tmp_path))
    with pytest.raises(ViewError, match=r"cannot draw on this computer.*mesa-vulkan-drivers"):
        draw_picture(run, tmp_path / "run.png", by="rerun")
    picture = draw_picture(run, tmp_path / "run.png")
    assert picture.drawn_by == "matplotlib"
    assert "mesa-vulkan-drivers" in picture.reason
    assert_drawn(picture.path)


def test_run_without_machine_states_and_plan_is_still_drawn(run: RunData, tmp_path: Path) -> None:
    bare = replace(
        run,
        machine=None,
        states=run.states.of_program(99),
        chunks=(),
        segments=(),
        provenance={},
        path=tmp_path / "bare",
    )
    assert bare.axis_names == ("axis 0", "axis 1")
    save_recording(bare, tmp_path / "bare.rrd")
    draw_by_matplotlib(scene_of(bare), tmp_path / "bare.png")
    assert_drawn(tmp_path / "bare.png")


def test_nothing_to_draw_is_an_error(run: RunData, tmp_path: Path) -> None:
    empty = replace(run, setpoints=run.setpoints.of_program(99))
    with pytest.raises(ViewError, match="nothing to draw"):
        save_recording(empty, tmp_path / "run.rrd")
    with pytest.raises(ViewError, match="nothing to draw"):
        draw_picture(empty, tmp_path / "run.png")


def test_folder_that_cannot_be_written_is_an_error(run: RunData, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ViewError, match="cannot be written"):
        save_recording(run, tmp_path / "file" / "run.rrd")
    with pytest.raises(ViewError, match="cannot be written"):
        draw_picture(run, tmp_path / "file" / "run.png", by="matplotlib")


def test_without_display_the_viewer_says_how_to_look(
    run: RunData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewer.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    save_recording(run, tmp_path / "run.rrd")
    opened = viewer.open_viewer(tmp_path / "run.rrd")
    assert opened.viewer_pid is None
    assert opened.recording.stat().st_size > 100_000
    assert "--web" in opened.hint
    with pytest.raises(ViewError, match="this recording does not exist"):
        viewer.open_viewer(tmp_path / "other.rrd")


def test_recording_is_served_to_browsers_of_this_machine(
    run: RunData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewer, "has_display", lambda: False)
    save_recording(run, tmp_path / "run.rrd")
    served = viewer.serve_web(tmp_path / "run.rrd")
    try:
        page = fetched(served.url.partition("?")[0])
        assert b"<html" in page and b"rerun" in page.lower()
        assert served.url.partition("?url=")[2].startswith("rerun%2Bhttp%3A%2F%2F127.0.0.1%3A")
    finally:
        served.close()
    # Nobody listens any more; a connection that was still open when the server ended is reset.
    with pytest.raises(OSError, match=r"refused|reset"):
        urllib.request.urlopen(served.url.partition("?")[0], timeout=5.0)


def fetched(url: str) -> bytes:
    """The page, once the server listens."""
    deadline_s = time.monotonic() + 20.0
    while True:
        try:
            with urllib.request.urlopen(url, timeout=5.0) as answer:
                return answer.read()
        except OSError:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(0.1)
