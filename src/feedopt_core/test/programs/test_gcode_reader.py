"""The G-code reader: words against moves written by hand, both ways of reading against each other, bad input."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from feedopt_core.errors import ToolpathError
from feedopt_core.programs.gcode import read_gcode
from feedopt_core.programs.moves import ArcMove, LineMoves, Move, NurbsMove, PathMode, ProgramEvent

FEED = "F600\n"


def read(text: str) -> list[Move]:
    return list(read_gcode(text.splitlines(), "t.ngc"))


def ends(text: str) -> list[tuple[float, float, float]]:
    """Where the motions of a program end."""
    found = list[tuple[float, float, float]]()
    for move in read(text):
        if isinstance(move, LineMoves):
            found += [(float(x), float(y), float(z)) for x, y, z in move.points_mm]
        elif isinstance(move, ArcMove):
            found.append(tuple(move.end_mm.tolist()))
        elif isinstance(move, NurbsMove):
            found.append(tuple(move.control_points_mm[-1].tolist()))
    return found


def refused(text: str) -> ToolpathError:
    with pytest.raises(ToolpathError) as caught:
        read(text)
    assert caught.value.source == "t.ngc"
    return caught.value


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G0 X1 Y2\nZ3", [(1, 2, 0), (1, 2, 3)]),
        ("g0x 1 . 5 y-.5", [(1.5, -0.5, 0)]),
        ("G91 G0 X1\nX1\nG90 X1", [(1, 0, 0), (2, 0, 0), (1, 0, 0)]),
        ("G20 G0 X1\nG21 X1", [(25.4, 0, 0), (1, 0, 0)]),
        ("G0 X5\nG92 X1\nG0 X2\nG53 G0 X2\nG92.1\nG0 X0", [(5, 0, 0), (6, 0, 0), (2, 0, 0), (0, 0, 0)]),
        ("G0 X5\nG92 X0\nG92.2\nG0 X1\nG92.3\nG0 X1", [(5, 0, 0), (1, 0, 0), (6, 0, 0)]),
        ("#1=2\n#<far>=[#1*3]\nG0 X#1 Y[#<far>/4 + SIN[90]]", [(2, 2.5, 0)]),
        ("#1=2\n#1=5 G0 X#1", [(2, 0, 0)]),
        ("N10 G0 X1 (to the start) Y1 ; rest", [(1, 1, 0)]),
        ("%\nG0 X1\n%\nG0 X2", [(1, 0, 0)]),
        ("G0 X1\nM2\nG0 X2", [(1, 0, 0)]),
        ("G0 X1\nX1\nX1 Y0", [(1, 0, 0)]),
        ("G17 G40 G49 G54 G80 G94\nG0 X1", [(1, 0, 0)]),
    ],
)
def test_positions(text: str, expected: list[tuple[float, float, float]]) -> None:
    assert np.array(ends(text)) == pytest.approx(np.array(expected, dtype=float), abs=1e-12)


def test_feeds_are_per_minute_or_inverse_time() -> None:
    text = "G1 X10 F600\nG20 X1 F10\nG21 G93 X35.4 F6\nG94 X0 F60\nG0 X5"
    feeds = [feed for move in read(text) if isinstance(move, LineMoves) for feed in move.feed_mm_s.tolist()]
    # F is read before the unit of its line changes, as LinuxCNC does: F10 are still millimetres a minute.
    assert feeds == pytest.approx([10.0, 10.0 / 60.0, 1.0, 1.0, math.inf])
    (arc,) = read("G93 G3 X0 Y0 I10 F2")
    assert isinstance(arc, ArcMove)
    assert arc.feed_mm_s == pytest.approx(20.0 * math.pi * 2.0 / 60.0)


def test_arcs_in_each_plane() -> None:
    normals = {"G17 G3 X10 Y10 I0 J10": 2, "G18 G3 X10 Z10 I0 K10": 1, "G19 G3 Y10 Z10 J0 K10": 0}
    for line, axis in normals.items():
        (arc,) = read(FEED + line)
        assert isinstance(arc, ArcMove)
        assert arc.normal.tolist() == [float(index == axis) for index in range(3)]
        turned = arc.start_mm - arc.center_mm
        end = (
            arc.center_mm
            + turned * math.cos(arc.sweep_rad)
            + np.cross(arc.normal, turned) * math.sin(arc.sweep_rad)
            + arc.normal * arc.rise_mm
        )
        assert end == pytest.approx(arc.end_mm, abs=1e-9)


@pytest.mark.parametrize(
    ("line", "sweep_deg", "rise_mm"),
    [
        ("G3 X0 Y0 I10", 360.0, 0.0),
        ("G2 X10 Y10 I10", 90.0, 0.0),
        ("G3 X10 Y10 I10 P2", 630.0, 0.0),
        ("G3 X10 Y10 Z4 R10", 90.0, 4.0),
        ("G3 X10 Y10 R-10", 270.0, 0.0),
        ("G90.1 G3 X10 Y10 I0 J10", 90.0, 0.0),
    ],
)
def test_arcs_turn_as_far_as_they_say(line: str, sweep_deg: float, rise_mm: float) -> None:
    (arc,) = read(FEED + line)
    assert isinstance(arc, ArcMove)
    assert math.degrees(arc.sweep_rad) == pytest.approx(sweep_deg, abs=1e-9)
    assert arc.rise_mm == pytest.approx(rise_mm)


def test_splines() -> None:
    cubic, smooth, quadratic, nurbs = read(
        FEED + "G5 X10 Y0 I1 J2 P-1 Q2\nG5 X20 Y0 P-1 Q2\nG5.1 X30 I5 J5\nG5.2 X31 Y1 P2 L3\nX32 Y0 P1\nG5.3"
    )
    assert isinstance(cubic, NurbsMove) and isinstance(smooth, NurbsMove)
    assert isinstance(quadratic, NurbsMove) and isinstance(nurbs, NurbsMove)
    assert cubic.control_points_mm[:, :2].tolist() == [[0, 0], [1, 2], [9, 2], [10, 0]]
    assert smooth.control_points_mm[1, :2].tolist() == [11, -2]
    assert (quadratic.degree, quadratic.control_points_mm[1, :2].tolist()) == (2, [25, 5])
    assert (nurbs.degree, nurbs.weights.tolist()) == (2, [1, 2, 1])
    assert nurbs.control_points_mm[:, :2].tolist() == [[30, 0], [31, 1], [32, 0]]


def test_events_stand_at_their_place() -> None:
    text = "T1 M6\nM3 S900 M8\nG0 X1\nG4 P0.5\nG0 X2\nM0\nM5 M9\nM30"
    found = [
        (move.text, move.stop, move.dwell_s, move.end) if isinstance(move, ProgramEvent) else "move"
        for move in read(text)
    ]
    assert found == [
        ("T1", False, 0.0, False),
        ("M6", True, 0.0, False),
        ("M3 S900", False, 0.0, False),
        ("M8", False, 0.0, False),
        "move",
        ("G4 P0.5", True, 0.5, False),
        "move",
        ("M0", True, 0.0, False),
        ("M5", False, 0.0, False),
        ("M9", False, 0.0, False),
        ("M30", False, 0.0, True),
    ]


def test_path_modes() -> None:
    text = "G61 G0 X1\nG64 X2\nG20 G64 P0.001 Q0.002\nG0 X3\nG61.1 X4"
    modes = [move.mode for move in read(text) if isinstance(move, LineMoves)]
    wide = PathMode(tolerance_mm=pytest.approx(0.0254), naive_cam_mm=pytest.approx(0.0508))
    assert modes == [PathMode(exact_stop=True), PathMode(), wide, PathMode(exact_stop=True)]


@pytest.mark.parametrize(
    ("text", "line", "column", "message"),
    [
        ("G1 X5", 1, 1, "without a feed"),
        ("X5", 1, 1, "without a motion code"),
        ("F60\nG1 X1\nG1 X2-0", 3, 6, "'-'"),
        ("G93 G1 X5", 1, 1, "its own F"),
        ("G0 X1 G1", 1, 7, "another code for motion"),
        ("G81 X1", 1, 1, "canned cycles"),
        ("G41 D1", 1, 1, "cutter compensation"),
        ("G55", 1, 1, "no offsets are stored"),
        ("M98", 1, 1, "not supported"),
        ("O100 CALL", 1, 1, "O words"),
        ("G0 A5", 1, 4, "no axis A"),
        ("G0 X[1/0]", 1, 7, ""),
        ("G0 X" + "[" * 5000, 1, 0, ""),
        ("G0 X2000000", 1, 4, "no machine reaches"),
        ("G1 F0 X1", 1, 4, "above zero"),
        ("G0 X1 I5", 1, 7, "nothing in this line uses I5"),
        ("F60\nG2 X10 Y0 I3", 2, 11, "not on the circle"),
        ("F60\nG2 X10 R1", 2, 8, "too small"),
        ("F60\nG5.2 X1 Y1 P1 L3\nX2 Y2 P1", 4, 1, "between G5.2 and G5.3"),
        ("G53 G2 X1 I1 F60", 1, 1, "G53 goes with"),
        ("/G0 X1", 1, 1, "block delete"),
        ("G64 P-1", 1, 5, "below zero"),
        ("G0 G92 X1", 1, 8, "want the coordinates"),
        ("G0 X1\x00", 1, 6, "no character"),
        ("G0 X" + "1" * 200_000, 1, 1, "longer than"),
    ],
)
def test_what_is_refused(text: str, line: int, column: int, message: str) -> None:
    error = refused(text)
    assert error.line == line
    assert column in (0, error.column)
    assert message in error.message


COORDINATE = st.decimals(-999, 999, places=3).map(str)
PLAIN_LINE = st.builds(
    lambda code, x, y, z, feed: " ".join(
        [code, *(letter + value for letter, value in zip("XYZF", (x, y, z, feed), strict=True) if value)]
    ),
    st.sampled_from(["", "G0", "G1"]),
    st.one_of(st.just(""), COORDINATE),
    st.one_of(st.just(""), COORDINATE),
    st.one_of(st.just(""), COORDINATE),
    st.one_of(st.just(""), st.integers(1, 9999).map(str)),
)


@given(st.lists(PLAIN_LINE, max_size=40), st.sampled_from(["G20", "G21"]))
def test_both_ways_of_reading_agree_to_the_bit(lines: list[str], unit: str) -> None:
    """A comment at the end of a line keeps it from the fast way."""
    head = f"{unit} F500 G1\n"
    fast, slow = read(head + "\n".join(lines)), read(head + "\n".join(line + "(slow)" for line in lines))
    assert len(fast) == len(slow)
    for one, other in zip(fast, slow, strict=True):
        assert isinstance(one, LineMoves) and isinstance(other, LineMoves)
        for name in ("start_mm", "points_mm", "lines", "feed_mm_s"):
            assert np.array_equal(getattr(one, name), getattr(other, name))
        assert (one.rapid, one.mode) == (other.rapid, other.mode)


CODES = "G0 G1 G2 G3 G5.2 G5.3 G20 G91 G92 G93 G64 G61 M2 M3 X1 Y-2.5 Z.1 I1 J2 R5 P1 Q2 L3 F100 S1 #1=3 X#1"
TOKENS = st.sampled_from([*CODES.split(), *"[]();/%*X", "\n"])


@settings(max_examples=300)
@given(st.one_of(st.text(max_size=60), st.lists(TOKENS, max_size=30).map(" ".join)))
def test_nothing_but_moves_or_an_error_with_its_line_comes_out(text: str) -> None:
    try:
        moves = read(text)
    except ToolpathError as error:
        moves = []
        if error.line < 1:
            raise
    for move in moves:
        for name in ("points_mm", "control_points_mm", "end_mm", "center_mm"):
            assert np.all(np.isfinite(getattr(move, name, np.zeros(1))))


def test_inches_are_the_same_moves() -> None:
    millimetres = ends("G21 F600\nG1 X12.7 Y25.4\nG3 X0 Y0 R50.8\n")
    inches = ends("G20 F600\nG1 X0.5 Y1\nG3 X0 Y0 R2\n")
    assert np.array(inches) == pytest.approx(np.array(millimetres), abs=1e-12)


def test_long_programs_come_in_blocks_that_join() -> None:
    lines = [FEED.strip(), "G1", *(f"X{k}" for k in range(1, 5001))]
    moves = list(read_gcode(lines, "t.ngc"))
    assert len(moves) == 3
    assert all(isinstance(move, LineMoves) for move in moves)
    for before, after in itertools.pairwise(moves):
        assert np.array_equal(before.points_mm[-1], after.start_mm)
    assert np.concatenate([move.lines for move in moves]).tolist() == list(range(3, 5003))
