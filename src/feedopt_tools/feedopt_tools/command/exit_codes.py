"""Exit codes of the command."""

from __future__ import annotations

from feedopt_core.errors import FailureKind

OK = 0
FAILURE = 1
UNUSABLE_INPUT = 2
SECOND_GRAPH = 3

_UNUSABLE_INPUT = (FailureKind.PROGRAM, FailureKind.INFEASIBLE, FailureKind.CONFIG, FailureKind.BAG)


def exit_code(kind: FailureKind) -> int:
    """Exit code for a failure: one for invalid input of the user, one for a second graph, one for all others."""
    if kind is FailureKind.SECOND_GRAPH:
        return SECOND_GRAPH
    return UNUSABLE_INPUT if kind in _UNUSABLE_INPUT else FAILURE
