"""Points files: every way a file can be wrong, by line and column."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from feedopt_core.errors import ToolpathError
from feedopt_core.pipeline.read_program import ProgramKind, open_program, read_program
from feedopt_core.programs import points_csv
from feedopt_core.programs.points_csv import read_points


def lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


@pytest.mark.parametrize(
    ("text", "line", "column", "cause"),
    [
        ("", 1, 1, "holds no points; a toolpath needs two"),
        ("\n \n\t\n", 1, 1, "holds no points"),
        ("x_mm,y_mm\n", 1, 1, "holds no points"),
        ("1,2\n", 1, 1, "holds one point only; a toolpath needs two"),
        ("x_mm,y_mm\n\n1,2\n", 3, 1, "holds one point only"),
        ("1,2\n3,nan\n", 2, 3, "nan is not a finite number"),
        ("1,2\n3, NaN \n", 2, 4, "NaN is not a finite number"),
        ("1,2\n-inf,4\n", 2, 1, "-inf is not a finite number"),
        ("1,2\n3,1e999\n", 2, 3, "1e999 is not a finite number"),
        ("1,2\n3.5,four\n", 2, 5, "'four' is not a number"),
        ("1,2\n3,\n", 2, 3, "'' is not a number"),
        ("1,2\n,4\n", 2, 1, "'' is not a number"),
        ("1,2\n3,4;5,6\n", 2, 7, "has 3 fields, the lines before have 2"),
        ("1,2\n3,4,5\n", 2, 5, "has 3 fields, the lines before have 2"),
        ("1,2,3\n4,5\n", 2, 4, "has 2 fields, the lines before have 3"),
        ("1,2\n\n3\n", 3, 2, "has 1 fields, the lines before have 2"),
        ("1\n2\n", 1, 1, "needs x and y, or x, y and z, has 1 fields"),
        ("1,2,3,4\n", 1, 1, "has 4 fields"),
        ("1 2\n3 4\n", 1, 1, "has 1 fields"),
        ("0,0\n1,2\n1,2.0\n3,4\n", 3, 1, "repeats the point of line 2; remove one of them"),
        ("0,0\n\n\n-0.0,0\n3,4\n", 4, 1, "repeats the point of line 1"),
        ("x,y\n1,2\n3,4\n", 1, 1, "'x' is not a number"),
        ("1,2\nx_mm,y_mm\n3,4\n", 2, 1, "'x_mm' is not a number"),
        ("G1 X10 Y20\nG1 X30 Y20\n", 1, 1, "has 1 fields"),
        ("\x00\x01,2\n", 1, 1, "is not a number"),
    ],
)
def test_wrong_file_is_refused_by_line_and_column(text: str, line: int, column: int, cause: str) -> None:
    with pytest.raises(ToolpathError) as caught:
        read_points(lines(text), "part.csv")
    error = caught.value
    assert (error.source, error.line, error.column) == ("part.csv", line, column)
    assert cause in error.message
    assert str(error) == f"part.csv:{line}:{column}: {error.message}"


@pytest.mark.parametrize(
    "text",
    [
        "0,1\n2,-3.5\n",
        "x_mm,y_mm\n0,1\n2,-3.5\n",
        "X_mm , Y_MM\n0,1\n2,-3.5\n",
        "\ufeff0,1\n2,-3.5\n",
        "\ufeffx_mm,y_mm\n0,1\n2,-3.5\n",
        "0,1\r\n2,-3.5\r\n",
        "\ufeffx_mm,y_mm\r\n\r\n0,1\r\n\r\n2,-3.5",
        "  0 ,\t1 \n\n \n+2.0e0,-35e-1",
    ],
)
def test_ways_of_writing_the_same_two_points(text: str) -> None:
    assert np.array_equal(read_points(lines(text), "part.csv").points_mm, [[0.0, 1.0], [2.0, -3.5]])


def test_lines_are_counted_with_blanks_and_header() -> None:
    programmed = read_points(lines("x_mm,y_mm,z_mm\n\n1,2,3\n\r\n4,5,6\n"), "part.csv")
    assert programmed.points_mm.shape == (2, 3)
    assert programmed.lines == [3, 5]


def test_byte_order_mark_does_not_count_as_a_column() -> None:
    with pytest.raises(ToolpathError) as caught:
        read_points(lines("\ufeff1,nan\n"), "part.csv")
    assert (caught.value.line, caught.value.column) == (1, 3)


def test_long_field_is_quoted_in_part_only() -> None:
    with pytest.raises(ToolpathError) as caught:
        read_points(lines(f"1,{'z' * 5000}\n"), "part.csv")
    assert len(str(caught.value)) < 120


def test_the_line_with_one_point_too_many_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(points_csv, "MAX_POINTS", 5)
    text = [f"{number},0\n" for number in range(6)]
    assert len(read_points(text[:5], "part.csv").lines) == 5
    with pytest.raises(ToolpathError, match="more than 5 points; divide the program") as caught:
        read_points(["x_mm,y_mm\n", *text], "part.csv")
    assert (caught.value.line, caught.value.column) == (7, 1)


def test_reading_stops_at_one_point_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(points_csv, "MAX_POINTS", 10)
    taken = list[int]()

    def endless() -> Iterator[str]:
        number = 0
        while True:
            taken.append(number)
            yield f"{number},0\n"
            number += 1

    with pytest.raises(ToolpathError, match="more than 10 points"):
        read_points(endless(), "part.csv")
    assert len(taken) == 11


@pytest.mark.parametrize(
    ("data", "line", "column"),
    [
        (b"\xff\xfe1\x00,\x002\x00", 1, 1),
        (b"1,2\n3,4\n5,\xb56\n", 3, 3),
        (b"1,2\r\n\x80\x81\x82", 2, 1),
    ],
)
def test_file_that_is_not_text_is_refused_at_the_first_bad_byte(
    tmp_path: Path, data: bytes, line: int, column: int
) -> None:
    path = tmp_path / "part.csv"
    path.write_bytes(data)
    with pytest.raises(ToolpathError, match="is not UTF-8 text") as caught:
        list(read_program(open_program(path), str(path), 2))
    assert (caught.value.source, caught.value.line, caught.value.column) == (str(path), line, column)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ToolpathError, match=r"part\.csv: cannot be read: No such file") as caught:
        open_program(tmp_path / "part.csv")
    assert caught.value.line == 0


def test_folder_is_not_a_program(tmp_path: Path) -> None:
    folder = tmp_path / "part.csv"
    folder.mkdir()
    with pytest.raises(ToolpathError, match="cannot be read: Is a directory"):
        open_program(folder)


@pytest.mark.parametrize("name", ["part.step", "part", "part.csv.gz"])
def test_unknown_kind_of_file_is_refused_by_its_suffix(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("0,0\n1,1\n", encoding="utf-8")
    with pytest.raises(ToolpathError, match="are not read"):
        open_program(path)


@pytest.mark.parametrize("name", ["part.csv", "PART.CSV", "part.txt"])
def test_points_files_are_opened_by_suffix(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("0,0\n1,1\n", encoding="utf-8")
    program = open_program(path)
    assert program.kind is ProgramKind.POINTS
    assert list(program.lines(str(path))) == ["0,0\n", "1,1\n"]


def test_z_on_a_plane_machine_is_refused() -> None:
    with pytest.raises(ToolpathError, match="the machine has no axis for it") as caught:
        list(read_program("x_mm,y_mm,z_mm\n0,0,0\n1,1,1\n", "part.csv", 2))
    assert (caught.value.line, caught.value.column) == (2, 1)


def test_plane_program_on_a_machine_with_z_stays_at_zero() -> None:
    segments = list(read_program("0,0\n5,1\n9,4\n", "part.csv", 3))
    for segment in segments:
        points = segment.evaluate(np.linspace(0.0, segment.length_mm, 5))
        assert points.r_mm.shape == (5, 3)
        assert np.all(points.r_mm[:, 2] == 0.0)


def test_segments_name_the_line_they_start_on() -> None:
    text = "x_mm,y_mm\n0,0\n\n" + "".join(f"{5 * number},{number % 3}\n" for number in range(1, 40))
    programmed = read_points(lines(text), "part.csv")
    segments = list(read_program(text, "part.csv", 2))
    assert len(segments) > 2
    for segment in segments:
        start = programmed.points_mm[programmed.lines.index(segment.place.source_line)]
        assert np.allclose(segment.evaluate(np.zeros(1)).r_mm[0], start, atol=1e-9)
    assert [segment.place.last for segment in segments] == [False] * (len(segments) - 1) + [True]


@pytest.mark.parametrize("tolerance_mm", [0.0, -0.01, float("nan"), float("inf")])
def test_tolerance_that_is_none_is_refused(tolerance_mm: float) -> None:
    with pytest.raises(ToolpathError, match=r"part\.csv: the tolerance is .* mm, must be above zero"):
        list(read_program("0,0\n5,1\n9,4\n", "part.csv", 2, tolerance_mm))


def test_tolerance_below_rounding_is_refused_with_the_line() -> None:
    text = "".join(f"{1e9 + 3.1 * k:.3f},{(-1) ** k * 0.7:.3f}\n" for k in range(12))
    with pytest.raises(ToolpathError, match="the tolerance is 1e-12 mm") as caught:
        list(read_program(text, "part.csv", 2, 1e-12))
    assert caught.value.line >= 1
