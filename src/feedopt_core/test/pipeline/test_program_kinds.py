"""Which reader a program gets: by the suffix of a file, by the content of a text or of a stream of lines."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import SegmentKind
from feedopt_core.pipeline import read_program as program_module
from feedopt_core.pipeline.read_program import Program, ProgramKind, open_program, read_moves, read_program

CORNER = "G21\nG0 X0 Y0\nG1 X10 F600\nY10\nM2\n"
CURVE = """{"curves": [{"degree": 2, "knots": [0, 0, 0, 1, 1, 1], "weights": [1, 1, 1],
 "control_points_mm": [[0, 0], [5, 5], [10, 0]]}]}"""
POINTS = "0,0\n5,1\n9,4\n"
DXF = "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n"
DXF += "0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n10\n0.0\n20\n0.0\n11\n10.0\n21\n0.0\n0\nENDSEC\n0\nEOF\n"


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        (POINTS, ProgramKind.POINTS),
        ("\ufeffx_mm,y_mm\n0,0\n", ProgramKind.POINTS),
        (" -1.5e-3 , 2\n", ProgramKind.POINTS),
        (".5,+2\n", ProgramKind.POINTS),
        (CORNER, ProgramKind.GCODE),
        ("%\nO100\n", ProgramKind.GCODE),
        ("(a, b)\nG1 X1\n", ProgramKind.GCODE),
        ("; 1, 2\n", ProgramKind.GCODE),
        ("X1 Y2\n", ProgramKind.GCODE),
        ("", ProgramKind.GCODE),
        (CURVE, ProgramKind.NURBS_JSON),
        ("\n\n  [1]", ProgramKind.NURBS_JSON),
        (DXF, ProgramKind.DXF),
        ("  0\r\nSECTION\r\n", ProgramKind.DXF),
        ("999\nmade by a person\n0\nSECTION\n", ProgramKind.DXF),
    ],
)
def test_kind_of_a_text_shows_in_its_first_lines(text: str, kind: ProgramKind) -> None:
    assert Program.from_text(text).kind is kind
    stream = Program.from_lines(iter(text.splitlines(keepends=True)))
    assert stream.kind is kind
    assert "".join(stream.lines("text")) == text


def test_name_with_a_known_suffix_goes_before_the_content() -> None:
    assert Program.from_text(CORNER, "part.csv").kind is ProgramKind.POINTS
    assert Program.from_lines(iter([]), "PART.NC").kind is ProgramKind.GCODE
    assert Program.from_text(POINTS, "part.step").kind is ProgramKind.POINTS


def test_stream_of_lines_is_read_no_further_than_needed() -> None:
    taken = 0

    def lines() -> Iterator[str]:
        nonlocal taken
        for text in CORNER.splitlines():
            taken += 1
            yield text

    assert Program.from_lines(lines()).kind is ProgramKind.GCODE
    assert taken == 2


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("part.ngc", ProgramKind.GCODE),
        ("PART.NC", ProgramKind.GCODE),
        ("part.tap", ProgramKind.GCODE),
        ("part.gcode", ProgramKind.GCODE),
        ("part.cnc", ProgramKind.GCODE),
        ("part.json", ProgramKind.NURBS_JSON),
        ("part.dxf", ProgramKind.DXF),
        ("part.csv", ProgramKind.POINTS),
    ],
)
def test_kind_of_a_file_is_told_by_its_suffix(tmp_path: Path, name: str, kind: ProgramKind) -> None:
    path = tmp_path / name
    path.write_text(CORNER, encoding="utf-8")
    assert open_program(path).kind is kind


def test_gcode_goes_from_file_to_smooth_segments(tmp_path: Path) -> None:
    path = tmp_path / "corner.ngc"
    path.write_text(CORNER, encoding="utf-8")
    segments = list(read_program(open_program(path), str(path), 2))
    assert [segment.kind for segment in segments] == [0, 2, 2, 0]
    assert [segment.place.source_line for segment in segments] == [3, 3, 3, 4]
    assert {segment.place.feed_limit_mm_s for segment in segments} == {10.0}
    assert segments[-1].place.last


def test_nurbs_and_dxf_go_from_text_to_smooth_segments() -> None:
    (curve,) = read_program(CURVE, "curve.json", 2)
    assert curve.kind == SegmentKind.NURBS
    (line,) = read_program(DXF, "line.dxf", 2)
    assert line.length_mm == pytest.approx(10.0)


def test_error_of_the_smoother_names_program_and_line(tmp_path: Path) -> None:
    path = tmp_path / "deep.ngc"
    path.write_text("G21\nG1 X10 F600\nZ-1\n", encoding="utf-8")
    with pytest.raises(ToolpathError, match="no axis for it") as caught:
        list(read_program(open_program(path), str(path), 2))
    assert (caught.value.source, caught.value.line) == (str(path), 3)


def test_points_have_no_moves() -> None:
    with pytest.raises(ToolpathError, match="no moves"):
        list(read_moves(Program.from_text(POINTS), "part.csv"))


def test_line_without_end_is_refused_before_it_fills_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program_module, "LONGEST_LINE", 1000)
    path = tmp_path / "binary.ngc"
    path.write_bytes(b"G1 X1 F5\n" + b"X" * 5000)
    with pytest.raises(ToolpathError, match="longer than 1000 bytes") as caught:
        list(open_program(path).lines("binary.ngc"))
    assert caught.value.line == 2


def test_file_is_read_as_a_stream(tmp_path: Path) -> None:
    path = tmp_path / "part.ngc"
    path.write_bytes(b"G1 X1 F5\nX2\n\xff\n")
    lines = open_program(path).lines("part.ngc")
    assert [next(lines), next(lines)] == ["G1 X1 F5\n", "X2\n"]
    with pytest.raises(ToolpathError, match="is not UTF-8 text") as caught:
        next(lines)
    assert (caught.value.line, caught.value.column) == (3, 1)


def test_text_with_all_line_ends_is_the_same_program() -> None:
    for end in ("\n", "\r\n", "\r"):
        segments = list(read_program(CORNER.replace("\n", end), "text", 2))
        assert np.isclose(segments[0].evaluate(np.array([5.0])).r_mm[0, 0], 5.0)
