"""Every error a caller may want to tell apart, and the value that it becomes where it leaves its process.

An error is raised; a :class:`Failure` is handed on, from node to node and to the client. Both read the same, and their
text is made here alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar


class FailureKind(IntEnum):
    """What failed. The numbers are those of ``feedopt_msgs/msg/Failure``."""

    PROGRAM = 1
    """The program cannot be used: source, line and column name the place."""
    INFEASIBLE = 2
    """No motion within the limits exists: axis, quantity, arc length and ratio name the limit."""
    SOLVER = 3
    """An optimiser ended without a usable solution."""
    CONFIG = 4
    """A machine file, a parameter or the installation cannot be used."""
    SEQUENCE_GAP = 5
    """A message of a stream was lost."""
    SECOND_GRAPH = 6
    """Another graph runs on this ROS domain."""
    SILENT_PEER = 7
    """A node that was there says nothing any more."""
    NODE_DIED = 8
    """The process of a node ended, or was told to end, before its program did."""
    BAG = 9
    """A recorded bag cannot be used."""
    RECORDING = 10
    """A bag cannot be written any further."""
    CANCELED = 11
    """The client asked for a stop."""
    INTERNAL = 12
    """Not raised on purpose: the message begins with the type of the exception."""
    OTHER = 13
    """Raised on purpose, and none of the kinds above."""


# The one who wrote the program or gave the order has no use for the node that noticed.
_NODE_OF_NO_USE = (FailureKind.PROGRAM, FailureKind.INFEASIBLE, FailureKind.CANCELED)


@dataclass(frozen=True, kw_only=True)
class Failure:
    """What went wrong, as a value. Its text is ``str(failure)``.

    Attributes:
        kind: what failed.
        message: cause and way out, without what the other fields say.
        node: node it arose in; empty: in none, or not said.
        source: file name of the program; empty: none.
        line, column: of the program, from 1; 0: none.
        axis: name of the axis; empty: the path itself, or none.
        quantity: the limited quantity (velocity, acceleration, jerk, control, tracking_error, feedrate); empty: none.
        s_mm: arc length where it fails; None: not at one place.
        ratio: what is needed, over the limit; None: no limit is concerned.
    """

    kind: FailureKind
    message: str
    node: str = ""
    source: str = ""
    line: int = 0
    column: int = 0
    axis: str = ""
    quantity: str = ""
    s_mm: float | None = None
    ratio: float | None = None

    def __str__(self) -> str:
        node = "" if self.kind in _NODE_OF_NO_USE else self.node
        label = "internal error" if self.kind is FailureKind.INTERNAL else ""
        place = ":".join(str(part) for part in (self.source, self.line, self.column) if part)
        return ": ".join(filter(None, (node, label, place, self._limit(), self.message)))

    def _limit(self) -> str:
        axis = f"axis {self.axis}" if self.axis else ""
        at = "" if self.s_mm is None else f"at s = {self.s_mm:.3f} mm"
        broken = "" if self.ratio is None else f"{self.quantity} at {self.ratio:.3f} times its limit"
        return ", ".join(filter(None, (" ".join(filter(None, (axis, at))), broken)))


class FeedoptError(Exception):
    """Root of all errors raised on purpose by feedopt.

    Args:
        message: cause and way out, without what other arguments of a subclass say.
    """

    kind: ClassVar[FailureKind] = FailureKind.OTHER

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.message = message

    def failure(self) -> Failure:
        """The error as a value."""
        return Failure(kind=self.kind, message=self.message)

    def __str__(self) -> str:
        return str(self.failure())


class ConfigError(FeedoptError):
    """A machine or parameter file that cannot be used; the message names file, key and axis."""

    kind = FailureKind.CONFIG


class ToolpathError(FeedoptError):
    """A program or a path that cannot be used.

    Args:
        message: cause and way out.
        source: file name of the program, empty where there is none.
        line: line of the program, from 1; 0 where there is none.
        column: column of the program, from 1; 0 where there is none.
    """

    kind = FailureKind.PROGRAM

    def __init__(self, message: str, *, source: str = "", line: int = 0, column: int = 0) -> None:
        super().__init__(message)
        self.source = source
        self.line = max(0, line)
        self.column = max(0, column)

    def failure(self) -> Failure:
        """The error as a value, with its place."""
        return Failure(kind=self.kind, message=self.message, source=self.source, line=self.line, column=self.column)


class InfeasibleLimitsError(FeedoptError):
    """No motion within the limits exists.

    Args:
        message: cause and way out.
        quantity: the limited quantity (velocity, acceleration, jerk, control, tracking_error, feedrate).
        axis: name of the axis, empty for the path itself.
        s_mm: arc length where it fails; None: anywhere on the path.
        ratio: by how much, as the ratio of what is needed to the limit.
    """

    kind = FailureKind.INFEASIBLE

    def __init__(self, message: str, *, quantity: str, axis: str, s_mm: float | None, ratio: float) -> None:
        super().__init__(message)
        self.quantity = quantity
        self.axis = axis
        self.s_mm = s_mm
        self.ratio = ratio

    def failure(self) -> Failure:
        """The error as a value, with the limit."""
        return Failure(
            kind=self.kind,
            message=self.message,
            quantity=self.quantity,
            axis=self.axis,
            s_mm=self.s_mm,
            ratio=self.ratio,
        )


class SolverError(FeedoptError):
    """An optimiser ended without a usable solution; the message names the window and the reason."""

    kind = FailureKind.SOLVER


def failure_of(error: Exception) -> Failure:
    """Any exception as a value; one that was not raised on purpose is INTERNAL and named by its type."""
    if isinstance(error, FeedoptError):
        return error.failure()
    return Failure(kind=FailureKind.INTERNAL, message=f"{type(error).__name__}: {error}")
