"""``feedopt live``: draw a running graph in the Rerun viewer."""

from __future__ import annotations

import time
from pathlib import Path

import click
import rclpy
import rerun as rr

from feedopt_core.errors import ConfigError
from feedopt_tools.errors import ViewError
from feedopt_tools.live.live_node import LiveNode
from feedopt_tools.views.rerun.recording import APPLICATION
from feedopt_tools.views.rerun.viewer import has_display

_PERIOD_S = 0.1


@click.command()
@click.option(
    "--save", type=click.Path(path_type=Path, dir_okay=False), help="Write an .rrd file instead of opening a viewer."
)
@click.option("--connect", metavar="URL", help="Draw in a running viewer, such as rerun+http://127.0.0.1:9876/proxy.")
@click.option("--web", is_flag=True, help="Draw in a browser on this computer.")
def command(save: Path | None, connect: str | None, web: bool) -> None:
    """Draw the running graph of this ROS domain until Ctrl-C: path, feed, tracking, lateness, events."""
    if sum((save is not None, connect is not None, web)) > 1:
        raise ConfigError("give only one of --save, --connect and --web")
    recording = rr.RecordingStream(APPLICATION)
    click.echo(_open(recording, save, connect, web=web))
    rclpy.init()
    node = LiveNode(recording)
    try:
        while rclpy.ok():
            node.draw()
            time.sleep(_PERIOD_S)
    except KeyboardInterrupt:
        pass
    finally:
        node.finish()
        rclpy.try_shutdown()
    click.echo(f"{node.drawn_setpoints} set points drawn")


def _open(recording: rr.RecordingStream, save: Path | None, connect: str | None, *, web: bool) -> str:
    """Open the file or viewer of the recording; returns the message for the user. Raises ViewError."""
    try:
        if save is not None:
            recording.save(save)
            return f"drawing into {save}; stop with Ctrl-C"
        if connect is not None:
            recording.connect_grpc(connect)
            return f"drawing in the viewer at {connect}; stop with Ctrl-C"
        if web:
            url = recording.serve_grpc()
            rr.serve_web_viewer(open_browser=has_display(), connect_to=url)
            return f"open http://127.0.0.1:9090?url={url} in a browser; stop with Ctrl-C"
        if not has_display():
            raise ViewError("no display: give --web, --save FILE.rrd, or --connect URL of a viewer on another computer")
        recording.spawn()
    except (OSError, RuntimeError) as error:
        raise ViewError(f"cannot reach the viewer or write the file: {error}") from error
    return "drawing in the viewer; stop with Ctrl-C"
