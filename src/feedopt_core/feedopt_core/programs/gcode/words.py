"""Words of a line: letter and value, with the parameter settings between them."""

from __future__ import annotations

from dataclasses import dataclass

from feedopt_core.errors import ToolpathError
from feedopt_core.programs.gcode.expressions import Parameters, ValueReader
from feedopt_core.programs.gcode.source_line import SourceLine

_LETTERS = frozenset("dfghijklmnpqrstxyz")
_REFUSED = {
    "o": "O words (subprograms, loops, program numbers) are not supported; expand the program in the CAM system",
    "e": "E words and exponents are not supported",
} | {axis: f"there is no axis {axis.upper()}; the machine has X, Y and Z" for axis in "abcuvw"}


@dataclass(frozen=True)
class Word:
    """A letter with its value and its index in the compact text."""

    letter: str
    value: float
    index: int

    @property
    def text(self) -> str:
        """The word as one would write it."""
        return f"{self.letter.upper()}{self.value:.12g}"


class Words:
    """All words of a line; words that nothing has taken are refused at the end.

    Attributes:
        line: the line.
        codes: G and M words, in order.
        index: of each letter except G and M.
    """

    def __init__(self, line: SourceLine, words: list[Word]) -> None:
        self.line = line
        self.codes = [word for word in words if word.letter in "gm"]
        self._others = {word.letter: word for word in words if word.letter not in "gm"}
        self._taken = {"n"}

    def has(self, letters: str) -> bool:
        """The line has one of these letters."""
        return any(letter in self._others for letter in letters)

    def take(self, letter: str) -> float | None:
        """Take the value of a letter; None if the line does not have it."""
        word = self._others.get(letter)
        if word is None:
            return None
        self._taken.add(letter)
        return word.value

    def take_word(self, letter: str) -> Word | None:
        """As :meth:`take`, with its place."""
        self._taken.add(letter)
        return self._others.get(letter)

    def need(self, letter: str, code: str) -> float:
        """Take the value of a letter that a code requires.

        Raises:
            ToolpathError: the line does not have it.
        """
        value = self.take(letter)
        if value is None:
            raise self.error(f"{code} needs {letter.upper()}")
        return value

    def error(self, message: str, letters: str = "") -> ToolpathError:
        """Error at the first of these letters, or at the first G or M word, or at the start of the line."""
        places = [word.index for word in self._others.values() if word.letter in letters]
        places = places or [word.index for word in self.codes] or [0]
        return self.line.error(message, min(places))

    def refuse_unused(self) -> None:
        """Refuse words that nothing in the line takes.

        Raises:
            ToolpathError: there is one.
        """
        for letter, word in self._others.items():
            if letter not in self._taken:
                raise self.line.error(f"nothing in this line uses {word.text}", word.index)


def read_words(line: SourceLine, parameters: Parameters) -> Words:
    """Words of a line. Parameters set in the line take effect after it, as RS-274 demands.

    Raises:
        ToolpathError: a letter that is not supported, a repeated letter, a value that is none.
    """
    reader = ValueReader(line, parameters)
    words: list[Word] = []
    seen: set[str] = set()
    settings: list[tuple[int | str, float]] = []
    while reader.at < len(line.compact):
        start = reader.at
        letter = line.compact[start]
        reader.at += 1
        if letter == "#":
            settings.append(_setting(line, reader))
            continue
        if letter not in _LETTERS:
            raise line.error(_REFUSED.get(letter, f"{letter!r} is no word of G-code"), start)
        if letter in seen:
            raise line.error(f"a second {letter.upper()} in one line", start)
        if letter == "n" and words:
            raise line.error("a line number must be the first word of its line", start)
        if letter not in "gm":
            seen.add(letter)
        words.append(Word(letter, reader.value(), start))
    for key, value in settings:
        if isinstance(key, int):
            parameters.numbered[key] = value
        else:
            parameters.named[key] = value
    return Words(line, words)


def _setting(line: SourceLine, reader: ValueReader) -> tuple[int | str, float]:
    key = reader.parameter_key()
    if line.compact[reader.at : reader.at + 1] != "=":
        raise line.error("a '=' must stand here: a parameter is set, or its letter is missing", reader.at)
    reader.at += 1
    return key, reader.value()
