"""What can go wrong with the processes of a graph."""

from __future__ import annotations

from feedopt_core.errors import FeedoptError


class NodeDiedError(FeedoptError):
    """A node's process ended by itself.

    Args:
        message: cause with the end of the log.
        exit_code: its exit code; negative: the signal that killed it.
    """

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class GraphNotReadyError(FeedoptError):
    """Not every node said READY in time; the message names them."""


class GoalRefusedError(FeedoptError):
    """The toolpath node did not accept the goal."""
