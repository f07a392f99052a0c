"""Pictures drawn by the Rerun viewer without a display; it needs a Vulkan driver in software or hardware."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from rerun.experimental import ViewerClient

from feedopt_tools.errors import ViewError
from feedopt_tools.views.rerun.curves import ARC_LENGTH, TIME
from feedopt_tools.views.small_png import small_png

WIDTH, HEIGHT = 1600, 900
_START_S = 20.0
_SETTLE_S = 20.0
# Time for which messages of the viewer cover the views.
_QUIET_S = 5.0
_POLL_S = 0.25


@dataclass(frozen=True)
class ViewFailure:
    """A view that could not show its data."""

    view: str
    severity: str
    text: str


@dataclass(frozen=True)
class Cursor:
    """Position of the time cursor, on the time line of motion time or of arc length."""

    over: str
    t_s: float
    s_mm: float


def draw_by_rerun(recording: Path, picture: Path, cursor: Cursor) -> tuple[ViewFailure, ...]:
    """Open a recording in a viewer without a window and take a picture of it.

    Args:
        recording: an ``.rrd`` file with its layout.
        picture: the PNG to write, 1600 x 900.
        cursor: position of the time cursor.

    Returns:
        The views that could not show their data.

    Raises:
        ViewError: the viewer does not start (no Vulkan driver, no rerun), or does not finish loading.
    """
    with _viewer() as client:
        client.open(str(recording.absolute()))
        if cursor.over == "time":
            client.set_time(TIME, duration=cursor.t_s, play_state="paused")
        else:
            client.set_time(ARC_LENGTH, sequence=round(1e3 * cursor.s_mm), play_state="paused")
        client.run_command("ui.toggle_top_panel")
        image = _settled(client)
        failures = tuple(
            ViewFailure(view.name, report.severity, " ".join(filter(None, (report.summary, report.details))))
            for view in client.get_state().views
            for report in view.reports
        )
    picture.parent.mkdir(parents=True, exist_ok=True)
    picture.write_bytes(small_png(image))
    return failures


@contextmanager
def _viewer() -> Iterator[ViewerClient]:
    """A separate viewer on a local port, with its settings in a temporary folder."""
    port = _free_port()
    command = [sys.executable, "-m", "rerun", "--headless", "--hide-welcome-screen", "--bind", "127.0.0.1"]
    command += ["--port", str(port), "--window-size", f"{WIDTH}x{HEIGHT}"]
    with tempfile.TemporaryDirectory() as home, tempfile.TemporaryFile() as log:
        environment = {**os.environ, "HOME": home, "XDG_RUNTIME_DIR": home, "RERUN_ANALYTICS": "0"}
        process = subprocess.Popen(command, stdout=log, stderr=log, env=environment, start_new_session=True)
        try:
            yield _connected(process, f"rerun+http://127.0.0.1:{port}/proxy")
        except (ConnectionError, RuntimeError, TimeoutError) as error:
            log.seek(0)
            lines = log.read().decode(errors="replace").splitlines()
            cause = next((line.strip() for line in lines if "panicked" in line), str(error))
            raise ViewError(
                f"the Rerun viewer cannot draw on this computer: {cause}; it needs a Vulkan driver "
                "(Debian: apt install mesa-vulkan-drivers libvulkan1)"
            ) from error
        finally:
            # The command starts the viewer as a child process: end both.
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _connected(process: subprocess.Popen[bytes], url: str) -> ViewerClient:
    deadline_s = time.monotonic() + _START_S
    while True:
        try:
            client = ViewerClient.connect(url)
            client.get_state()
        except ConnectionError:
            if process.poll() is not None:
                raise ConnectionError("it ended immediately") from None
            if time.monotonic() > deadline_s:
                raise
            time.sleep(_POLL_S)
        else:
            return client


def _settled(client: ViewerClient) -> bytes:
    """The picture after loading, when it has not changed for the time that messages of the viewer stay visible."""
    start_s = quiet_since_s = time.monotonic()
    image = b""
    while time.monotonic() - start_s < _SETTLE_S:
        latest = client.take_screenshot()
        now_s = time.monotonic()
        if latest != image or client.get_state().loading:
            image, quiet_since_s = latest, now_s
        elif now_s - quiet_since_s >= _QUIET_S:
            return image
        time.sleep(_POLL_S)
    if client.get_state().loading:
        raise ViewError("the Rerun viewer did not finish loading the recording")
    return image


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
