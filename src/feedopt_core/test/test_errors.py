"""Errors as values, and the text that is made of them."""

from __future__ import annotations

import pytest

from feedopt_core.errors import (
    ConfigError,
    Failure,
    FailureKind,
    FeedoptError,
    InfeasibleLimitsError,
    SolverError,
    ToolpathError,
    failure_of,
)

JERK = InfeasibleLimitsError("raise jerk_limit_mm_s3", quantity="jerk", axis="X", s_mm=12.5, ratio=1.25)


@pytest.mark.parametrize(
    ("error", "failure"),
    [
        (
            ToolpathError("odd", source="a.csv", line=3, column=7),
            Failure(kind=FailureKind.PROGRAM, message="odd", source="a.csv", line=3, column=7),
        ),
        (ToolpathError("odd", line=-1), Failure(kind=FailureKind.PROGRAM, message="odd")),
        (
            JERK,
            Failure(
                kind=FailureKind.INFEASIBLE,
                message="raise jerk_limit_mm_s3",
                axis="X",
                quantity="jerk",
                s_mm=12.5,
                ratio=1.25,
            ),
        ),
        (ConfigError("no file"), Failure(kind=FailureKind.CONFIG, message="no file")),
        (SolverError("window 3"), Failure(kind=FailureKind.SOLVER, message="window 3")),
        (FeedoptError("else"), Failure(kind=FailureKind.OTHER, message="else")),
        (
            ZeroDivisionError("by zero"),
            Failure(kind=FailureKind.INTERNAL, message="ZeroDivisionError: by zero"),
        ),
    ],
)
def test_every_error_is_a_value(error: Exception, failure: Failure) -> None:
    assert failure_of(error) == failure


@pytest.mark.parametrize(
    ("failure", "text"),
    [
        (failure_of(ToolpathError("odd", source="a.csv", line=3, column=7)), "a.csv:3:7: odd"),
        (failure_of(ToolpathError("odd", line=3)), "3: odd"),
        (failure_of(ToolpathError("odd")), "odd"),
        (failure_of(JERK), "axis X at s = 12.500 mm, jerk at 1.250 times its limit: raise jerk_limit_mm_s3"),
        (
            Failure(kind=FailureKind.INFEASIBLE, message="slower", quantity="feedrate", s_mm=2.0, ratio=1.5),
            "at s = 2.000 mm, feedrate at 1.500 times its limit: slower",
        ),
        (
            failure_of(InfeasibleLimitsError("weak", quantity="control", axis="Y", s_mm=None, ratio=2.0)),
            "axis Y, control at 2.000 times its limit: weak",
        ),
        (failure_of(ZeroDivisionError("by zero")), "internal error: ZeroDivisionError: by zero"),
        (Failure(kind=FailureKind.SILENT_PEER, message="is silent", node="planner"), "planner: is silent"),
        (Failure(kind=FailureKind.PROGRAM, message="odd", node="planner", line=3), "3: odd"),
    ],
)
def test_text(failure: Failure, text: str) -> None:
    assert str(failure) == text


def test_an_error_reads_as_its_value() -> None:
    assert str(JERK) == str(JERK.failure())
