"""One line of a program: its compact text without blanks and comments, and the column of each character."""

from __future__ import annotations

from feedopt_core.errors import ToolpathError

_BLANKS = str.maketrans("", "", " \t")


class SourceLine:
    """A line and its compact text, in lower case, without blanks and comments.

    Raises:
        ToolpathError: a comment that is not closed or holds another one, a character that G-code does not have.
    """

    def __init__(self, raw: str, number: int, source: str) -> None:
        self.raw = raw.removesuffix("\r")
        self.number = number
        self._source = source
        if "(" in self.raw or ";" in self.raw or ")" in self.raw:
            compact = "".join(self.raw[place] for place in self._kept())
        else:
            compact = self.raw.translate(_BLANKS)
        if not compact.isascii() or not compact.isprintable():
            index = next(i for i, mark in enumerate(compact) if not (mark.isascii() and mark.isprintable()))
            raise self.error(f"{compact[index]!r} is no character of G-code; is this a text file?", index)
        self.compact = compact.lower()

    def error(self, message: str, index: int) -> ToolpathError:
        """Error at an index of the compact text."""
        kept = self._kept()
        column = kept[index] + 1 if index < len(kept) else len(self.raw) + 1
        return self._error_at(message, column)

    def _error_at(self, message: str, column: int) -> ToolpathError:
        return ToolpathError(message, source=self._source, line=self.number, column=column)

    def _kept(self) -> list[int]:
        """Places in the raw line of the characters of the compact text."""
        kept = []
        opened = -1
        for place, mark in enumerate(self.raw):
            if opened >= 0:
                if mark == "(":
                    raise self._error_at("a comment inside a comment; G-code does not nest them", place + 1)
                if mark == ")":
                    opened = -1
            elif mark == "(":
                opened = place
            elif mark == ";":
                break
            elif mark not in " \t":
                kept.append(place)
        if opened >= 0:
            raise self._error_at("this comment is not closed by ')' on its line", opened + 1)
        return kept
