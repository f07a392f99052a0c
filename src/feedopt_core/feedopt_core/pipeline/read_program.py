"""Read a program, given as file, text or stream of lines: its moves, and the segments of its smoothed toolpath."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import Segment
from feedopt_core.programs.layers.transitions import LayerTransitions, with_layer_transitions
from feedopt_core.programs.moves import Move
from feedopt_core.programs.points_csv import read_points
from feedopt_core.smoothing.cubic_spline import DEFAULT_TOLERANCE_MM, interpolate_points
from feedopt_core.smoothing.stage import smooth

LONGEST_LINE = 1_000_000
"""Bytes. A longer line is refused: it belongs to no program, and reading it could fill the memory."""
_LOOK_AHEAD_LINES = 50
_POINT = re.compile(r"\s*(?:[-+.\d][^,A-Za-z()%;]*(?:[eE][-+]?\d+\s*)?,|x_mm\s*,)")


class ProgramKind(Enum):
    """Formats of programs."""

    POINTS = "points"
    GCODE = "G-code"
    NURBS_JSON = "NURBS in JSON"
    DXF = "DXF"


SUFFIXES = {
    ".csv": ProgramKind.POINTS,
    ".txt": ProgramKind.POINTS,
    ".ngc": ProgramKind.GCODE,
    ".nc": ProgramKind.GCODE,
    ".tap": ProgramKind.GCODE,
    ".gcode": ProgramKind.GCODE,
    ".cnc": ProgramKind.GCODE,
    ".json": ProgramKind.NURBS_JSON,
    ".dxf": ProgramKind.DXF,
}


@dataclass(frozen=True)
class Program:
    """A program that has not been read yet.

    Attributes:
        kind: format of the program.
        content: the file, or the lines. An iterator of lines can be read only once. None among the lines means that the
            next line has not arrived yet; the lines read so far are processed first.
    """

    kind: ProgramKind
    content: Path | Iterable[str | None]

    @classmethod
    def from_text(cls, text: str, name: str = "") -> Program:
        """Program given as text; its kind follows from the suffix of its name, or else from the content."""
        lines = text.splitlines(keepends=True)
        return cls(_kind_by_name(name) or _kind_of(lines[:_LOOK_AHEAD_LINES]), lines)

    @classmethod
    def from_lines(cls, lines: Iterable[str | None], name: str = "") -> Program:
        """Program given as a stream of lines; its kind follows from the suffix of its name, or from its first lines."""
        kind = _kind_by_name(name)
        if kind is not None:
            return cls(kind, lines)
        stream = iter(lines)
        head = list[str]()
        for line in stream:
            if line is None:
                continue
            head.append(line)
            # DXF is recognised by its second line.
            if sum(1 for text in head if text.strip()) == 2 or len(head) == _LOOK_AHEAD_LINES:
                break
        return cls(_kind_of(head), itertools.chain(head, stream))

    def lines(self, source: str) -> Iterator[str]:
        """Its lines. Raises ToolpathError, see :func:`open_program`."""
        return (line for line in self.stream(source) if line is not None)

    def stream(self, source: str) -> Iterator[str | None]:
        """Its lines, and None where the next one has not arrived yet. Raises ToolpathError as :meth:`lines` does."""
        yield from _file_lines(self.content, source) if isinstance(self.content, Path) else self.content


def open_program(path: Path) -> Program:
    """Program in a file; its kind follows from the suffix. The content is read later, as a stream if its kind allows.

    Raises:
        ToolpathError: the file cannot be opened, or its kind is unknown.
    """
    kind = _kind_by_name(path.name)
    if kind is None:
        raise ToolpathError(
            f"files of type {path.suffix or '(none)'} are not read; there are: {', '.join(SUFFIXES)}", source=str(path)
        )
    try:
        with path.open("rb") as file:
            file.read(1)
    except OSError as error:
        raise ToolpathError(f"cannot be read: {error.strerror}", source=str(path)) from error
    return Program(kind, path)


def read_moves(program: Program, source: str, transitions: LayerTransitions | None = None) -> Iterator[Move]:
    """Moves of a program that is not a list of points.

    Args:
        program: the program.
        source: name of the program in errors.
        transitions: replace the moves between layers of closed contours; None: keep all as programmed.

    Raises:
        ToolpathError: the program cannot be read, or it is a list of points, which has no moves.
    """
    moves = _programmed_moves(program, source)
    return moves if transitions is None else with_layer_transitions(moves, transitions.reach_mm, transitions.side)


def _programmed_moves(program: Program, source: str) -> Iterator[Move]:
    # Imported here, because some readers load large libraries.
    if program.kind is ProgramKind.GCODE:
        from feedopt_core.programs.gcode import read_gcode

        yield from read_gcode(program.stream(source), source)
    elif program.kind is ProgramKind.NURBS_JSON:
        from feedopt_core.programs.nurbs_json import read_nurbs_json

        yield from read_nurbs_json(_text(program, source), source)
    elif program.kind is ProgramKind.DXF:
        from feedopt_core.programs.dxf import read_dxf

        content = program.content
        yield from read_dxf(content if isinstance(content, Path) else _text(program, source), source)
    else:
        raise ToolpathError("is a list of points, which has no moves", source=source)


def read_program(
    program: Program | str,
    source: str,
    dimensions: int,
    tolerance_mm: float = DEFAULT_TOLERANCE_MM,
    transitions: LayerTransitions | None = None,
) -> Iterator[Segment]:
    """Segments of a program in order, each one as soon as it is final.

    Args:
        program: the program, or its text.
        source: name of the program in errors.
        dimensions: coordinates of the machine, 2 or 3; a list of plane points on a machine with z stays at z = 0.
        tolerance_mm: largest distance of the smoothed from the programmed path, above zero; a program may set its own.
        transitions: replace the moves between layers of closed contours; None: keep all as programmed.

    Raises:
        ToolpathError: the program cannot be read, or needs a coordinate that the machine does not have; or it is a list
            of points and transitions are requested.
    """
    if not 0.0 < tolerance_mm < float("inf"):
        raise ToolpathError(f"the tolerance is {tolerance_mm:g} mm, must be above zero", source=source)
    if isinstance(program, str):
        program = Program.from_text(program)
    try:
        if program.kind is ProgramKind.POINTS and transitions is None:
            yield from _through_points(program, source, dimensions, tolerance_mm)
        else:
            yield from smooth(read_moves(program, source, transitions), tolerance_mm, dimensions)
    except ToolpathError as error:
        error.source = source
        raise


def _through_points(program: Program, source: str, dimensions: int, tolerance_mm: float) -> Iterator[Segment]:
    programmed = read_points(program.lines(source), source)
    points_mm = programmed.points_mm
    missing = dimensions - points_mm.shape[1]
    if missing < 0:
        raise ToolpathError("has a z coordinate, the machine has no axis for it", line=programmed.lines[0], column=1)
    yield from interpolate_points(np.pad(points_mm, ((0, 0), (0, missing))), programmed.lines, tolerance_mm)


def _kind_by_name(name: str) -> ProgramKind | None:
    return SUFFIXES.get(Path(name).suffix.lower())


def _kind_of(head: list[str]) -> ProgramKind:
    """Kind of a program, recognised by its first lines."""
    lines = [line.strip().removeprefix("\ufeff") for line in head]
    lines = [line for line in lines if line]
    if lines and lines[0][0] in "{[":
        return ProgramKind.NURBS_JSON
    if len(lines) > 1 and lines[0] in ("0", "999") and ("SECTION" in lines[1] or lines[0] == "999"):
        return ProgramKind.DXF
    return ProgramKind.POINTS if lines and _POINT.match(lines[0]) else ProgramKind.GCODE


def _text(program: Program, source: str) -> str:
    """The whole text of a program, with lines of any length."""
    if not isinstance(program.content, Path):
        return "".join(program.lines(source))
    try:
        return program.content.read_text(encoding="utf-8")
    except OSError as error:
        raise ToolpathError(f"cannot be read: {error.strerror}", source=source) from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        column = error.start - (error.object.rfind(b"\n", 0, error.start) + 1) + 1
        raise ToolpathError("is not UTF-8 text", source=source, line=line, column=column) from error


def _file_lines(path: Path, source: str) -> Iterator[str]:
    try:
        with path.open("rb") as file:
            number = 0
            while raw := file.readline(LONGEST_LINE):
                number += 1
                if len(raw) == LONGEST_LINE:
                    raise ToolpathError(
                        f"the line is longer than {LONGEST_LINE} bytes", source=source, line=number, column=1
                    )
                try:
                    yield raw.decode("utf-8")
                except UnicodeDecodeError as error:
                    raise ToolpathError(
                        "is not UTF-8 text", source=source, line=number, column=error.start + 1
                    ) from error
    except OSError as error:
        raise ToolpathError(f"cannot be read: {error.strerror}", source=source) from error
