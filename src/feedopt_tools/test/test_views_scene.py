"""What the views of a run show beyond its curves: limits in use, contour error, program, events, comparison."""

from __future__ import annotations

import io
import itertools
import math
import warnings
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from recorded_run import write_run

from feedopt_core.errors import Failure, FailureKind
from feedopt_core.programs.moves import ArcMove, LineMoves, NurbsMove
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.bags.run_data import RunData, StatusRow
from feedopt_tools.errors import ViewError
from feedopt_tools.views.matplotlib.picture import figure_of
from feedopt_tools.views.matplotlib.style import STYLE, thinned
from feedopt_tools.views.pages import CONTOUR, MOTION, PAGES, PLANNER, TRACKING, Page, page_named, pages_of
from feedopt_tools.views.signals.comparison import compare, comparison_markdown
from feedopt_tools.views.signals.contour import contour_of
from feedopt_tools.views.signals.limit_use import NONE, limit_use_of
from feedopt_tools.views.signals.programmed import path_of_moves, programmed_path
from feedopt_tools.views.signals.run_events import events_of, node_states, program_lines
from feedopt_tools.views.signals.scene import scene_of
from feedopt_tools.views.signals.signals import RunSignals, signals_of

DURATION_S = 2.0
NO_SOLUTION = Failure(kind=FailureKind.SOLVER, message="no solution")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    folder = tmp_path_factory.mktemp("scene")
    return read_bag(write_run(folder / "run", folder / "share", duration_s=DURATION_S))


@pytest.fixture(scope="module")
def signals(run: RunData) -> RunSignals:
    return signals_of(run)


def test_use_of_a_limit_is_value_over_limit_and_the_largest_one_binds(signals: RunSignals) -> None:
    use = limit_use_of(signals)
    labels = [limit.label for limit in use.limits]
    assert labels[0] == "feedrate" and "Y jerk" in labels and "X tracking error" in labels
    column = labels.index("X acceleration")
    np.testing.assert_allclose(
        use.ratio[:, column], np.abs(signals.run.setpoints.acceleration_mm_s2[:, 0]) / 500.0, rtol=1e-12
    )
    np.testing.assert_array_equal(use.closest_ratio, np.max(use.ratio, axis=1))
    bound = use.active != NONE
    assert np.any(bound) and not np.all(bound)
    np.testing.assert_array_equal(use.ratio[bound, use.active[bound]], use.closest_ratio[bound])
    assert np.all(use.closest_ratio[~bound] < 0.95)


def test_stretches_cover_every_set_point_once_and_shares_add_up(signals: RunSignals) -> None:
    use = limit_use_of(signals)
    stretches = use.stretches()
    assert stretches[0][0] == 0 and stretches[-1][1] == len(signals.t_s) - 1
    assert all(before[1] + 1 == after[0] for before, after in itertools.pairwise(stretches))
    assert sum(share for _, share in use.shares(np.ones(len(signals.t_s)))) == pytest.approx(1.0)
    assert use.shares(np.zeros(len(signals.t_s))) == []


def test_limit_that_the_machine_does_not_give_is_neither_used_nor_drawn(run: RunData) -> None:
    assert run.machine is not None
    machine = replace(run.machine, jerk_limit_mm_s3=(math.inf, 156000.0), acceleration_limit_mm_s2=(math.inf, math.inf))
    signals = signals_of(replace(run, machine=machine))
    labels = [limit.label for limit in limit_use_of(signals).limits]
    assert "Y jerk" in labels and "X jerk" not in labels
    assert not any("acceleration" in label for label in labels)
    assert signals.quantities["acceleration"].limit is None
    assert signals.quantities["jerk"].limit_of(0) == math.inf
    scene_of(replace(run, machine=machine))


def test_contour_error_of_a_shifted_path_is_its_distance_and_not_its_lag(run: RunData) -> None:
    """The tool goes beside a circle by 10 um to the left of travel and 30 um behind: both come out apart."""
    radius_mm, setpoints, states = 40.0, run.setpoints, run.states
    angle = np.linspace(0.0, 5.0, len(setpoints))
    circle = radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    late = angle - 0.030 / radius_mm
    inside = (radius_mm - 0.010) * np.stack([np.cos(late), np.sin(late)], axis=1)
    moved = replace(
        run,
        setpoints=replace(setpoints, position_mm=circle, s_mm=radius_mm * angle),
        states=replace(states, position_mm=inside),
    )
    contour = contour_of(signals_of(moved))
    assert contour is not None
    middle = slice(100, -100)
    np.testing.assert_allclose(contour.error_um[middle], 10.0, atol=0.01)
    np.testing.assert_allclose(contour.lag_um[middle], 30.0, atol=0.05)
    drawn = np.linalg.norm(contour.exaggerated_mm[middle, :2], axis=1)
    np.testing.assert_allclose(radius_mm - drawn, contour.factor * 0.010, rtol=1e-3)
    assert contour.factor in (20.0, 50.0, 100.0)


