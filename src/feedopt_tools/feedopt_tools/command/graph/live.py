"""``feedopt live``: a graph that runs, in the Rerun viewer."""

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
@click.option("--save", type=click.Path(path_type=Path, dir_okay=False), help="Into an .rrd file instead of a viewer.")
@click.option("--connect", metavar="URL", help="To a viewer that runs, such as rerun+http://127.0.0.1:9876/proxy.")
@click.option("--web", is_flag=True, help="To a browser of this machine.")
def command(save: Path | None, connect: str | None, web: bool) -> None:
    """Draw the graph of this ROS domain while it runs, until Ctrl-C: path, feed, tracking, lateness, events."""
    if sum((save is not None, connect is not None, web)) > 1:
        raise ConfigError("give one of --save, --connect and --web")
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
    """Where the recording goes; returns what to tell. Raises ViewError."""
    try:
        if save is not None:
            recording.save(save)
            return f"drawing into {save}; Ctrl-C ends it"
        if connect is not None:
            recording.connect_grpc(connect)
            return f"drawing to {connect}; Ctrl-C ends it"
        if web:
            url = recording.serve_grpc()
            rr.serve_web_viewer(open_browser=has_display(), connect_to=url)
            return f"served; a browser shows it at http://127.0.0.1:9090?url={url}; Ctrl-C ends it"
        if not has_display():
            raise ViewError("no display here: give --web, --save FILE.rrd, or --connect URL of a viewer elsewhere")
        recording.spawn()
    except (OSError, RuntimeError) as error:
        raise ViewError(f"the viewer cannot be reached, or the file not written: {error}") from error
    return "drawing to the viewer; Ctrl-C ends it"
