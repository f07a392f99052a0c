"""Reads G-code as a stream of lines: plain lines by a compiled scanner, all others word by word."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from feedopt_core.programs.gcode.codes import GCode
from feedopt_core.programs.gcode.interpreter import Interpreter
from feedopt_core.programs.gcode.modal_state import ModalState
from feedopt_core.programs.gcode.move_buffer import MoveBuffer
from feedopt_core.programs.gcode.plain_lines import OTHER_LINE, scan_plain_lines
from feedopt_core.programs.gcode.source_line import SourceLine
from feedopt_core.programs.gcode.words import read_words
from feedopt_core.programs.moves import Move, ProgramEvent

BLOCK_LINES = 2000
_LONGEST_LINE = 100_000
_PLAIN_MOTIONS = (GCode.G0, GCode.G1)
"""Motions of plain lines, by the numbers that :func:`scan_plain_lines` gives them."""


def read_gcode(lines: Iterable[str | None], source: str) -> Iterator[Move]:
    """Moves of a G-code program, block by block of lines. The machine starts at the origin.

    Args:
        lines: of the program, with or without newlines; None where the next line is not there yet: what has been read
            goes out before it is waited for.
        source: name of the program, for errors.

    Raises:
        ToolpathError: with line and column, for anything unsupported or contradictory.
    """
    reader = _Reader(source)
    for block in _blocks(lines):
        yield from reader.read(block)
        if reader.ended:
            return
    reader.finish()


def _blocks(lines: Iterable[str | None]) -> Iterator[list[str]]:
    block: list[str] = []
    for line in lines:
        if line is not None:
            block.append(line)
        if block and (line is None or len(block) == BLOCK_LINES):
            yield block
            block = []
    if block:
        yield block


class _Reader:
    def __init__(self, source: str) -> None:
        self._source = source
        self._state = ModalState()
        self._buffer = MoveBuffer(BLOCK_LINES)
        self._interpreter = Interpreter(self._state, self._buffer)
        self._line = 1
        self._percent = False
        self._begun = False

    @property
    def ended(self) -> bool:
        """The program has ended; further lines are not read."""
        return self._interpreter.ended

    def read(self, block: list[str]) -> Iterator[Move]:
        """Moves of some whole lines."""
        texts = [line.rstrip("\r\n") for line in block]
        text = "\n".join(texts) + "\n"
        codes = np.frombuffer(text.encode("ascii", "replace"), dtype=np.uint8)
        # A line with embedded line ends would overrun the buffer of the scanner.
        plain = text.count("\n") == len(texts)
        at = 0
        while at < len(text) and not self.ended:
            why = OTHER_LINE
            if plain and self._interpreter.plain:
                why, at = self._scan(codes, at)
            if why == OTHER_LINE and at < len(text):
                end = text.index("\n", at)
                self._other_line(text[at:end])
                at, self._line = end + 1, self._line + 1
            yield from self._buffer.take()
        self._buffer.flush()
        yield from self._buffer.take()

    def finish(self) -> None:
        """End of the lines. Raises ToolpathError inside a NURBS block."""
        if self._interpreter.unfinished():
            raise SourceLine("", self._line, self._source).error("the program ends between G5.2 and G5.3", 0)

    def _scan(self, codes: NDArray[np.uint8], at: int) -> tuple[int, int]:
        """Read plain lines; returns why and where they ended."""
        state, buffer = self._state, self._buffer
        buffer.begin(state.position_mm, state.mode)
        began = at
        why, at, self._line, count, motion, state.feed_mm_s = scan_plain_lines(
            codes,
            at,
            self._line,
            state.unit_mm,
            state.offset_mm,
            state.position_mm,
            _PLAIN_MOTIONS.index(state.motion) if state.motion in _PLAIN_MOTIONS else -1,
            state.feed_mm_s,
            buffer.points_mm,
            buffer.lines,
            buffer.feeds_mm_s,
            buffer.count,
            0 if buffer.rapid else 1,
        )
        self._begun = self._begun or at > began
        state.motion = _PLAIN_MOTIONS[motion] if motion >= 0 else state.motion
        buffer.count = count
        if count:
            buffer.rapid = math.isinf(buffer.feeds_mm_s[count - 1])
        if why != OTHER_LINE:
            buffer.flush()
        return why, at

    def _other_line(self, raw: str) -> None:
        if len(raw) > _LONGEST_LINE:
            raise SourceLine("", self._line, self._source).error(
                f"the line is longer than {_LONGEST_LINE} characters", 0
            )
        line = SourceLine(raw, self._line, self._source)
        if line.compact == "%":
            # The first line may open the program; any other one closes it.
            if self._begun:
                self._interpreter.ended = True
                self._buffer.add(ProgramEvent("%", self._line, end=True))
            self._begun = True
        elif line.compact.startswith("/"):
            raise line.error("block delete (/) is not supported: remove the line or the mark", 0)
        elif line.compact:
            self._begun = True
            self._interpreter.execute(read_words(line, self._state.parameters))
