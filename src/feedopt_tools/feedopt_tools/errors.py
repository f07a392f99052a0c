"""What can go wrong in the command and its parts, below the roots of core and recorder."""

from __future__ import annotations

from feedopt_core.errors import FailureKind, FeedoptError
from feedopt_recorder.errors import BagError


class NodeDiedError(FeedoptError):
    """A node's process ended by itself.

    Args:
        message: cause with the end of the log.
        exit_code: its exit code; negative: the signal that killed it.
    """

    kind = FailureKind.NODE_DIED

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class GraphNotReadyError(FeedoptError):
    """Not every node said READY in time; the message names them."""


class GoalRefusedError(FeedoptError):
    """The toolpath node did not accept the goal."""


class ReplayInputError(BagError):
    """The bag lacks what a stage needs to run again; the message names it."""


class GoldenBagError(BagError):
    """A golden bag, or the manifest beside it, is not what it should be."""


class ExportError(FeedoptError):
    """A motion that cannot be exported as asked; the message names what is missing and the way out."""


class ReportError(FeedoptError):
    """A report that cannot be written; the message names the file and the cause."""


class ViewError(FeedoptError):
    """A run that cannot be drawn, or a viewer that cannot be started; the message names the way out."""
