"""Draw docs/images/architecture.svg: the packages, the rooms of the core, and which of them imports which.

Run: ``./feedopt env python docs/draw_architecture.py``. All of it is read from the imports of the sources. Each box
stands above all that it imports. An arrow is left out where a path of others leads to the same box.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import grimp

CORE = "feedopt_core"
_DOCS = Path(__file__).resolve().parent
PACKAGES = tuple(sorted(path.parent.name for path in _DOCS.parent.glob("src/*/setup.py")))
PICTURE = _DOCS / "images" / "architecture.svg"

Arrows = dict[str, set[str]]
"""What each box imports."""

_WIDTH_PX = 980
_BOX_PX = (176, 34)
_COLUMN_PX = 230
_STOP_PX = 50
_ROW_PX = 74
_TITLE_PX = 44
_INK, _LINE, _PAPER, _FILL = "#1f2430", "#7a8296", "#ffffff", "#e8edf7"
_FONT = "font-family:Helvetica,Arial,sans-serif;font-size:14px"


def imports_between(box_of: Callable[[str], str | None]) -> Arrows:
    """Imports between boxes; ``box_of`` says in which box a module stands, None: in none."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    arrows: Arrows = {box: set() for module in graph.modules if (box := box_of(module)) is not None}
    for module in graph.modules:
        for imported in graph.find_modules_directly_imported_by(module):
            above, below = box_of(module), box_of(imported)
            if above is not None and below is not None and above != below:
                arrows[above].add(below)
    return arrows


def package_of(module: str) -> str:
    """Package of a module."""
    return module.partition(".")[0]


def room_of(module: str) -> str | None:
    """Room of the core that a module stands in; None outside of the core."""
    parts = module.split(".")
    return parts[1] if parts[0] == CORE and len(parts) > 1 else None


def reached(arrows: Arrows, box: str) -> set[str]:
    """All that a box imports, also through others."""
    found: set[str] = set()
    waiting = list(arrows[box])
    while waiting:
        below = waiting.pop()
        if below not in found:
            found.add(below)
            waiting += arrows[below]
    return found


def drawn_arrows(arrows: Arrows) -> Arrows:
    """The arrows that no path of others stands for."""
    return {
        box: {one for one in below if not any(one in reached(arrows, other) for other in below - {one})}
        for box, below in arrows.items()
    }


def rows_of(arrows: Arrows) -> list[list[str]]:
    """Boxes by row, the lowest first: each just above the highest that it imports. Raises ValueError on a circle."""
    circle = [box for box in arrows if box in reached(arrows, box)]
    if circle:
        raise ValueError(f"import each other: {', '.join(sorted(circle))}")
    heights: dict[str, int] = {}

    def height(box: str) -> int:
        if box not in heights:
            heights[box] = 1 + max((height(below) for below in arrows[box]), default=-1)
        return heights[box]

    rows: list[list[str]] = [[] for _ in range(1 + max(map(height, arrows)))]
    for box in sorted(arrows):
        rows[height(box)].append(box)
    return rows


def chains_of(rows: list[list[str]], arrows: Arrows) -> list[list[str]]:
    """Each arrow as the stops it runs through, box first: one in every row between, so that it crosses no box."""
    row_of = {box: row for row, boxes in enumerate(rows) for box in boxes}
    return [
        [box, *(f"{box}>{one}@{row}" for row in range(row_of[box] - 1, row_of[one], -1)), one]
        for box in sorted(arrows)
        for one in sorted(arrows[box])
    ]


def places_of(rows: list[list[str]], chains: list[list[str]]) -> dict[str, tuple[int, int]]:
    """Centre of each box and stop in px, the top row at 0; a row is in the order of what its boxes point at."""
    below: dict[str, list[str]] = {}
    for chain in chains:
        for stop, following in pairwise(chain):
            below.setdefault(stop, []).append(following)
    places: dict[str, tuple[int, int]] = {}
    for row, boxes in enumerate(rows):
        stops = [stop for stop in below if stop.endswith(f"@{row}")]
        pull = {
            stop: sum(places[one][0] for one in below.get(stop, ())) / max(1, len(below.get(stop, ())))
            for stop in [*boxes, *stops]
        }
        widths = {stop: _COLUMN_PX if stop in boxes else _STOP_PX for stop in pull}
        x = (_WIDTH_PX - sum(widths.values())) // 2
        for stop in sorted(pull, key=lambda stop: (pull[stop], stop)):
            places[stop] = (x + widths[stop] // 2, (len(rows) - 1 - row) * _ROW_PX)
            x += widths[stop]
    return places


def draw(root: ET.Element, title: str, arrows: Arrows, top_px: int) -> int:
    """Draw boxes and arrows below ``top_px``; returns where they end."""
    rows = rows_of(arrows)
    chains = chains_of(rows, drawn_arrows(arrows))
    places = places_of(rows, chains)
    width, height = _BOX_PX
    heading = {"x": "20", "y": str(top_px + 22), "style": f"{_FONT};font-weight:bold", "fill": _INK}
    ET.SubElement(root, "text", heading).text = title
    first = top_px + _TITLE_PX + height // 2
    for chain in chains:
        centres = [places[stop] for stop in chain]
        ends = [(x, y + side * height // 2) for x, y in centres for side in (-1, 1)]
        points = ends[1:-1]
        line = {"points": " ".join(f"{x},{first + y}" for x, y in points), "fill": "none", "stroke": _LINE}
        ET.SubElement(root, "polyline", line | {"marker-end": "url(#tip)"})
    for box in sorted(arrows):
        x, y = places[box]
        corner = {"x": str(x - width // 2), "y": str(first + y - height // 2)}
        size = {"width": str(width), "height": str(height), "rx": "5"}
        ET.SubElement(root, "rect", {**corner, **size, "fill": _FILL, "stroke": _INK})
        label = {"x": str(x), "y": str(first + y + 5), "text-anchor": "middle", "style": _FONT, "fill": _INK}
        ET.SubElement(root, "text", label).text = box
    return first + (len(rows) - 1) * _ROW_PX + height


def picture() -> str:
    """The picture as SVG text; the same sources give the same text."""
    root = ET.Element("svg", {"xmlns": "http://www.w3.org/2000/svg"})
    tip = {"id": "tip", "viewBox": "0 0 8 8", "refX": "8", "refY": "4", "markerWidth": "8", "markerHeight": "8"}
    marker = ET.SubElement(ET.SubElement(root, "defs"), "marker", {**tip, "orient": "auto"})
    ET.SubElement(marker, "path", {"d": "M0,0 L8,4 L0,8 z", "fill": _LINE})
    paper = ET.SubElement(root, "rect", {"width": "100%", "height": "100%", "fill": _PAPER})
    end = draw(root, "Packages", imports_between(package_of), 0)
    end = draw(root, f"Rooms of {CORE}", imports_between(room_of), end + 10)
    root.set("viewBox", f"0 0 {_WIDTH_PX} {end}")
    paper.set("height", str(end))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
    print(PICTURE)
