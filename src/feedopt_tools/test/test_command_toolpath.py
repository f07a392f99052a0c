"""``feedopt toolpath``: figures, files, pictures, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from feedopt_core.pipeline.survey import survey_program
from feedopt_tools.command.main import main
from feedopt_tools.views.signals.survey_scene import survey_rows, survey_scene

# A quarter of a circle, then two sides of a square: two corners.
PROGRAM = """{"feed_mm_s": 50, "curves": [
 {"degree": 2, "knots": [0, 0, 0, 1, 1, 1], "control_points_mm": [[10, 0], [10, 10], [0, 10]],
  "weights": [1, 0.7071067811865476, 1]},
 {"degree": 1, "knots": [0, 0, 1, 2, 2], "control_points_mm": [[0, 10], [0, 0], [10, 0]]}]}
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "quarter.json"
    path.write_text(PROGRAM, encoding="utf-8")
    return path


def called(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["toolpath", *(str(argument) for argument in arguments)])


def test_figures_are_shown_and_written(program: Path, tmp_path: Path) -> None:
    report = tmp_path / "figures.json"
    result = called(program, "--json", report)
    assert result.exit_code == 0, result.output
    assert "2 straight, 1 NURBS" in result.output and "50 mm/s" in result.output
    figures = json.loads(report.read_text(encoding="utf-8"))
    assert figures["length_mm"] == pytest.approx(5.0 * np.pi + 20.0, abs=0.1)
    assert figures["corners"] == 2
    assert figures["deviation_ratio"] == pytest.approx(1.0, abs=0.01)


def test_dash_is_standard_output(program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = called(program, "--json", "-")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["corners"] == 2
    assert "2 straight, 1 NURBS" in result.stderr
    assert not (tmp_path / "-").exists()


@pytest.mark.parametrize("options", [("--save", "q.rrd"), ("--screenshot", "q.png"), ("--view", "--save", "q.rrd")])
def test_files_are_named_on_standard_error_beside_figures_on_standard_output(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    result = called(program, "--json", "-", *options)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["corners"] == 2
    assert options[-1] in result.stderr and Path(options[-1]).is_file()


def test_straight_program_gives_valid_json(tmp_path: Path) -> None:
    path, report = tmp_path / "line.json", tmp_path / "figures.json"
    path.write_text('{"curves": [{"degree": 1, "knots": [0, 0, 1, 1], "control_points_mm": [[0, 0], [9, 0]]}]}')
    assert called(path, "--json", report).exit_code == 0
    assert "Infinity" not in report.read_text(encoding="utf-8")
    assert json.loads(report.read_text(encoding="utf-8"))["smallest_radius_mm"] is None


def test_machine_gives_the_coordinates(program: Path, tmp_path: Path) -> None:
    assert called(program, "--machine", "router_heng").exit_code == 0
    deep = tmp_path / "deep.json"
    deep.write_text(PROGRAM.replace("[0, 10], [0, 0], [10, 0]", "[0, 10, 0], [0, 0, 1], [10, 0, 1]"))
    assert called(deep).exit_code == 0
    refused = called(deep, "--machine", "case_a")
    assert refused.exit_code == 2
    assert "no axis for it" in refused.stderr


def test_recording_is_saved_and_hinted_at(program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    saved = tmp_path / "quarter.rrd"
    result = called(program, "--save", saved, "--view")
    assert result.exit_code == 0, result.output
    assert saved.stat().st_size > 10_000
    assert f"rerun {saved.name}" in result.output


def test_picture_by_matplotlib_where_rerun_cannot_draw(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from feedopt_tools.errors import ViewError
    from feedopt_tools.views import picture

    def no_driver(*_: object) -> None:
        raise ViewError("no Vulkan driver")

    monkeypatch.setattr(picture, "draw_by_rerun", no_driver)
    drawn = tmp_path / "quarter.png"
    result = called(program, "--screenshot", drawn)
    assert result.exit_code == 0, result.output
    assert "by matplotlib (no Vulkan driver)" in result.output
    # A blank page of this size takes 4 kB.
    assert drawn.stat().st_size > 10_000


@pytest.mark.parametrize("name", ["missing.ngc", "program.xyz"])
def test_what_cannot_be_read_is_refused_by_name(tmp_path: Path, name: str) -> None:
    result = called(tmp_path / name)
    assert result.exit_code == 2
    assert name in result.stderr


def test_curves_along_the_path_have_no_slope_across_a_peak(program: Path) -> None:
    """What is drawn small joins the extremes of neighbours: samples far apart would show a peak as a slope."""
    scene = survey_scene("quarter", survey_program(program))
    assert scene.deviation is not None
    for s_mm in (scene.s_mm, scene.deviation.s_mm):
        assert np.all(np.diff(s_mm) >= 0.0)
        assert np.max(np.diff(s_mm)) < 1e-3 * s_mm[-1]
    assert np.max(scene.curvature_per_mm) == scene.figures.largest_curvature_per_mm == np.max(scene.peak_per_mm)
    assert len(scene.segment_s_mm) == len(scene.strips_mm) + 1 == len(scene.feed_mm_s)
    assert dict(survey_rows(scene.figures))["programmed feed"] == "50 mm/s"
