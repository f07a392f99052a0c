"""Errors of the command and its parts; their base classes are those of core and recorder."""

from __future__ import annotations

from feedopt_core.errors import FailureKind, FeedoptError
from feedopt_recorder.errors import BagError


class NodeDiedError(FeedoptError):
    """The process of a node ended unexpectedly.

    Args:
        message: cause and the last lines of the log.
        exit_code: exit code of the process; negative: the signal that ended it.
    """

    kind = FailureKind.NODE_DIED

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class GraphNotReadyError(FeedoptError):
    """Not every node was READY in time; the message names those that were not."""


class GoalRefusedError(FeedoptError):
    """The toolpath node did not accept the goal."""


class ReplayInputError(BagError):
    """The bag does not contain an input of a stage that is to be replayed; the message names the input."""


class GoldenBagError(BagError):
    """A golden bag or its manifest is missing, invalid or inconsistent."""


class ExportError(FeedoptError):
    """A motion cannot be exported with the given options; the message names the cause and the remedy."""


class ReportError(FeedoptError):
    """A report cannot be written; the message names the file and the cause."""


class ViewError(FeedoptError):
    """A run cannot be drawn, or a viewer cannot be started; the message names the remedy."""
