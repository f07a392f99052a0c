"""Exported motions: G-code that is read back, set points, trajectories and states."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
import yaml
from click.testing import CliRunner
from recorded_run import MACHINE_YAML, write_run

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.segments import PlanarSegment, SegmentKind, SegmentPlace
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import parse_machine
from feedopt_core.pipeline.read_program import Program, ProgramKind, read_moves
from feedopt_core.programs.moves import LineMoves, ProgramEvent
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.bags.run_data import RunData
from feedopt_tools.command.main import main
from feedopt_tools.errors import ExportError
from feedopt_tools.export.chords import chord_deviation_mm, chord_ends_mm
from feedopt_tools.export.gcode import GcodeSettings, write_gcode
from feedopt_tools.export.joint_trajectory import joint_trajectory_yaml
from feedopt_tools.export.motion import Motion, motion_of_run
from feedopt_tools.export.samples import rows_every, setpoint_table, state_table

RADIUS_MM = 20.0
LINE_MM = 30.0
ARC_MM = RADIUS_MM * math.pi / 2
MACHINE = parse_machine(MACHINE_YAML, "test")


def toolpath(**second: object) -> Toolpath:
    """A straight line of 30 mm along x, then a quarter of a circle to the left; joined smoothly enough to look at."""
    path = Toolpath()
    x, y, none = np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros(2)
    path.append(
        PlanarSegment(SegmentKind.LINE, SegmentPlace(1, 1, 0.0), LINE_MM, np.array([5.0, 0.0]), x, y, none, 0.0, 0.0)
    )
    place = SegmentPlace(2, 2, LINE_MM, last=True, **second)  # type: ignore[arg-type]
    start = np.array([5.0 + LINE_MM, 0.0])
    path.append(PlanarSegment(SegmentKind.ARC, place, ARC_MM, start, x, y, none, 1.0 / RADIUS_MM, 0.0))
    return path


def motion(path: Toolpath | None = None) -> Motion:
    """The whole path in 2 s with a feed of a raised cosine, from rest to rest."""
    path = path or toolpath()
    tick = np.arange(2001)
    tau = tick / 2000.0
    s = path.end_mm * (tau - np.sin(2 * np.pi * tau) / (2 * np.pi))
    v = path.end_mm / 2.0 * (1 - np.cos(2 * np.pi * tau))
    points = path.evaluate(s)
    a = path.end_mm * np.pi / 2.0 * np.sin(2 * np.pi * tau)
    velocity = points.dr_ds * v[:, None]
    acceleration = points.d2r_ds2 * v[:, None] ** 2 + points.dr_ds * a[:, None]
    return Motion("made up", MACHINE, path.segments, tick, tick * 1e-3, s, v, points.r_mm, velocity, acceleration)


def time_at(s_mm: FloatArray) -> FloatArray:
    """Inverse of s(t) above, by bisection."""
    end_mm = LINE_MM + ARC_MM
    low, high = np.zeros(len(s_mm)), np.full(len(s_mm), 2.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        tau = middle / 2.0
        below = end_mm * (tau - np.sin(2 * np.pi * tau) / (2 * np.pi)) < s_mm
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return low


@pytest.mark.parametrize("tolerance_mm", [0.05, 0.002, 0.0005])
def test_chords_of_an_arc_have_the_length_of_their_tolerance(tolerance_mm: float) -> None:
    """A chord of a circle leaves it by r (1 - cos(h / 2 r)); the straight line stays one chord."""
    ends = chord_ends_mm(toolpath(), tolerance_mm, 1000.0)
    np.testing.assert_allclose(ends[:2], [0.0, LINE_MM])
    steps = np.diff(ends[1:])
    left_mm = RADIUS_MM * (1 - np.cos(steps / (2 * RADIUS_MM)))
    assert np.max(left_mm) <= tolerance_mm
    assert np.max(left_mm) > 0.6 * tolerance_mm
    points = toolpath().evaluate(ends).r_mm
    assert chord_deviation_mm(toolpath(), ends, points) == pytest.approx(np.max(left_mm), rel=1e-3)


def test_longest_chord_bounds_every_chord() -> None:
    ends = chord_ends_mm(toolpath(), 1.0, 0.4)
    assert np.max(np.diff(ends)) <= 0.4 + 1e-9
    assert LINE_MM in np.round(ends, 9)


@pytest.mark.parametrize("inverse_time", [False, True])
def test_gcode_read_back_is_the_motion(inverse_time: bool) -> None:
    settings = GcodeSettings(tolerance_mm=0.002, longest_chord_mm=0.5, inverse_time=inverse_time)
    written = write_gcode(motion(), settings)
    assert written.deviation_mm <= 0.002
    # A feed that is rounded down by 1 mm/min takes longer by that.
    assert written.written_s == pytest.approx(2.0, rel=1e-6 if inverse_time else 3e-3)
    assert written.planned_s == pytest.approx(2.0, abs=1e-9)
    assert written.lines[-1] == "M2"
    points, feeds = [], []
    for move in read_moves(Program(ProgramKind.GCODE, written.lines), "test"):
        if isinstance(move, LineMoves) and not move.rapid:
            points += [move.start_mm[None, :], move.points_mm] if not points else [move.points_mm]
            feeds.append(move.feed_mm_s)
    ends = chord_ends_mm(toolpath(), 0.002 - 0.5 * math.sqrt(2) * 1e-4, 0.5)
    read = np.vstack(points)
    np.testing.assert_allclose(read[:, :2], toolpath().evaluate(ends).r_mm, atol=5.1e-5)
    chords_s = np.linalg.norm(np.diff(read, axis=0), axis=1) / np.concatenate(feeds)
    np.testing.assert_allclose(chords_s[3:-3], np.diff(time_at(ends))[3:-3], rtol=0.02)


def test_feeds_are_rounded_down_and_written_when_they_change() -> None:
    coarse = write_gcode(motion(), GcodeSettings(longest_chord_mm=0.25, feed_step_mm_min=600.0))
    feeds = [float(word[1:]) for line in coarse.lines for word in line.split() if word[0] == "F" and line[0] != "("]
    assert all(feed % 600.0 == 0.0 for feed in feeds if feed >= 600.0)
    assert all(before != after for before, after in itertools.pairwise(feeds))
    assert max(feeds) <= 60.0 * np.max(motion().feedrate_mm_s)
    fine = write_gcode(motion(), GcodeSettings(longest_chord_mm=0.25, feed_step_mm_min=1.0))
    assert (
        write_gcode(motion(), GcodeSettings(longest_chord_mm=0.25, feed_step_mm_min=600.0)).written_s > fine.written_s
    )


def test_words_rapids_and_dwells_stand_at_their_place() -> None:
    path = toolpath(events=("M3 S12000",), dwell_s=0.25, exact_stop=True, rapid=True)
    lines = write_gcode(motion(path), GcodeSettings()).lines
    at = lines.index("M3 S12000")
    assert lines[at + 1].startswith("G0 ")
    assert lines[-2:] == ("G4 P0.25", "M2")
    assert not any("F" in line for line in lines[at:] if line[0] != "(")
    events = [
        move.text for move in read_moves(Program(ProgramKind.GCODE, lines), "test") if isinstance(move, ProgramEvent)
    ]
    assert any("M3" in text for text in events)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (GcodeSettings(tolerance_mm=0.0), "tolerance_mm is 0"),
        (GcodeSettings(longest_chord_mm=math.inf), "longest_chord_mm is inf"),
        (GcodeSettings(feed_step_mm_min=-1.0), "feed_step_mm_min is -1"),
        (GcodeSettings(tolerance_mm=0.001, decimals=2), "coordinates of 2 decimals"),
    ],
)
def test_settings_without_sense_are_refused(settings: GcodeSettings, message: str) -> None:
    with pytest.raises(ExportError, match=message):
        write_gcode(motion(), settings)


def test_time_waited_at_rest_belongs_to_no_chord() -> None:
    made = motion()
    half = 1000
    wait = 500

    def waiting(values: FloatArray) -> FloatArray:
        return np.concatenate(
            [values[: half + 1], np.repeat(values[half : half + 1], wait, axis=0), values[half + 1 :]]
        )

    names = ("s_mm", "feedrate_mm_s", "position_mm", "velocity_mm_s", "acceleration_mm_s2")
    tick = np.arange(len(made.tick) + wait)
    longer = replace(made, tick=tick, t_s=tick * 1e-3, **{name: waiting(getattr(made, name)) for name in names})
    s_mm = np.linspace(0.0, made.toolpath.end_mm, 41)
    np.testing.assert_allclose(longer.times_at(s_mm), made.times_at(s_mm), atol=1e-9)


def test_trajectory_is_in_metres_and_holds_every_point() -> None:
    made = motion()
    document = yaml.safe_load(joint_trajectory_yaml(made, 0.01))
    assert document["joint_names"] == ["X", "Y"]
    points = document["points"]
    assert len(points) == 201
    np.testing.assert_allclose([p["positions"] for p in points], 1e-3 * made.position_mm[::10], rtol=1e-11, atol=1e-15)
    np.testing.assert_allclose(
        [p["velocities"] for p in points], 1e-3 * made.velocity_mm_s[::10], rtol=1e-11, atol=1e-13
    )
    stamps = [p["time_from_start"] for p in points]
    assert [stamp["sec"] * 10**9 + stamp["nanosec"] for stamp in stamps] == [10**7 * i for i in range(201)]
    assert all(isinstance(value, float) for p in points for value in (*p["positions"], *p["accelerations"]))


def test_rows_keep_the_last_set_point_and_refuse_other_periods() -> None:
    made = motion()
    assert rows_every(made, 0.003)[[0, 1, -2, -1]].tolist() == [0, 3, 1998, 2000]
    for period_s in (0.0, 0.0005, 0.0015):
        with pytest.raises(ExportError, match="multiple"):
            rows_every(made, period_s)
    table = setpoint_table(made, 0.001)
    np.testing.assert_array_equal(table["tool_x_mm"], made.position_mm[:, 0])


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    return write_run(folder / "run", folder / "share", duration_s=1.0)


@pytest.fixture(scope="module")
def run(bag: Path) -> RunData:
    return read_bag(bag)


def exported(*arguments: object) -> str:
    result = CliRunner().invoke(main, ["export", *(str(argument) for argument in arguments)])
    assert result.exit_code == 0, result.output
    return result.output


def test_bag_is_exported_to_tables_that_agree(bag: Path, run: RunData, tmp_path: Path) -> None:
    for kind, ending in (("csv", "csv"), ("npz", "npz"), ("parquet", "parquet")):
        exported(bag, "--format", kind, "--out", tmp_path / f"out.{ending}")
    header = (tmp_path / "out.csv").read_text().partition("\n")[0].split(",")
    rows = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1)
    arrays = np.load(tmp_path / "out.npz")
    table = pyarrow.parquet.read_table(tmp_path / "out.parquet")
    assert header == list(arrays) == table.column_names
    for i, name in enumerate(header):
        np.testing.assert_allclose(rows[:, i], arrays[name], rtol=1e-14, atol=1e-300)
        np.testing.assert_array_equal(table[name].to_numpy(), arrays[name])
    made = motion_of_run(run)
    np.testing.assert_array_equal(arrays["X_acceleration_mm_s2"], made.acceleration_mm_s2[:, 0])
    assert made.t_s[0] == 0.0 and made.feedrate_mm_s[0] == 0.0


@pytest.mark.parametrize(
    ("kind", "begin", "said"),
    [
        ("gcode", "(feedopt: ", "read back"),
        ("csv", "t_s,s_mm,", "set points"),
        ("joint-trajectory", "header:", "points"),
        ("states", "t_s,tick,", "states"),
    ],
)
def test_dash_is_standard_output(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, begin: str, said: str
) -> None:
    """It gets the bytes of the file and nothing else: the line about them goes to standard error."""
    monkeypatch.chdir(tmp_path)
    # Segments of the made-up bag turn by a microradian at their joint: no G-code is written for it.
    Path("part.csv").write_text("0,0\n10,2\n20,0\n30,8\n")
    source = "part.csv" if kind == "gcode" else str(bag)
    exported(source, "--format", kind, "--out", "file")
    result = CliRunner().invoke(main, ["export", source, "--format", kind, "--out", "-"])
    assert result.exit_code == 0, result.output
    assert result.stdout_bytes == Path("file").read_bytes() and begin in result.stdout.partition("\n")[0]
    assert result.stderr.startswith("-: ") and said in result.stderr
    assert not Path("-").exists()


@pytest.mark.parametrize("kind", ["npz", "parquet"])
def test_binary_formats_refuse_standard_output(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, ["export", str(bag), "--format", kind, "--out", "-"])
    assert result.exit_code == 2 and result.stdout == ""
    assert f"--format {kind} is binary" in result.stderr and "--out FILE, or --format csv" in result.stderr
    assert not list(tmp_path.iterdir())


def test_states_of_a_bag_are_a_table(bag: Path, run: RunData, tmp_path: Path) -> None:
    exported(bag, "--format", "states", "--out", tmp_path / "states.csv")
    rows = np.genfromtxt(tmp_path / "states.csv", delimiter=",", names=True)
    np.testing.assert_allclose(rows["Y_tracking_error_mm"], run.states.tracking_error_mm[:, 1], rtol=1e-14)
    with pytest.raises(ExportError, match="no states"):
        state_table(replace(run, states=run.states.of_program(99)))


def test_bag_without_what_is_needed_is_refused(run: RunData) -> None:
    with pytest.raises(ExportError, match="no /machine"):
        motion_of_run(replace(run, machine=None))
    with pytest.raises(ExportError, match="no set point of program 1 moves"):
        motion_of_run(replace(run, setpoints=run.setpoints.of_program(99)))
    # Set points are enough for tables; chords need the path between them.
    pathless = motion_of_run(replace(run, segments=()))
    assert len(setpoint_table(pathless, 0.001)["t_s"]) > 900
    with pytest.raises(ExportError, match="holds no /toolpath"):
        write_gcode(pathless, GcodeSettings())


def test_states_of_a_program_are_refused(tmp_path: Path) -> None:
    program = tmp_path / "part.csv"
    program.write_text("0,0\n10,0\n")
    result = CliRunner().invoke(main, ["export", str(program), "--format", "states"])
    assert result.exit_code == 2 and "states can only be exported from the bag" in result.stderr


def test_program_is_planned_and_exported(tmp_path: Path) -> None:
    program = tmp_path / "part.csv"
    program.write_text("0,0\n10,2\n20,0\n30,8\n")
    said = exported(program, "--machine", "case_a", "--method", "lp", "--out", tmp_path / "part.ngc")
    assert "read back" in said
    lines = (tmp_path / "part.ngc").read_text().splitlines()
    assert lines[3] == "G21 G90 G17 G94" and lines[-1] == "M2"
