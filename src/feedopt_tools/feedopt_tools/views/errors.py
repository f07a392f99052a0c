"""What can go wrong when a run is to be looked at."""

from __future__ import annotations

from feedopt_core.errors import FeedoptError


class ViewError(FeedoptError):
    """A run that cannot be drawn, or a viewer that cannot be started; the message names the way out."""
