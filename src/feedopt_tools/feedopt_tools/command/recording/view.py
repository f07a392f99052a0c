"""``feedopt view``: show one recorded run, or compare two, in the Rerun viewer or as pictures."""

from __future__ import annotations

import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from feedopt_core.errors import ConfigError
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.errors import BagForeignError
from feedopt_recorder.run_folder import BAG_NAME, bag_of
from feedopt_tools.command.exit_codes import FAILURE, OK
from feedopt_tools.errors import ViewError
from feedopt_tools.views.pages import OVER, PAGES, page_named

if TYPE_CHECKING:
    from feedopt_tools.views.picture import Picture
    from feedopt_tools.views.signals.scene import RunScene

_RECORDING = "run.rrd"


@dataclass(frozen=True)
class _ViewOptions:
    """Options of the view command."""

    bags: tuple[Path, ...]
    program: int | None
    page: str | None
    over: str | None
    drawn_by: str


@click.command()
@click.argument("bags", nargs=-1, required=True, metavar="BAG [BAG2]", type=click.Path(path_type=Path))
@click.option("--web", is_flag=True, help="Show it in a browser, until Ctrl-C.")
@click.option(
    "--save", type=click.Path(path_type=Path, dir_okay=False), help="File name of the .rrd recording made from a bag."
)
@click.option(
    "--screenshot",
    type=click.Path(path_type=Path),
    metavar="FILE.png|FOLDER",
    help="Draw one page as PNG, or all pages into a folder, instead of opening the viewer.",
)
@click.option("--page", type=click.Choice([page.key for page in PAGES]), help="Page shown first.")
@click.option("--over", type=click.Choice(OVER), help="Horizontal axis of the curves; default: that of the page.")
@click.option("--program", type=int, help="Number of the program in the bag; default: the last one.")
@click.option(
    "--drawn-by",
    type=click.Choice(["any", "rerun", "matplotlib"]),
    default="any",
    show_default=True,
    help="Program that draws the pictures; any: Rerun, or matplotlib if Rerun cannot.",
)
def command(
    bags: tuple[Path, ...],
    web: bool,
    save: Path | None,
    screenshot: Path | None,
    page: str | None,
    over: str | None,
    program: int | None,
    drawn_by: str,
) -> None:
    """Show BAG (a bag, the folder of a run or a .rrd file), or compare BAG and BAG2."""
    if len(bags) > 2:
        raise ConfigError(f"{len(bags)} bags were given; give one, or two to compare")
    if len(bags) == 2 and page is not None:
        raise ConfigError("--page applies to one run; a comparison of two runs has its own pages")
    options = _ViewOptions(tuple(bag_of(bag) for bag in bags), program, page, over, drawn_by)
    if screenshot is not None:
        failures = [failure for picture in _draw(options, screenshot) for failure in picture.failures]
        for failure in failures:
            click.echo(f"view {failure.view}: {failure.text}", err=True)
        sys.exit(FAILURE if failures else OK)
    _show(_recording(options, save), web=web)


def _scene(bag: Path, program: int | None) -> RunScene:
    """Scene of a bag; the bag of a killed recorder is accepted."""
    from feedopt_tools.views.signals.scene import scene_of

    if bag.suffix == ".rrd":
        raise ConfigError(f"{bag}: is a Rerun recording; give the bag from which it was made")
    try:
        return scene_of(read_bag(bag, program, allow_truncated=True))
    except BagForeignError as error:
        raise BagForeignError(f"{error}; to see what Rerun itself can show of such a file: rerun FILE.mcap") from error


def _draw(options: _ViewOptions, target: Path) -> tuple[Picture, ...]:
    from feedopt_tools.views.picture import draw_comparison_picture, draw_page, draw_pages
    from feedopt_tools.views.signals.comparison import compare

    scenes = [_scene(bag, options.program) for bag in options.bags]
    into_folder = target.suffix.lower() != ".png"
    drawn: list[Picture] = []
    if len(scenes) == 2:
        file = target / "comparison.png" if into_folder else target
        drawn.append(draw_comparison_picture(compare(*scenes), file, options.over or "arc-length", by=options.drawn_by))
    elif into_folder and options.page is None:
        drawn += draw_pages(scenes[0], target, by=options.drawn_by)
    else:
        page = page_named(options.page or PAGES[0].key)
        file = target / f"{page.key}.png" if into_folder else target
        drawn.append(draw_page(scenes[0], file, page, options.over, by=options.drawn_by))
    for picture in drawn:
        click.echo(f"{picture.path} drawn by {picture.drawn_by}" + (f" ({picture.reason})" if picture.reason else ""))
    return tuple(drawn)


def _recording(options: _ViewOptions, save: Path | None) -> Path:
    """The ``.rrd`` file to show: the given one, or a new one made from the bags."""
    first = options.bags[0]
    if first.suffix == ".rrd" and len(options.bags) == 1:
        return first
    from feedopt_tools.views.rerun.comparison_recording import save_comparison
    from feedopt_tools.views.rerun.recording import save_scene
    from feedopt_tools.views.signals.comparison import compare

    scenes = [_scene(bag, options.program) for bag in options.bags]
    bag_folder = first if first.is_dir() else first.parent
    # In the folder of the run, where it replaces the recording that the demo made of the same run.
    folder = bag_folder.parent if bag_folder.name == BAG_NAME else bag_folder
    if len(scenes) == 2:
        path = save or folder / f"comparison_{_RECORDING}"
        save_comparison(compare(*scenes), path, options.over or "arc-length")
        return path
    path = save or folder / _RECORDING
    page = page_named(options.page or PAGES[0].key)
    save_scene(scenes[0], path, page, options.over or page.over)
    return path


def _show(recording: Path, *, web: bool) -> None:
    from feedopt_tools.views.rerun.viewer import open_viewer, serve_web

    if not web:
        opened = open_viewer(recording)
        click.echo(opened.hint or f"{recording} is open in the viewer")
        return
    # The server must also end if this process is terminated in another way than by Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    served = serve_web(recording)
    try:
        click.echo(f"{recording} is served at the address below; stop with Ctrl-C\n{served.url}")
        code = served.process.wait()
    except KeyboardInterrupt:
        return
    finally:
        served.close()
    raise ViewError(f"the Rerun server ended with code {code}")
