"""A program that comes slowly, line by line: what can be said of the path so far leaves before more is asked for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import Segment
from feedopt_core.pipeline.read_program import Program, ProgramKind, read_program
from feedopt_core.programs.gcode import read_gcode
from feedopt_core.programs.moves import LineMoves, Move

HEAD = ["G21 G90 F600"]
ZIGZAG = [f"G1 X{10 * k} Y{10 * (k % 2)}" for k in range(1, 301)]


def with_pauses(lines: Iterable[str], every: int) -> Iterator[str | None]:
    for number, line in enumerate(lines, start=1):
        yield line
        if number % every == 0:
            yield None


def joined(moves: Iterable[Move]) -> list[tuple[float, ...]]:
    """Points of straight moves, however they are divided."""
    lines = [move for move in moves if isinstance(move, LineMoves)]
    return [tuple(point) for move in lines for point in move.points_mm.tolist()]


def segments(content: Iterable[str | None]) -> list[Segment]:
    return list(read_program(Program(ProgramKind.GCODE, content), "slow.ngc", 2))


def test_moves_leave_before_a_line_is_waited_for() -> None:
    taken = list[Move]()

    def lines() -> Iterator[str | None]:
        yield from [*HEAD, "G1 X10", "X20 Y5"]
        yield None
        # The reader asks for more only behind what it has read.
        assert joined(taken) == [(10.0, 0.0, 0.0), (20.0, 5.0, 0.0)]
        yield "X30"

    for move in read_gcode(lines(), "slow.ngc"):
        taken.append(move)
    assert joined(taken)[-1] == (30.0, 5.0, 0.0)


@pytest.mark.parametrize("every", [1, 3, 100])
def test_pauses_change_nothing(every: int) -> None:
    lines = [*HEAD, *ZIGZAG, "G3 X3000 Y20 I0 J10", "M2"]
    assert joined(read_gcode(with_pauses(lines, every), "a")) == joined(read_gcode(lines, "a"))
    slow, whole = segments(with_pauses(lines, every)), segments(lines)
    assert [segment.place for segment in slow] == [segment.place for segment in whole]
    ends = [[segment.evaluate(np.array([segment.length_mm])).r_mm[0] for segment in each] for each in (slow, whole)]
    assert np.allclose(*ends, rtol=0.0, atol=1e-9)


def test_first_segment_leaves_long_before_the_program_ends() -> None:
    """Smoothing looks some 64 straight moves ahead; arcs are final with the next move."""
    asked = list[int]()

    def lines() -> Iterator[str | None]:
        for number, line in enumerate([*HEAD, *ZIGZAG]):
            asked.append(number)
            yield line
            yield None

    stream = read_program(Program(ProgramKind.GCODE, lines()), "slow.ngc", 2)
    next(stream)
    assert len(asked) <= 70
    assert sum(1 for _ in stream) > 2 * (len(ZIGZAG) - 1)


def test_kind_is_recognised_over_pauses() -> None:
    program = Program.from_lines(iter([None, "", None, "G21 F600", None, "G1 X5", None]))
    assert program.kind is ProgramKind.GCODE
    assert len(list(read_program(program, "stream", 2))) == 1
    points = Program.from_lines(iter(["0,0", None, "4,1", None, "8,0", None]))
    assert points.kind is ProgramKind.POINTS
    assert list(read_program(points, "stream", 2))[-1].place.last


def test_error_behind_a_pause_has_its_line() -> None:
    with pytest.raises(ToolpathError) as caught:
        segments(iter([*HEAD, None, "G1 X10", None, "G1 X1-0"]))
    assert (caught.value.line, caught.value.column) == (3, 6)
