"""Every error a caller may want to tell apart. All name the cause, the place and the way out."""

from __future__ import annotations


class FeedoptError(Exception):
    """Root of all errors raised on purpose by feedopt."""


class ConfigError(FeedoptError):
    """A machine or parameter file that cannot be used; the message names file, key and axis."""


class ToolpathError(FeedoptError):
    """A program or a path that cannot be used.

    Args:
        message: cause and way out.
        source: file name of the program, empty where there is none.
        line: line of the program, from 1; 0 where there is none.
        column: column of the program, from 1; 0 where there is none.
    """

    def __init__(self, message: str, *, source: str = "", line: int = 0, column: int = 0) -> None:
        super().__init__(message)
        self.message = message
        self.source = source
        self.line = line
        self.column = column

    def __str__(self) -> str:
        place = [self.source] if self.source else []
        place += [str(number) for number in (self.line, self.column) if number > 0]
        return f"{':'.join(place)}: {self.message}" if place else self.message


class InfeasibleLimitsError(FeedoptError):
    """No motion within the limits exists.

    Args:
        message: cause and way out.
        quantity: the limited quantity (velocity, acceleration, jerk, control, tracking_error, feedrate).
        axis: name of the axis, empty for the path itself.
        s_mm: arc length where it fails.
        margin: by how much, as the ratio of what is needed to the limit.
    """

    def __init__(self, message: str, *, quantity: str, axis: str, s_mm: float, margin: float) -> None:
        super().__init__(message)
        self.quantity = quantity
        self.axis = axis
        self.s_mm = s_mm
        self.margin = margin


class SolverError(FeedoptError):
    """An optimiser ended without a usable solution; the message names the window and the reason."""
