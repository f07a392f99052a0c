"""Programs of our own as G-code text: small examples of user programs with known shapes.

Each function returns a complete program. Lengths are in mm; with ``unit`` 25.4 the program has the same part in inches
(G20).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

_FEED_MM_MIN = 6000.0


def square(side_mm: float = 40.0, laps: int = 1) -> str:
    """Square, corners of 90 degrees."""
    corners = [(side_mm, 0.0), (side_mm, side_mm), (0.0, side_mm), (0.0, 0.0)] * laps
    return _program(f"X{_number(x)} Y{_number(y)}" for x, y in corners)


def zigzag(step_mm: float = 5.0, height_mm: float = 20.0, count: int = 20) -> str:
    """Zigzag of straight moves."""
    return _program(f"X{_number(step_mm * k)} Y{_number(height_mm * (k % 2))}" for k in range(1, count + 1))


def trochoid(radius_mm: float = 4.0, advance_mm: float = 1.5, turns: int = 6, chords: int = 90) -> str:
    """Trochoidal slot as short chords."""
    points = []
    for k in range(turns * chords + 1):
        angle = 2.0 * math.pi * k / chords
        x_mm = advance_mm * k / chords + radius_mm * math.sin(angle)
        points.append((x_mm, radius_mm * (1.0 - math.cos(angle))))
    return _program(f"X{_number(x)} Y{_number(y)}" for x, y in points[1:])


def circle_diamond_square(size_mm: float = 40.0, unit: float = 1.0, feed_mm_min: float = _FEED_MM_MIN) -> str:
    """Circle of two arcs, diamond, square: one after the other without leaving the plane."""
    r = size_mm / 2.0
    moves = [
        f"G3 X{_number(-r, unit)} Y0 I{_number(-r, unit)} J0",
        f"G3 X{_number(r, unit)} Y0 I{_number(r, unit)} J0",
        *(f"G1 X{_number(x, unit)} Y{_number(y, unit)}" for x, y in ((0.0, r), (-r, 0.0), (0.0, -r), (r, 0.0))),
        *(f"X{_number(x, unit)} Y{_number(y, unit)}" for x, y in ((r, r), (-r, r), (-r, -r), (r, -r), (r, 0.0))),
    ]
    return _program(moves, start=f"X{_number(r, unit)} Y0", unit=unit, feed_mm_min=feed_mm_min)


def spiral_of_arcs(inner_mm: float = 4.0, growth_mm: float = 2.0, halves: int = 10) -> str:
    """Half circles of growing radius with tangential joints: only the curvature has steps."""
    moves, x, radius = list[str](), 0.0, inner_mm
    for k in range(halves):
        centre = radius if k % 2 == 0 else -radius
        x += 2.0 * centre
        moves.append(f"G3 X{_number(x)} Y0 I{_number(centre)} J0")
        radius += growth_mm
    return _program(moves)


def relief(length_mm: float = 30.0, passes: int = 4, pitch_mm: float = 0.5, chord_mm: float = 0.4) -> str:
    """Finishing passes to and fro over a wavy surface, modal lines with x and z only."""
    count = round(length_mm / chord_mm)
    moves = list[str]()
    for row in range(passes):
        steps = range(count + 1) if row % 2 == 0 else range(count, -1, -1)
        moves.append(f"Y{_number(row * pitch_mm)}")
        for k in steps:
            x_mm = length_mm * k / count
            z_mm = 2.0 * math.sin(0.35 * x_mm) * math.cos(0.5 * row) - 3.0
            moves.append(f"X{_number(x_mm)} Z{_number(z_mm)}")
    return _program(moves, start="X0 Y0 Z5")


def butterfly() -> str:
    """Two wings of cubic B-splines (G5.2), mirrored, each with a cusp at the body."""
    wing = ((4.0, 9.0), (16.0, 18.0), (28.0, 14.0), (24.0, 3.0), (13.0, 1.0), (22.0, -7.0), (17.0, -16.0), (6.0, -11.0))
    moves = list[str]()
    for side in (1.0, -1.0):
        points = [*wing, (0.0, 0.0)]
        for index, (x, y) in enumerate(points):
            word = "G5.2 " if index == 0 else ""
            order = " L4" if index == 0 else ""
            moves.append(f"{word}X{_number(side * x)} Y{_number(y)} P1{order}")
        moves.append("G5.3")
    return _program(moves)


def helix(radius_mm: float = 12.0, pitch_mm: float = 3.0, turns: int = 3) -> str:
    """Straight approach, helix downwards in half turns, straight exit."""
    moves = [f"G1 X{_number(radius_mm)} Y{_number(-radius_mm)}", f"G1 X{_number(radius_mm)} Y0"]
    for k in range(2 * turns):
        x = -radius_mm if k % 2 == 0 else radius_mm
        moves.append(f"G3 X{_number(x)} Y0 Z{_number(-(k + 1) * pitch_mm / 2.0)} I{_number(x)} J0")
    moves.append(f"G1 Y{_number(radius_mm)}")
    return _program(moves, start="X0 Y-12 Z0")


def stacked_contours(layers: int = 3, size_mm: float = 30.0, step_mm: float = 0.5) -> str:
    """A closed contour with rounded corners, layer under layer, with a rapid between them."""
    r, s = 5.0, size_mm
    contour = [
        f"G1 X{_number(s - r)}",
        f"G3 X{_number(s)} Y{_number(r)} I0 J{_number(r)}",
        f"G1 Y{_number(s - r)}",
        f"G3 X{_number(s - r)} Y{_number(s)} I{_number(-r)} J0",
        f"G1 X{_number(r)}",
        f"G3 X0 Y{_number(s - r)} I0 J{_number(-r)}",
        f"G1 Y{_number(r)}",
        f"G3 X{_number(r)} Y0 I{_number(r)} J0",
        f"G1 X{_number(s / 2.0)}",
    ]
    moves = list[str]()
    for layer in range(1, layers + 1):
        depth = f"Z{_number(-layer * step_mm)}"
        moves += ["G0 Z2", f"G0 X{_number(s / 2.0)} Y0", f"G1 {depth} F1200", f"F{_FEED_MM_MIN:g}", *contour]
    return _program([*moves, "G0 Z2"], start="Z2")


OWN_PROGRAMS: dict[str, tuple[int, Callable[[], str]]] = {
    "square": (2, square),
    "zigzag": (2, zigzag),
    "zigzag_small": (2, lambda: zigzag(0.5, 2.0, 30)),
    "zigzag_tiny": (2, lambda: zigzag(0.05, 0.2, 30)),
    "trochoid": (2, trochoid),
    "circle_diamond_square": (2, circle_diamond_square),
    "spiral_of_arcs": (2, spiral_of_arcs),
    "relief": (3, relief),
    "butterfly": (2, butterfly),
    "helix": (3, helix),
    "stacked_contours": (3, stacked_contours),
}
"""Coordinates needed and text of each program."""


def _program(
    moves: Iterable[str], *, start: str = "X0 Y0", unit: float = 1.0, feed_mm_min: float = _FEED_MM_MIN
) -> str:
    units = "G20" if unit != 1.0 else "G21"
    head = [units, "G17 G90 G94", f"G0 {start}", f"F{_number(feed_mm_min, unit)}", "G1"]
    return "\n".join([*head, *moves, "M2", ""])


def _number(value_mm: float, unit: float = 1.0) -> str:
    """A coordinate as text, with a resolution of 0.1 micrometre."""
    text = f"{value_mm / unit:.{4 if unit == 1.0 else 8}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text
