"""What a fault says on ``/status``, so that the node that answers the client can tell its kinds apart."""

from __future__ import annotations

from feedopt_core.errors import FeedoptError, InfeasibleLimitsError, ToolpathError

INFEASIBLE_PREFIX = "infeasible: "
PROGRAM_PREFIX = "program: "


def fault_text(error: Exception) -> str:
    """Text of a FAULT. An error that was not raised on purpose is named with its type."""
    if isinstance(error, InfeasibleLimitsError):
        return f"{INFEASIBLE_PREFIX}{error}"
    if isinstance(error, ToolpathError):
        return f"{PROGRAM_PREFIX}{error}"
    if isinstance(error, FeedoptError):
        return str(error)
    return f"internal error {type(error).__name__}: {error}"
