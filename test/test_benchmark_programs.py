"""The benchmark of programs: what it writes, what it compares, and that a failure becomes a row."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from feedopt_core.machine.machine_file import load_machine
from feedopt_core.pipeline.read_program import open_program, read_moves
from feedopt_core.planner.stream_planner import PlannerParameters
from feedopt_core.programs.moves import LineMoves

WORKSPACE = Path(__file__).resolve().parents[1]


@pytest.fixture(autouse=True)
def _benchmarks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(WORKSPACE))


def module(name: str) -> ModuleType:
    return importlib.import_module(f"benchmark.programs.{name}")


def test_chords_are_read_as_they_were_written(tmp_path: Path) -> None:
    chords = module("chords")
    points_mm = chords.sampled(chords.fan_contour(), 5.0)
    assert np.allclose(points_mm[0], 0.0) and np.allclose(points_mm[-1], 0.0, atol=1e-9)
    path = tmp_path / "chords.ngc"
    chords.write_chords(path, points_mm, 5, laps=2)
    moves = [move for move in read_moves(open_program(path), "chords") if isinstance(move, LineMoves)]
    read_mm = np.concatenate([move.points_mm[:, :2] for move in moves])
    assert len(read_mm) == 2 * (len(points_mm) - 1)
    assert np.allclose(read_mm, np.tile(points_mm[1:], (2, 1)), atol=0.51e-5)


def test_every_scale_is_the_same_plan(tmp_path: Path) -> None:
    found = module("scales").run_scales(tmp_path, load_machine("case_a"), PlannerParameters(method="lp"), 0.01)
    lengths, counts, times = zip(*((length, count, motion.time_s) for _, length, count, motion in found), strict=True)
    assert len(set(counts)) == 1
    # In inches the coordinates are rounded to 1e-8 inch; the larger part is sampled as often as the small one.
    assert lengths == pytest.approx([lengths[0]] * 3, rel=1e-7)
    assert times == pytest.approx([times[0]] * 3, rel=1e-4)
    assert all(motion.holds and not motion.fallbacks for *_, motion in found)


def test_own_and_real_programs_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    catalogue, own = module("catalogue"), module("own")
    real = tmp_path / "real"
    real.mkdir()
    for name in ("part.ngc", "notes.md"):
        (real / name).write_text("G21 F600\nG1 X10\nM2\n", encoding="utf-8")
    monkeypatch.setenv("FEEDOPT_PROGRAMS", str(real))
    names = [name for name, _ in catalogue.all_programs(tmp_path)]
    assert names == [*own.OWN_PROGRAMS, "part.ngc"]


def test_a_program_that_cannot_be_read_is_a_row_with_its_place(tmp_path: Path) -> None:
    bench, planned = module("__main__"), module("planned")
    path = tmp_path / "broken.ngc"
    path.write_text("G21 F600\nG1 X1-0\n", encoding="utf-8")
    run = planned.run_program("broken", path, {2: load_machine("case_a")}, PlannerParameters(method="lp"), 0.01)
    assert run.survey is None and run.motion is None
    name, failure = bench.row_of(run)
    assert name == "broken"
    assert failure.startswith("ToolpathError: ") and "broken.ngc:2" in failure


def test_reading_counts_lines_and_segments(tmp_path: Path) -> None:
    chords = module("chords")
    path = tmp_path / "chords.ngc"
    chords.write_chords(path, chords.sampled(chords.fan_contour(), 0.5), 4)
    figures = module("reading").measure_reading(path, path, 0.01)
    assert figures.lines == len(path.read_text(encoding="utf-8").splitlines())
    assert figures.segments > 0
    assert figures.memory_mb >= figures.start_mb > 0.0
