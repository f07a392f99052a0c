"""An installation without viewers, as a controller has it: what still works, and what the other commands say."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from recorded_run import write_run

from feedopt_tools.command.extras import EXTRA_OF_MODULE, missing_extra

REQUIREMENTS = Path(__file__).resolve().parents[3] / "requirements"
VIEWERS = sorted(module for module, extra in EXTRA_OF_MODULE.items() if extra == "view")


def feedopt_without_viewers(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the command in a process where no viewer can be imported."""
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({VIEWERS}))\nfrom feedopt_tools.command.main import main; main()"
    )
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("extras")
    return write_run(folder / "run", folder / "share", duration_s=0.5)


def listed(extra: str) -> set[str]:
    lines = (REQUIREMENTS / f"{extra}.in").read_text(encoding="utf-8").splitlines()
    return {line.lower() for line in lines if line and not line.startswith("#")}


@pytest.mark.parametrize("extra", ["view", "test"])
def test_modules_of_an_extra_are_those_of_its_requirements(extra: str) -> None:
    distributions = packages_distributions()
    for module in (module for module, of in EXTRA_OF_MODULE.items() if of == extra):
        assert {name.lower() for name in distributions[module]} <= listed(extra)


def test_every_viewer_in_the_requirements_is_known() -> None:
    distributions = packages_distributions()
    assert {name.lower() for module in VIEWERS for name in distributions[module]} == listed("view")


def test_module_of_no_extra_is_an_error_of_ours() -> None:
    assert missing_extra("feedopt_core.no_such_module") is None
    assert missing_extra("") is None


@pytest.mark.parametrize(
    "arguments",
    [
        ["plan", "PROGRAM", "--report"],
        ["toolpath", "PROGRAM", "--json"],
        ["export", "PROGRAM", "--format", "csv", "--out"],
    ],
)
def test_programs_are_planned_without_viewers(arguments: list[str], tmp_path: Path) -> None:
    program = tmp_path / "tiny.csv"
    program.write_text("x_mm,y_mm\n0,0\n4,1\n8,0\n10,3\n", encoding="utf-8")
    command = [str(program) if argument == "PROGRAM" else argument for argument in arguments]
    done = feedopt_without_viewers(*command, tmp_path / "out")
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "out").stat().st_size > 0


def test_recordings_are_read_without_viewers(bag: Path) -> None:
    done = feedopt_without_viewers("bag", "info", bag)
    assert done.returncode == 0, done.stdout + done.stderr


def test_doctor_says_that_viewers_are_left_out() -> None:
    done = feedopt_without_viewers("doctor")
    assert "the extra view is not installed" in done.stdout
    assert "FEEDOPT_EXTRAS=view,test" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "module"),
    [
        (["demo", "--out", "OUT"], "matplotlib"),
        (["view", "BAG", "--save", "OUT"], "rerun"),
        (["view", "BAG", "--screenshot", "OUT"], "matplotlib"),
        (["report", "BAG", "--out", "OUT"], "matplotlib"),
        (["live", "--save", "OUT"], "rerun"),
        (["export", "BAG", "--format", "parquet", "--out", "OUT"], "pyarrow"),
    ],
)
def test_a_command_that_draws_names_what_is_missing(
    arguments: list[str], module: str, bag: Path, tmp_path: Path
) -> None:
    places = {"BAG": str(bag), "OUT": str(tmp_path / "out")}
    done = feedopt_without_viewers(*(places.get(argument, argument) for argument in arguments))
    assert done.returncode == 2, done.stdout + done.stderr
    assert f"feedopt: {module} is not installed" in done.stderr
    assert "the extra view: run FEEDOPT_EXTRAS=view,test ./feedopt once" in done.stderr
    assert not (tmp_path / "out").exists()
