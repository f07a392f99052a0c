"""What can go wrong when a report is made."""

from __future__ import annotations

from feedopt_core.errors import FeedoptError


class ReportError(FeedoptError):
    """A report that cannot be written; the message names the file and the cause."""
