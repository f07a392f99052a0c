"""Texts of faults that tell their kinds apart."""

from __future__ import annotations

import pytest

from feedopt_core.errors import ConfigError, InfeasibleLimitsError, ToolpathError
from feedopt_node.faults import INFEASIBLE_PREFIX, PROGRAM_PREFIX, fault_text


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (InfeasibleLimitsError("jerk", quantity="jerk", axis="X", s_mm=1.0, margin=2.0), f"{INFEASIBLE_PREFIX}jerk"),
        (ToolpathError("gap", line=3), f"{PROGRAM_PREFIX}3: gap"),
        (ConfigError("no file"), "no file"),
        (ZeroDivisionError("by zero"), "internal error ZeroDivisionError: by zero"),
    ],
)
def test_fault_text(error: Exception, text: str) -> None:
    assert fault_text(error) == text
