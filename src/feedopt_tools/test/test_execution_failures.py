"""Failures at the end of their way: exit code and printed text of a run."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from feedopt_core.errors import Failure, FailureKind, SolverError
from feedopt_tools.command.graph.run import execution_exit_code, show_execution
from feedopt_tools.execute.client import ProgramOutcome
from feedopt_tools.execute.execution import Execution

CODES = {
    FailureKind.PROGRAM: 2,
    FailureKind.INFEASIBLE: 2,
    FailureKind.SOLVER: 1,
    FailureKind.CONFIG: 2,
    FailureKind.SEQUENCE_GAP: 1,
    FailureKind.SECOND_GRAPH: 3,
    FailureKind.SILENT_PEER: 1,
    FailureKind.NODE_DIED: 1,
    FailureKind.BAG: 2,
    FailureKind.RECORDING: 1,
    FailureKind.CANCELED: 1,
    FailureKind.INTERNAL: 1,
    FailureKind.OTHER: 1,
}


def ended(failure: Failure | None) -> Execution:
    outcome = ProgramOutcome(failure=failure, program_id=1, segments=3, path_length_mm=12.0, motion_time_s=0.5)
    return Execution(bag=Path("recording"), outcome=outcome)


@pytest.mark.parametrize("kind", FailureKind)
def test_the_exit_code_follows_the_kind_whatever_the_text(kind: FailureKind) -> None:
    assert execution_exit_code(ended(Failure(kind=kind, message="infeasible: program: "))) == CODES[kind]


def test_a_whole_program_ends_with_0_unless_a_node_failed() -> None:
    execution = ended(None)
    assert execution_exit_code(execution) == 0
    execution.exit_codes = {"planner": 1}
    assert execution_exit_code(execution) == 1


def test_what_ended_the_run_early_is_raised_again() -> None:
    with pytest.raises(SolverError, match="window 3"):
        execution_exit_code(Execution(bag=Path("recording"), failure=SolverError("window 3")))


def test_the_text_is_printed_as_it_is() -> None:
    failure = Failure(kind=FailureKind.PROGRAM, message="[O100] is odd", source="a.ngc", line=3, column=7)
    console = Console(file=io.StringIO(), width=200)
    show_execution(console, ended(failure))
    assert isinstance(console.file, io.StringIO)
    assert "a.ngc:3:7: [O100] is odd" in console.file.getvalue()
