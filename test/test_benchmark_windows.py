"""Random windows of the benchmark: none is without a plan, and none breaks a limit."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

from feedopt_core.motion.certificate import ALLOWED_RATIO

ROOT = Path(__file__).parents[1]


@pytest.fixture
def windows(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    return importlib.import_module("benchmark.windows")


@pytest.mark.parametrize(("method", "cases"), [("lp_nlp", 24), ("lp", 8)])
def test_every_random_window_has_a_plan_that_holds(windows, method: str, cases: int) -> None:
    tally = windows.Tally()
    for index in range(cases):
        windows.run_case(windows.random_case(1, index, method), tally, f"case {index}")
    assert tally.failures == []
    assert tally.windows > 8 * cases
    assert sum(tally.solvers.values()) == tally.windows
    assert tally.worst_ratio <= ALLOWED_RATIO


def test_a_case_is_made_of_its_numbers_alone(windows) -> None:
    first, again, other = (windows.random_case(3, index, "lp_nlp") for index in (5, 5, 6))
    assert (first.machine, first.parameters) == (again.machine, again.parameters)
    assert first.machine != other.machine


def test_command_line_counts_windows(windows, capsys: pytest.CaptureFixture[str]) -> None:
    assert windows.main(["--windows", "5"]) == 0
    assert "windows planned by nlp" in capsys.readouterr().out
