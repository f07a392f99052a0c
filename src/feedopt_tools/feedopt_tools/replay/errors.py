"""What can keep a bag from being replayed."""

from __future__ import annotations

from feedopt_recorder.bags.errors import BagError


class ReplayInputError(BagError):
    """The bag lacks what a stage needs to run again; the message names it."""


class GoldenBagError(BagError):
    """A golden bag, or the manifest beside it, is not what it should be."""
