"""What can be wrong with a bag, read or written."""

from __future__ import annotations

from feedopt_core.errors import FailureKind, FeedoptError


class BagError(FeedoptError):
    """Root of every error about a recorded bag; the message names the file and the way out."""

    kind = FailureKind.BAG


class BagMissingError(BagError):
    """There is no bag where one was named."""


class BagEmptyError(BagError):
    """The bag holds no message, or none of the topics that were asked for."""


class BagTruncatedError(BagError):
    """The file ends before its footer, or a record inside it is damaged."""


class BagForeignError(BagError):
    """The file is no MCAP, or holds other messages than those of feedopt."""


class BagWriteError(BagError):
    """The bag cannot be created or written any further; what could be saved was saved."""

    kind = FailureKind.RECORDING


class BagDefinitionError(BagForeignError):
    """A message of the bag has another definition than in this version, and no rule leads from one to the other."""
