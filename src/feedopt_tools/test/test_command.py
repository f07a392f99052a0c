"""The command: help, exit codes, files."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from feedopt_core.errors import ConfigError, FeedoptError, InfeasibleLimitsError, SolverError, ToolpathError
from feedopt_node.errors import SecondGraphError
from feedopt_tools.command.exit_codes import exit_code
from feedopt_tools.command.main import _COMMANDS, main
from feedopt_tools.command.options import planner_parameters, run_directory
from feedopt_tools.command.program.plan import write_setpoints
from feedopt_tools.command.upkeep import machine_checks
from feedopt_tools.command.upkeep.bench import benchmark_names
from feedopt_tools.command.upkeep.test import STAGES

PROGRAM = "x_mm,y_mm\n0,0\n4,1\n8,0\n10,3\n"


def feedopt(*arguments: str) -> Result:
    return CliRunner().invoke(main, arguments, prog_name="feedopt")


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.csv"
    path.write_text(PROGRAM, encoding="utf-8")
    return path


def test_help_lists_every_command_and_imports_none() -> None:
    code = (
        "import sys; from feedopt_tools.command.main import main; main(['--help'], standalone_mode=False); "
        "sys.exit(any(name in sys.modules for name in ('numpy', 'rclpy', 'rerun', 'rich')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(f"  {name} " in done.stdout for name in _COMMANDS)
    assert "Exit codes: 0 success, 1 failure, 2" in done.stdout


@pytest.mark.parametrize("name", sorted(_COMMANDS.keys() - {"bench"}))
def test_every_command_has_help(name: str) -> None:
    result = feedopt(name, "--help")
    assert result.exit_code == 0
    assert f"feedopt {name}" in result.output


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ConfigError("x"), 2),
        (ToolpathError("x"), 2),
        (InfeasibleLimitsError("x", quantity="jerk", axis="X", s_mm=0.0, ratio=2.0), 2),
        (SolverError("x"), 1),
        (SecondGraphError("x"), 3),
    ],
)
def test_exit_codes(error: FeedoptError, code: int) -> None:
    assert exit_code(error.kind) == code


def test_plan_writes_set_points_and_report(program: Path, tmp_path: Path) -> None:
    setpoints, report = tmp_path / "setpoints.csv", tmp_path / "report.json"
    result = feedopt("plan", str(program), "--setpoints", str(setpoints), "--report", str(report))
    assert result.exit_code == 0, result.output
    rows = list(csv.reader(setpoints.open(encoding="utf-8")))
    assert rows[0] == ["t_s", "s_mm", "feedrate_mm_s", "x_mm", "y_mm", "z_mm"]
    values = np.array(rows[1:], dtype=float)
    np.testing.assert_allclose(np.diff(values[:, 0]), 0.001, rtol=1e-9)
    np.testing.assert_allclose(values[[0, -1], 3:], [[0.0, 0.0, 0.0], [10.0, 3.0, 0.0]], atol=1e-9)
    assert np.all(values[[0, -1], 2] == 0.0)
    document = json.loads(report.read_text(encoding="utf-8"))
    assert document.keys() >= {
        "motion_time_s",
        "compute_time_s",
        "first_chunk_s",
        "path_length_mm",
        "method",
        "windows",
        "audit",
    }
    assert document["audit_holds"] is True
    assert {row["grid"] for row in document["audit"]} == {"fine", "set points"}
    assert values[-1, 0] == pytest.approx(document["motion_time_s"], abs=0.001)
    assert values[-1, 1] == pytest.approx(document["path_length_mm"], rel=1e-12)


@pytest.mark.parametrize(("option", "begin"), [("--report", "{"), ("--setpoints", "t_s,s_mm,")])
def test_dash_is_standard_output(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: str, begin: str
) -> None:
    """Nothing else is written there: the line about the plan goes to standard error."""
    monkeypatch.chdir(tmp_path)
    result = feedopt("plan", str(program.absolute()), option, "-")
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith(begin) and "planned in" not in result.stdout
    assert "planned in" in result.stderr
    assert not (tmp_path / "-").exists()


def test_set_points_keep_their_digits(tmp_path: Path) -> None:
    from feedopt_core.pipeline.plan_program import Setpoints

    rng = np.random.default_rng(1)
    row = rng.uniform(-1e3, 1e3, 50)
    setpoints = Setpoints(np.arange(50), row, row, row, np.stack([row, row], 1), np.stack([row, row, row], 1))
    write_setpoints(tmp_path / "s.csv", setpoints)
    again = np.loadtxt(tmp_path / "s.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(again, np.tile(row, (6, 1)).T, rtol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("{none}",), "cannot be read"),
        (("{bad}",), "bad.csv:2:3: 'one' is not a number"),
        (("{program}", "--machine", "none"), "neither a file nor one of the names in machines"),
        (("{program}", "--method", "none"), "method 'none' is unknown"),
        (("{program}", "--report", "{none}/r.json"), "cannot be written"),
    ],
)
def test_what_cannot_be_used_is_one_message_and_code_2(
    program: Path, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("0,0\n1,one\n", encoding="utf-8")
    places = {"program": program, "bad": bad, "none": tmp_path / "none.csv"}
    result = feedopt("plan", *(text.format(**places) for text in arguments))
    assert result.exit_code == 2
    assert message in result.output
    assert "Traceback" not in result.output


def test_an_unknown_benchmark_is_refused() -> None:
    result = feedopt("bench", "none")
    assert result.exit_code == 2
    assert "benchmark 'none' is unknown" in result.output


def test_benchmarks_are_modules_and_packages(tmp_path: Path) -> None:
    (tmp_path / "peers").mkdir()
    (tmp_path / "peers" / "__main__.py").touch()
    (tmp_path / "kernels.py").touch()
    (tmp_path / "__init__.py").touch()
    (tmp_path / "notes.md").touch()
    assert benchmark_names(tmp_path) == ("kernels", "peers")
    assert benchmark_names(tmp_path / "none") == ()


def test_a_run_never_overwrites(tmp_path: Path) -> None:
    assert run_directory(tmp_path / "new", "x.csv") == tmp_path / "new"
    assert run_directory(tmp_path, "x.csv") == tmp_path
    (tmp_path / "old").touch()
    with pytest.raises(ConfigError, match="not an empty folder"):
        run_directory(tmp_path, "x.csv")
    with pytest.raises(ConfigError, match="not an empty folder"):
        run_directory(tmp_path / "old", "x.csv")


def test_runs_get_a_folder_of_their_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FEEDOPT_ROOT", str(tmp_path))
    directory = run_directory(None, "fan_contour.csv")
    assert directory.parent == tmp_path / "runs"
    assert directory.name.endswith("_fan_contour")


def test_the_planner_has_the_parameters_of_its_file() -> None:
    assert planner_parameters("").method == "lp_nlp"
    assert planner_parameters("lp").method == "lp"


def test_checks_come_in_the_order_of_their_cost() -> None:
    titles = [title for title, _ in STAGES]
    assert [title.split()[0] for title in titles] == ["style", "format", "types", "imports", "unit", "graph"]


@pytest.mark.parametrize(
    ("version", "verdict"), [((3, 11), "ok"), ((3, 12), "ok"), ((3, 10), "missing"), ((3, 13), "missing")]
)
def test_doctor_knows_the_pythons(version: tuple[int, int], verdict: str) -> None:
    check = machine_checks.check_python(version)
    assert check.verdict == verdict
    assert bool(check.way_out) == (verdict != "ok")


@pytest.mark.parametrize(
    ("domain", "verdict"), [("", "ok"), ("97", "ok"), ("102", "missing"), ("-1", "missing"), ("x", "missing")]
)
def test_doctor_checks_the_domain(monkeypatch: pytest.MonkeyPatch, domain: str, verdict: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    monkeypatch.setattr(machine_checks, "domain_id", lambda: 99)
    assert machine_checks.check_domain(domain).verdict == verdict


def test_doctor_has_a_way_out_for_everything_it_finds_missing() -> None:
    for check in machine_checks.all_checks():
        assert check.found
        assert check.verdict != "missing" or check.way_out
