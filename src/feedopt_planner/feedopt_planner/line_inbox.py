"""Lines of a program that is streamed while it is executed, between the subscription and the reader. Free of ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from feedopt_core.errors import ToolpathError

MOST_BLOCKS = 10_000
"""Blocks that may wait. A sender that heeds the node's status stays far below."""


class LineInbox:
    """Blocks of lines in order. The caller guards it with its own lock.

    Attributes:
        sequence: last block that the reader has taken; the sender's back-pressure.
    """

    def __init__(self) -> None:
        self.sequence = 0
        self._received = 0
        self._blocks: deque[Sequence[str]] = deque()
        self._complete = False
        self._error: ToolpathError | None = None

    @property
    def ready(self) -> bool:
        """There is something to take: a block, the end or an error."""
        return bool(self._blocks) or self._complete or self._error is not None

    def put(self, sequence: int, lines: Sequence[str], *, last: bool) -> None:
        """Take in a block of lines; an error waits for the reader, behind the lines that came before it."""
        if self._complete or self._error is not None:
            return
        if sequence != self._received + 1:
            self._error = ToolpathError(
                f"/program_lines: block {sequence} came after {self._received}; lines are lost, send the program again"
            )
        elif len(self._blocks) >= MOST_BLOCKS:
            self._error = ToolpathError(
                f"/program_lines: more than {MOST_BLOCKS} blocks are waiting; keep behind the toolpath node's status"
            )
        else:
            self._received = sequence
            self._blocks.append(lines)
            self._complete = last

    def take(self) -> Sequence[str] | None:
        """The next block; None behind the last one. Call it when :attr:`ready`.

        Raises:
            ToolpathError: blocks were lost, or too many came.
        """
        if self._blocks:
            self.sequence += 1
            return self._blocks.popleft()
        if self._error is not None:
            raise self._error
        return None
