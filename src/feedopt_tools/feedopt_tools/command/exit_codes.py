"""Exit codes of the command."""

from __future__ import annotations

from feedopt_core.errors import ConfigError, FeedoptError, InfeasibleLimitsError, ToolpathError
from feedopt_node.errors import SecondGraphError
from feedopt_recorder.errors import BagError, BagWriteError

OK = 0
FAILURE = 1
UNUSABLE_INPUT = 2
SECOND_GRAPH = 3


def exit_code(error: FeedoptError) -> int:
    """Exit code for an error: what the user gave cannot be used, a second graph, or a failure."""
    if isinstance(error, SecondGraphError):
        return SECOND_GRAPH
    if isinstance(error, BagError) and not isinstance(error, BagWriteError):
        return UNUSABLE_INPUT
    if isinstance(error, (ConfigError, ToolpathError, InfeasibleLimitsError)):
        return UNUSABLE_INPUT
    return FAILURE
