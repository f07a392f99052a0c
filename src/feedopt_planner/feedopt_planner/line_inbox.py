"""Buffer between subscription and reader for the lines of a program streamed during execution. Free of ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from feedopt_core.errors import ToolpathError

MOST_BLOCKS = 10_000
"""Largest number of waiting blocks. A sender that follows the node's status stays far below it."""


class LineInbox:
    """Blocks of lines in order. Not thread-safe: the caller holds its own lock.

    Attributes:
        sequence: last block that the reader has taken; the sender uses it for back-pressure.
    """

    def __init__(self) -> None:
        self.sequence = 0
        self._received = 0
        self._blocks: deque[Sequence[str]] = deque()
        self._complete = False
        self._error: ToolpathError | None = None

    @property
    def ready(self) -> bool:
        """Whether :meth:`take` has a block, the end of the program or an error."""
        return bool(self._blocks) or self._complete or self._error is not None

    def put(self, sequence: int, lines: Sequence[str], *, last: bool) -> None:
        """Add a block of lines; an error is kept for the reader, after the lines received before it."""
        if self._complete or self._error is not None:
            return
        if sequence != self._received + 1:
            self._error = ToolpathError(
                f"/program_lines: block {sequence} arrived after {self._received}: lines were lost, "
                "send the program again"
            )
        elif len(self._blocks) >= MOST_BLOCKS:
            self._error = ToolpathError(
                f"/program_lines: more than {MOST_BLOCKS} blocks are waiting; wait for the toolpath node's status"
            )
        else:
            self._received = sequence
            self._blocks.append(lines)
            self._complete = last

    def take(self) -> Sequence[str] | None:
        """The next block; None after the last one. Call it only if :attr:`ready`.

        Raises:
            ToolpathError: blocks were lost, or too many arrived.
        """
        if self._blocks:
            self.sequence += 1
            return self._blocks.popleft()
        if self._error is not None:
            raise self._error
        return None
