"""``feedopt view`` and ``feedopt report`` on bags as they come: complete, cut off, empty, foreign, missing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from mcap.writer import Writer
from recorded_run import write_run

from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.run_folder import BAG_NAME
from feedopt_tools.command.main import main
from feedopt_tools.report import html_parts
from feedopt_tools.views.pages import PAGES
from feedopt_tools.views.signals.scene import scene_of
from feedopt_tools.views.signals.summary import summary_markdown


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("command_view")
    return write_run(folder / "run", folder / "share", duration_s=1.0)


def called(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def refused(*arguments: object) -> str:
    """Standard error of a call that ends with an exit code of its own, without a trace."""
    result = called(*arguments)
    assert result.exit_code in (1, 2), result.output
    assert isinstance(result.exception, SystemExit)
    return result.stderr


def test_web_server_ends_with_the_command_however_that_is_ended(bag: Path) -> None:
    command = "from feedopt_tools.command.main import main; main()"
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    process = subprocess.Popen(
        [sys.executable, "-c", command, "view", str(bag), "--web"], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert process.stdout is not None
    assert "is served at the address below; stop with Ctrl-C" in process.stdout.readline()
    port = int(process.stdout.readline().partition("?")[0].rpartition(":")[2])
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text(encoding="ascii").split()
    assert children and port
    process.terminate()
    assert process.wait(60.0) == 0
    assert not any(Path(f"/proc/{child}").exists() for child in children)


def test_every_page_is_drawn_into_a_folder(bag: Path, tmp_path: Path) -> None:
    result = called("view", bag, "--screenshot", tmp_path / "pages", "--drawn-by", "matplotlib")
    assert result.exit_code == 0, result.output
    pictures = sorted((tmp_path / "pages").glob("*.png"))
    assert [picture.stem for picture in pictures] == sorted(page.key for page in PAGES)
    # Small enough for documents, and not blank: a blank page of this size takes 4 kB.
    assert all(10_000 < picture.stat().st_size < 200_000 for picture in pictures)


def test_one_page_and_two_bags_are_drawn_into_a_file(bag: Path, tmp_path: Path) -> None:
    one = tmp_path / "one.png"
    assert called("view", bag, "--screenshot", one, "--page", "planner", "--drawn-by", "matplotlib").exit_code == 0
    both = tmp_path / "both.png"
    assert called("view", bag, bag, "--screenshot", both, "--over", "time", "--drawn-by", "matplotlib").exit_code == 0
    assert one.stat().st_size > 10_000 and both.stat().st_size > 10_000


def test_recordings_of_one_and_of_two_bags_are_saved(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    result = called("view", bag, "--save", tmp_path / "one.rrd", "--page", "contour")
    assert result.exit_code == 0 and "no display" in result.output
    assert called("view", bag, bag, "--save", tmp_path / "two.rrd").exit_code == 0
    assert (tmp_path / "one.rrd").stat().st_size > 50_000 and (tmp_path / "two.rrd").stat().st_size > 50_000
    # What was saved is shown again without the bag.
    assert called("view", tmp_path / "one.rrd").exit_code == 0


def test_recording_of_a_run_is_written_once(bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder of a run, as the demo leaves it, and the bag in it have one recording."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    folder = tmp_path / "run"
    shutil.copytree(bag, folder / BAG_NAME, ignore=shutil.ignore_patterns("*.rrd"))
    for shown in (folder, folder / BAG_NAME):
        assert called("view", shown).exit_code == 0
    assert list(tmp_path.rglob("*.rrd")) == [folder / "run.rrd"]


def test_cut_off_bag_is_shown_as_far_as_it_goes(bag: Path, tmp_path: Path) -> None:
    whole = next(bag.glob("*.mcap")).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(0.8 * len(whole))])
    result = called("view", cut, "--screenshot", tmp_path / "cut.png", "--drawn-by", "matplotlib")
    assert result.exit_code == 0, result.output
    scene = scene_of(read_bag(cut, allow_truncated=True))
    assert "| recording | cut off: the recorder was killed |" in summary_markdown(scene)


@pytest.mark.parametrize("command", ["view", "report"])
def test_what_is_no_bag_is_refused_by_name(command: str, tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("not a bag at all")
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "nothing").mkdir()
    with (tmp_path / "other.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/chatter", "cdr", schema)
        writer.add_message(channel, 1, b"\x00\x01\x00\x00\x03\x00\x00\x00hi\x00", 1)
        writer.finish()
    assert "text.mcap" in refused(command, tmp_path / "text.mcap")
    assert "empty.mcap" in refused(command, tmp_path / "empty.mcap")
    assert "no MCAP file" in refused(command, tmp_path / "nothing")
    assert "no such bag" in refused(command, tmp_path / "missing")
    assert "none of the topics of feedopt" in refused(command, tmp_path / "other.mcap")


def test_wishes_that_cannot_be_met_are_refused(bag: Path, tmp_path: Path) -> None:
    assert "3 bags were given" in refused("view", bag, bag, bag)
    assert "--page applies to one run" in refused("view", bag, bag, "--page", "motion")
    assert "holds no program 7" in refused("view", bag, "--program", 7)
    assert "this recording does not exist" in refused("view", tmp_path / "none.rrd")
    assert "is a Rerun recording" in refused("view", tmp_path / "none.rrd", bag)
    (tmp_path / "file").write_text("")
    assert "cannot be written" in refused("report", bag, "--out", tmp_path / "file" / "page.html")


class _Page(HTMLParser):
    """Tags that are open, what is referred to, and the pictures."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.references: list[str] = []
        self.pictures = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value or "" for name, value in attrs if name in ("src", "href", "action", "data")]
        self.pictures += tag == "img"
        if tag not in ("meta", "img", "br", "hr", "link", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_report_is_one_whole_page_that_needs_nothing_else(bag: Path, tmp_path: Path) -> None:
    result = called("report", bag, "--out", tmp_path / "page.html")
    assert result.exit_code == 0, result.output
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    page.close()
    assert page.open == []
    assert page.pictures == len(PAGES)
    assert all(reference.startswith("data:image/png;base64,") for reference in page.references)
    assert "@import" not in text and "url(" not in text and "<script" not in text
    for said in (
        "motion time",
        "binds on the path",
        "largest, µm",
        "not judged",
        "solving, all windows",
        "sha256",
        "p99",
    ):
        assert said in text


def test_report_on_standard_output(bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing but the page is written there: the line about it goes to standard error."""
    monkeypatch.chdir(tmp_path)
    result = called("report", bag, "--out", "-")
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("<!") and result.stdout.rstrip().endswith("</html>")
    page = _Page()
    page.feed(result.stdout)
    page.close()
    assert page.open == [] and page.pictures == len(PAGES)
    assert result.stderr == f"-: {len(result.stdout_bytes) / 1024:.0f} KiB\n"
    assert not list(tmp_path.iterdir())


def test_report_escapes_what_the_bag_says() -> None:
    assert html_parts.pairs([("<b>", 'a "&" b')]).count("&lt;b&gt;") == 1
    assert "<script>" not in html_parts.document("x", [html_parts.folded("y", "<script>")])
