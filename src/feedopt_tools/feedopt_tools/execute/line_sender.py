"""Streams the lines of a program during its execution, a bounded number ahead of the toolpath node. Free of ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import islice

BLOCK_LINES = 100
BLOCKS_AHEAD = 50


class LineSender:
    """Groups lines into blocks and sends them as fast as the reader takes them.

    Args:
        lines: the program, without newlines; read as they are sent.
        publish: called with sequence, lines and whether they are the last.
    """

    def __init__(self, lines: Iterable[str], publish: Callable[[int, list[str], bool], None]) -> None:
        self._blocks = _blocks(lines)
        self._publish = publish
        self._sent = 0
        self._next: list[str] | None = next(self._blocks, [])

    def send(self, taken: int) -> None:
        """Send blocks up to the allowed number ahead of the last block that the reader has taken."""
        while self._next is not None and self._sent < taken + BLOCKS_AHEAD:
            following = next(self._blocks, None)
            self._sent += 1
            self._publish(self._sent, self._next, following is None)
            self._next = following


def _blocks(lines: Iterable[str]) -> Iterator[list[str]]:
    iterator = iter(lines)
    while block := list(islice(iterator, BLOCK_LINES)):
        yield block
