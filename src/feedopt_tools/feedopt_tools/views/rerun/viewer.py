"""Opens recordings in the Rerun viewer: in a window, or in a browser."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import webbrowser
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from feedopt_tools.errors import ViewError


@dataclass(frozen=True)
class OpenedView:
    """Result of opening a recording.

    Attributes:
        recording: the ``.rrd`` file.
        viewer_pid: process id of the viewer; None without a display.
        hint: without a display, how to open the recording; else empty.
    """

    recording: Path
    viewer_pid: int | None
    hint: str


def open_viewer(recording: Path) -> OpenedView:
    """Show an ``.rrd`` file in a viewer that stays open after this process.

    Raises:
        ViewError: the file does not exist.
    """
    _check(recording)
    if not has_display():
        return OpenedView(recording, None, _hint(recording))
    command = [sys.executable, "-m", "rerun", str(recording)]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    return OpenedView(recording, process.pid, "")


@dataclass(frozen=True)
class WebView:
    """A recording served to browsers on this computer until the process ends."""

    process: subprocess.Popen[bytes]
    url: str

    def close(self) -> None:
        """End the command and the server, which is its child process."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGTERM)
        self.process.wait()


def serve_web(recording: Path) -> WebView:
    """Serve an ``.rrd`` file to browsers on this computer; with a display, open a browser.

    Raises:
        ViewError: the file does not exist.
    """
    _check(recording)
    port, web_port = _free_port(), _free_port()
    command = [sys.executable, "-m", "rerun", "--serve-web", "--bind", "127.0.0.1"]
    command += ["--port", str(port), "--web-viewer-port", str(web_port), str(recording)]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    data = quote(f"rerun+http://127.0.0.1:{port}/proxy", safe="")
    url = f"http://127.0.0.1:{web_port}?url={data}"
    if has_display():
        webbrowser.open(url)
    return WebView(process, url)


def has_display() -> bool:
    """Whether a window can be opened on this computer."""
    return sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _check(recording: Path) -> None:
    if not recording.is_file():
        raise ViewError(f"{recording}: this recording does not exist")


def _hint(recording: Path) -> str:
    return (
        f"no display. Copy {recording} to a computer with a display and open it with: rerun {recording.name}; "
        f"or serve it to a browser: ./feedopt view {recording} --web; or draw it with --screenshot FILE.png"
    )


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
