"""What can go wrong when a motion is exported."""

from __future__ import annotations

from feedopt_core.errors import FeedoptError


class ExportError(FeedoptError):
    """A motion that cannot be exported as asked; the message names what is missing and the way out."""