def test_contour_needs_states(run: RunData) -> None:
    bare = replace(run, states=run.states.of_program(99))
    assert contour_of(signals_of(bare)) is None
    assert CONTOUR not in pages_of(scene_of(bare))


def test_programmed_path_is_read_from_the_text_in_the_bag(run: RunData) -> None:
    def with_text(name: str, text: str) -> RunData:
        return replace(run, provenance={"feedopt/program": {"name": name, "text": text}})

    path = programmed_path(with_text("points.csv", "0,0\n3,4\n6,0\n"))
    assert path.remark == ""
    np.testing.assert_array_equal(path.strips[0], [[0, 0, 0], [3, 4, 0], [6, 0, 0]])
    broken = programmed_path(with_text("points.csv", "0,0\n3,x\n"))
    assert broken.strips == () and "points.csv:2:3" in broken.remark
    assert "does not hold" in programmed_path(replace(run, provenance={})).remark


def test_moves_are_drawn_as_they_run() -> None:
    start, end = np.zeros(3), np.array([10.0, 0.0, 0.0])
    line = LineMoves(start, end[None, :], np.array([1]), np.array([math.inf]), rapid=True)
    helix = ArcMove(end, np.array([0.0, 10.0, 2.0]), np.zeros(3), np.array([0, 0, 1.0]), math.pi / 2, 2.0, 2, 10.0)
    net = np.array([[0, 10, 2], [0, 20, 2], [10, 20, 2]], dtype=float)
    curve = NurbsMove(2, np.array([0, 0, 0, 1, 1, 1.0]), net, np.array([1, math.sqrt(0.5), 1]), 3, 10.0)
    path = path_of_moves([line, helix, curve])
    assert path.rapid == (True, False, False)
    np.testing.assert_allclose(np.linalg.norm(path.strips[1][:, :2], axis=1), 10.0)
    np.testing.assert_allclose(path.strips[1][-1], helix.end_mm, atol=1e-12)
    # A quadratic with this weight is a quarter of a circle about (10, 10).
    np.testing.assert_allclose(np.linalg.norm(path.strips[2][:, :2] - [10, 10], axis=1), 10.0)


def test_events_tell_stops_words_faults_and_late_ticks(run: RunData) -> None:
    first, second = run.segments[0], run.segments[1]
    segments = (
        replace(first, place=replace(first.place, exact_stop=True, dwell_s=0.5)),
        replace(second, place=replace(second.place, events=("M3 S12000",))),
        *run.segments[2:],
    )
    lateness = np.zeros(len(run.setpoints))
    lateness[500:520] = 0.002
    late_ns = int(run.setpoints.stamp_ns[700])
    fault = StatusRow(late_ns, "planner", 4, run.program_id, 0, 0, 0.0, 0.0, 0, 0, "", NO_SOLUTION)
    changed = replace(
        run, segments=segments, setpoints=replace(run.setpoints, lateness_s=lateness), statuses=(*run.statuses, fault)
    )
    signals = signals_of(changed)
    events = events_of(signals)
    texts = {event.text: event for event in events}
    stop = texts["line 1: stop, dwell 0.5 s"]
    assert stop.s_mm == pytest.approx(first.length_mm)
    assert "line 2: M3 S12000" in texts
    late = texts["20 set points late by up to 2.00 ms"]
    assert (late.level, late.t_s) == ("WARN", pytest.approx(signals.t_s[500]))
    failed = texts["FAULT: no solution"]
    assert (failed.level, failed.source, failed.t_s) == ("ERROR", "planner", pytest.approx(signals.t_s[700], abs=1e-3))
    assert [state.state for state in node_states(signals) if state.node == "planner"][-1] == "FAULT"
    lines = program_lines(signals)
    assert lines is not None and np.all(np.diff(lines) >= 0.0) and lines[-1] == run.segments[-1].place.source_line


def test_a_run_compared_with_itself_differs_nowhere(run: RunData) -> None:
    scene = scene_of(run)
    comparison = compare(scene, scene)
    assert comparison.names == ("first", "second")
    for curve in comparison.curves:
        for overlay in (curve.over_time, curve.over_path):
            assert np.nanmax(np.abs(overlay.difference)) == 0.0
    assert {"feed", "use", "tracking_error/X", "control_signal/Y", "jerk/X"} <= {one.key for one in comparison.curves}
    assert "(0.00 %) faster" in comparison_markdown(comparison)


