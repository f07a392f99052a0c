"""``feedopt view``: one recorded run, or two beside each other, in the Rerun viewer or as pictures."""

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
class _Wish:
    """What is to be shown, and how."""

    bags: tuple[Path, ...]
    program: int | None
    page: str | None
    over: str | None
    drawn_by: str


@click.command()
@click.argument("bags", nargs=-1, required=True, metavar="BAG [BAG2]", type=click.Path(path_type=Path))
@click.option("--web", is_flag=True, help="In a browser, until Ctrl-C.")
@click.option("--save", type=click.Path(path_type=Path, dir_okay=False), help="Where to put the .rrd made of a bag.")
@click.option(
    "--screenshot",
    type=click.Path(path_type=Path),
    metavar="FILE.png|FOLDER",
    help="Draw a page, or every page into a folder, instead of opening the viewer.",
)
@click.option("--page", type=click.Choice([page.key for page in PAGES]), help="Page in front.")
@click.option("--over", type=click.Choice(OVER), help="What curves are drawn over; without it, what the page is about.")
@click.option("--program", type=int, help="Program of the bag; without it, the last one.")
@click.option(
    "--drawn-by",
    type=click.Choice(["any", "rerun", "matplotlib"]),
    default="any",
    show_default=True,
    help="What draws screenshots; any: Rerun, and matplotlib where Rerun cannot.",
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
    """Show BAG, the folder of a run or a .rrd file; or BAG and BAG2 beside each other with their difference."""
    if len(bags) > 2:
        raise ConfigError(f"{len(bags)} bags were given; one is shown, or two beside each other")
    if len(bags) == 2 and page is not None:
        raise ConfigError("--page is of one run; two runs have pages of their own")
    wish = _Wish(tuple(bag_of(bag) for bag in bags), program, page, over, drawn_by)
    if screenshot is not None:
        failures = [failure for picture in _draw(wish, screenshot) for failure in picture.failures]
        for failure in failures:
            click.echo(f"view {failure.view}: {failure.text}", err=True)
        sys.exit(FAILURE if failures else OK)
    _show(_recording(wish, save), web=web)


def _scene(bag: Path, program: int | None) -> RunScene:
    """What a bag has to show, also of one whose recorder was killed."""
    from feedopt_tools.views.signals.scene import scene_of

    if bag.suffix == ".rrd":
        raise ConfigError(f"{bag}: is a Rerun recording; give the bag it was made from")
    try:
        return scene_of(read_bag(bag, program, allow_truncated=True))
    except BagForeignError as error:
        raise BagForeignError(
            f"{error}; what Rerun itself knows of such a file is shown by: rerun FILE.mcap"
        ) from error


def _draw(wish: _Wish, target: Path) -> tuple[Picture, ...]:
    from feedopt_tools.views.picture import draw_comparison_picture, draw_page, draw_pages
    from feedopt_tools.views.signals.comparison import compare

    scenes = [_scene(bag, wish.program) for bag in wish.bags]
    into_folder = target.suffix.lower() != ".png"
    drawn: list[Picture] = []
    if len(scenes) == 2:
        file = target / "comparison.png" if into_folder else target
        drawn.append(draw_comparison_picture(compare(*scenes), file, wish.over or "arc-length", by=wish.drawn_by))
    elif into_folder and wish.page is None:
        drawn += draw_pages(scenes[0], target, by=wish.drawn_by)
    else:
        page = page_named(wish.page or PAGES[0].key)
        file = target / f"{page.key}.png" if into_folder else target
        drawn.append(draw_page(scenes[0], file, page, wish.over, by=wish.drawn_by))
    for picture in drawn:
        click.echo(f"{picture.path} by {picture.drawn_by}" + (f" ({picture.reason})" if picture.reason else ""))
    return tuple(drawn)


def _recording(wish: _Wish, save: Path | None) -> Path:
    """The ``.rrd`` file to show, made of the bags where one is not given."""
    first = wish.bags[0]
    if first.suffix == ".rrd" and len(wish.bags) == 1:
        return first
    from feedopt_tools.views.rerun.comparison_recording import save_comparison
    from feedopt_tools.views.rerun.recording import save_scene
    from feedopt_tools.views.signals.comparison import compare

    scenes = [_scene(bag, wish.program) for bag in wish.bags]
    bag_folder = first if first.is_dir() else first.parent
    # Beside the recording that the demo made of the same run, and over it.
    folder = bag_folder.parent if bag_folder.name == BAG_NAME else bag_folder
    if len(scenes) == 2:
        path = save or folder / f"comparison_{_RECORDING}"
        save_comparison(compare(*scenes), path, wish.over or "arc-length")
        return path
    path = save or folder / _RECORDING
    page = page_named(wish.page or PAGES[0].key)
    save_scene(scenes[0], path, page, wish.over or page.over)
    return path


def _show(recording: Path, *, web: bool) -> None:
    from feedopt_tools.views.rerun.viewer import open_viewer, serve_web

    if not web:
        opened = open_viewer(recording)
        click.echo(opened.hint or f"{recording} is open in the viewer")
        return
    # Ended in any other way than by Ctrl-C, the server must not stay behind either.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    served = serve_web(recording)
    try:
        click.echo(f"{recording} is served until Ctrl-C at\n{served.url}")
        code = served.process.wait()
    except KeyboardInterrupt:
        return
    finally:
        served.close()
    raise ViewError(f"the Rerun server ended with code {code}")
