"""docs/architecture.md and its picture say what the sources say."""

from __future__ import annotations

import ast
import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

WORKSPACE = Path(__file__).resolve().parents[1]
PAGE = WORKSPACE / "docs/architecture.md"
PLACE = re.compile(r"\[[\w.]+\]\(([\w./]+\.py)\)\s+`([\w.]+)`")


@pytest.fixture(scope="module")
def drawing() -> ModuleType:
    spec = importlib.util.spec_from_file_location("draw_architecture", WORKSPACE / "docs/draw_architecture.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def places() -> list[tuple[str, str]]:
    return PLACE.findall(PAGE.read_text(encoding="utf-8"))


def names_in(body: list[ast.stmt], prefix: str = "") -> set[str]:
    """Functions, classes and methods, as ``Class.method``."""
    found: set[str] = set()
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(prefix + node.name)
        if isinstance(node, ast.ClassDef):
            found |= names_in(node.body, f"{prefix}{node.name}.")
    return found


def test_picture_is_that_of_the_sources(drawing):
    shown = drawing.PICTURE.read_text(encoding="utf-8")
    assert shown == drawing.picture(), "./feedopt env python docs/draw_architecture.py draws it again"


def test_ten_steps_are_counted():
    steps = re.findall(r"^\| (\d+) \| \[", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert steps == [str(step) for step in range(1, 11)]
    assert len(places()) == 11


@pytest.mark.parametrize(("file", "name"), places())
def test_function_that_the_page_names_exists(file, name):
    path = (PAGE.parent / file).resolve()
    assert name in names_in(ast.parse(path.read_text(encoding="utf-8")).body)


def test_every_room_has_a_line():
    rooms = {
        path.stem for path in (WORKSPACE / "src/feedopt_core/feedopt_core").iterdir() if path.suffix in ("", ".py")
    }
    section = PAGE.read_text(encoding="utf-8").partition("## Rooms of the core")[2].partition("\n## ")[0]
    cells = re.findall(r"^\| (`.*?) \|", section, re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", " ".join(cells))) == {room for room in rooms if not room.startswith("__")}


def test_arrow_that_a_path_stands_for_is_left_out(drawing):
    arrows = {"top": {"middle", "bottom"}, "middle": {"bottom"}, "bottom": set()}
    assert drawing.drawn_arrows(arrows) == {"top": {"middle"}, "middle": {"bottom"}, "bottom": set()}
    assert drawing.rows_of(arrows) == [["bottom"], ["middle"], ["top"]]


def test_boxes_that_import_each_other_are_refused(drawing):
    with pytest.raises(ValueError, match="import each other: one, two"):
        drawing.rows_of({"one": {"two"}, "two": {"one"}})