def test_a_run_at_half_speed_is_later_by_the_time_it_took(run: RunData) -> None:
    """Every tick lasts twice as long: feed halves at each arc length, and each is reached in twice the time."""
    setpoints, states = run.setpoints, run.states
    slow = replace(
        run,
        setpoints=replace(setpoints, tick=2 * setpoints.tick, feedrate_mm_s=0.5 * setpoints.feedrate_mm_s),
        states=replace(states, tick=2 * states.tick),
        path=run.path.parent / "slow",
    )
    comparison = compare(scene_of(run), scene_of(slow))
    feed = comparison.curves[0].over_path
    np.testing.assert_allclose(feed.second, 0.5 * feed.first, atol=1e-9)
    np.testing.assert_allclose(comparison.reached_s.difference, comparison.reached_s.first, atol=1e-9)
    over_time = comparison.curves[0].over_time
    # Where one of them has ended there is no difference.
    assert np.all(np.isnan(over_time.difference[over_time.at > setpoints.t_s[-1] + 1e-9]))


def test_run_that_does_not_move_cannot_be_compared(run: RunData) -> None:
    still = replace(run, setpoints=replace(run.setpoints, s_mm=np.zeros(len(run.setpoints))))
    with pytest.raises(ViewError, match="holds no motion"):
        compare(scene_of(run), scene_of(still))


def test_thinned_curve_keeps_its_peaks() -> None:
    x = np.arange(200_000.0)
    y = np.sin(x / 500.0)
    y[123_456], y[7] = 5.0, -5.0
    few_x, few_y = thinned(x, y)
    assert len(few_x) < 4000
    assert (few_y.max(), few_y.min()) == (5.0, -5.0)
    assert np.all(np.diff(few_x) >= 0.0)
    np.testing.assert_array_equal(thinned(x[:100], y[:100])[1], y[:100])


def test_pages_are_those_the_run_has_something_for(run: RunData) -> None:
    assert pages_of(scene_of(run)) == PAGES
    assert PLANNER not in pages_of(scene_of(replace(run, chunks=())))
    with pytest.raises(ViewError, match="available: motion, active-limit"):
        page_named("nothing")


@pytest.mark.parametrize("page", [MOTION, TRACKING])
def test_pages_leave_out_what_was_not_recorded(run: RunData, page: Page) -> None:
    """Without a simulation there are no states: no chart without a curve, and nothing to warn of."""
    scene = scene_of(replace(run, states=run.states.of_program(99)))
    quantities = {**scene.signals.quantities}
    quantities["tracking_error"] = replace(quantities["tracking_error"], commanded=None, measured=None)
    without = replace(scene, signals=replace(scene.signals, quantities=quantities))
    with warnings.catch_warnings(), mpl.rc_context(STYLE):
        warnings.simplefilter("error")
        figure = figure_of(without, page)
        figure.savefig(io.BytesIO(), format="png")
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert quantities["control_signal"].title in titles
    assert quantities["tracking_error"].title not in titles
    assert all(axes.lines or axes.collections or axes.images for axes in figure.axes)


def test_reserve_is_what_is_committed_ahead_of_the_motion(run: RunData) -> None:
    """A report of the planner at tick 300 that it has committed chunk 3: its end minus 0.3 s."""
    stamp_ns = int(run.setpoints.stamp_ns[np.flatnonzero(run.setpoints.tick == 300)[0]])
    chunk = run.chunks[2]
    row = StatusRow(stamp_ns, "planner", 2, run.program_id, 0, 3, chunk.s_commit_mm, 0.0, 0, 0, "", None)
    reserve = scene_of(replace(run, statuses=(row,))).reserve
    assert reserve is not None
    assert reserve.ahead_s[0] == pytest.approx(chunk.t_commit_s - 0.3, abs=2e-3)


def test_recording_of_a_comparison_is_valid(run: RunData, tmp_path: Path) -> None:
    from feedopt_tools.views.picture import draw_comparison_picture
    from feedopt_tools.views.rerun.comparison_recording import save_comparison

    scene = scene_of(run)
    comparison = compare(scene, scene)
    for over in ("time", "arc-length"):
        save_comparison(comparison, tmp_path / f"{over}.rrd", over)
        assert (tmp_path / f"{over}.rrd").stat().st_size > 100_000
    picture = draw_comparison_picture(comparison, tmp_path / "both.png", by="matplotlib")
    assert picture.path.stat().st_size > 20_000
