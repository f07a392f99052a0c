"""Planning in windows: chunks join, each ends in a stop that holds, and solver failures end in that stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from core_motion import ONE_WINDOW, PlannedPath, difference_ratios, plan_path
from core_paths import kinematic_machine, line, polyline, spline, toolpath_of

from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.config_files import config_directory
from feedopt_core.errors import ConfigError, InfeasibleLimitsError, SolverError, ToolpathError
from feedopt_core.geometry.segments import Segment
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import load_machine
from feedopt_core.motion.certificate import ALLOWED_RATIO
from feedopt_core.motion.chunk import Chunk
from feedopt_core.pipeline.plan_program import interpolate, plan_program
from feedopt_core.pipeline.read_program import Program, open_program, read_program
from feedopt_core.planner.method import Window, WindowPlan
from feedopt_core.planner.methods import make_method
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner

MACHINE = kinematic_machine(feed=80.0)
SHORT_WINDOWS = PlannerParameters(look_ahead_mm=20.0, commitment_mm=12.0)
ALL = set(range(1, 100))
WAVE = [(6.0 * k, 5.0 * np.sin(0.9 * k)) for k in range(22)]


def fan_contour() -> Path:
    return config_directory() / "programs" / "fan_contour.csv"


@pytest.fixture(scope="module")
def wave() -> PlannedPath:
    """A path of many short windows."""
    return plan_path(MACHINE, spline(WAVE), SHORT_WINDOWS)


def test_fan_contour_on_case_a_is_fast_and_holds() -> None:
    plan = plan_program(fan_contour(), load_machine("case_a"), PlannerParameters())
    assert plan.motion_time_s <= 6.31
    assert plan.audit.holds
    assert {row.grid for row in plan.audit.rows} == {"fine", "set points"}
    assert max(difference_ratios(plan.setpoints.position_mm, load_machine("case_a")).values()) <= ALLOWED_RATIO
    assert len(plan.chunks) > 3
    assert plan.setpoints.t_s[-1] == pytest.approx(plan.motion_time_s, abs=1e-3)


@pytest.mark.parametrize("name", ["case_b", "router_simulation"])
def test_windows_take_as_long_as_one_solve_of_the_fan_contour(name: str) -> None:
    machine = load_machine(name)
    segments = list(read_program(open_program(fan_contour()), "fan", machine.dimensions))
    whole, windowed = plan_path(machine, segments), plan_path(machine, segments, PlannerParameters())
    assert len(whole.chunks) == 1
    assert windowed.motion_time_s == pytest.approx(whole.motion_time_s, rel=2e-3)
    assert windowed.fine_audit().holds


def test_chunks_join_exactly(wave: PlannedPath) -> None:
    assert len(wave.chunks) > 5
    assert [chunk.sequence for chunk in wave.chunks] == list(range(1, len(wave.chunks) + 1))
    assert [chunk.last for chunk in wave.chunks] == [False] * (len(wave.chunks) - 1) + [True]
    for before, after in zip(wave.chunks[:-1], wave.chunks[1:], strict=True):
        assert after.s_start_mm == before.s_commit_mm
        assert after.t_start_s == before.t_commit_s
        at = np.array([before.t_commit_s - before.t_start_s])
        end, start = before.profile.states_at(at), after.profile.states_at(np.zeros(1))
        assert start.s_mm[0] == pytest.approx(end.s_mm[0], abs=1e-9)
        assert start.v_mm_s[0] == pytest.approx(end.v_mm_s[0], rel=1e-9)
        assert start.a_mm_s2[0] == pytest.approx(end.a_mm_s2[0], abs=1e-6)


def test_first_chunk_starts_and_last_chunk_ends_at_rest(wave: PlannedPath) -> None:
    first = wave.chunks[0].profile.states_at(np.zeros(1))
    assert (first.s_mm[0], first.v_mm_s[0], first.a_mm_s2[0]) == (0.0, 0.0, 0.0)
    last = wave.chunks[-1]
    assert last.s_commit_mm == last.s_stop_mm == wave.toolpath.end_mm


def stopped_after(planned: PlannedPath, count: int) -> list[Chunk]:
    """The first chunks, and the stop of the last of them taken."""
    chunk = planned.chunks[count - 1]
    end_s = chunk.t_start_s + chunk.profile.duration_s
    return [*planned.chunks[: count - 1], replace(chunk, last=True, s_commit_mm=chunk.s_stop_mm, t_commit_s=end_s)]


def test_every_stop_holds_the_limits_and_ends_at_rest(wave: PlannedPath) -> None:
    """What is committed ends in a feasible stop, whichever chunk is the last to arrive."""
    for count in range(1, len(wave.chunks) + 1):
        chunk = wave.chunks[count - 1]
        end = chunk.profile.states_at(np.array([chunk.profile.duration_s]))
        assert end.s_mm[0] == pytest.approx(chunk.s_stop_mm, abs=1e-12)
        assert end.v_mm_s[0] == pytest.approx(0.0, abs=1e-9)
        assert end.a_mm_s2[0] == pytest.approx(0.0, abs=1e-9)
        setpoints = interpolate(wave.toolpath, stopped_after(wave, count), MACHINE)
        ratios = difference_ratios(setpoints.position_mm, MACHINE)
        assert max(ratios.values()) <= ALLOWED_RATIO, (count, ratios)
        assert audit_profile(wave.toolpath, chunk.profile, MACHINE).holds


def test_certificate_is_what_the_audit_finds(wave: PlannedPath) -> None:
    for chunk in wave.chunks:
        worst = audit_profile(wave.toolpath, chunk.profile, MACHINE, chunk.t_start_s).worst
        assert chunk.certificate.worst_ratio == worst.ratio <= ALLOWED_RATIO
        assert (chunk.certificate.worst_quantity, chunk.certificate.worst_s_mm) == (worst.quantity, worst.s_mm)
        assert max(chunk.certificate.max_velocity_mm_s) <= 80.0 * ALLOWED_RATIO
        assert chunk.certificate.max_control_volts == ()


def test_chunk_needs_enough_path() -> None:
    segments = spline(WAVE)
    planner = StreamPlanner(MACHINE, SHORT_WINDOWS)
    assert planner.next_chunk() is None
    for segment in segments[:-1]:
        planner.add_segment(segment)
        known = planner.toolpath.end_mm
        while (chunk := planner.next_chunk()) is not None:
            assert chunk.s_stop_mm <= known
            assert chunk.s_commit_mm <= chunk.s_stop_mm - 20.0
            assert chunk.last_segment_sequence == segment.place.sequence
        assert known - planner.committed_s_mm < 20.0 + 12.0 + 20.0
    assert not planner.finished
    planner.add_segment(segments[-1])
    while planner.next_chunk() is not None:
        pass
    assert planner.finished
    assert planner.next_chunk() is None


def test_planner_forgets_what_lies_behind() -> None:
    planner = StreamPlanner(MACHINE, SHORT_WINDOWS)
    for segment in spline(WAVE):
        planner.add_segment(segment)
    while (chunk := planner.next_chunk()) is not None:
        planner.discard_before(chunk.s_start_mm)
        assert planner.toolpath.start_mm <= chunk.s_start_mm
    assert planner.finished
    assert planner.toolpath.start_mm > 0.0


def test_segment_out_of_sequence_is_refused() -> None:
    planner = StreamPlanner(MACHINE, SHORT_WINDOWS)
    segments = spline(WAVE)
    planner.add_segment(segments[0])
    with pytest.raises(ToolpathError, match="one is lost"):
        planner.add_segment(segments[2])


SQUARE: list[tuple[float, float]] = [(0, 0), (30, 0), (30, 20), (0, 20), (0, 0)]


@pytest.mark.parametrize("parameters", [ONE_WINDOW, SHORT_WINDOWS])
def test_exact_stops_come_to_rest_in_the_corners(parameters: PlannerParameters) -> None:
    machine = kinematic_machine(jerk=(5000.0, 40000.0))
    planned = plan_path(machine, polyline(SQUARE), parameters)
    corners = np.array([30.0, 50.0, 80.0, 100.0])
    ends = {chunk.s_commit_mm for chunk in planned.chunks if chunk.s_commit_mm == chunk.s_stop_mm}
    assert sorted(ends) == corners.tolist()
    setpoints = planned.setpoints()
    for corner in corners:
        assert setpoints.v_mm_s[np.argmin(np.abs(setpoints.s_mm - corner))] < 0.05
    assert max(difference_ratios(setpoints.position_mm, machine).values()) <= ALLOWED_RATIO
    sides = sum(
        plan_path(machine, [line(side, heading)]).motion_time_s
        for side, heading in ((30.0, 0.0), (20.0, np.pi / 2.0), (30.0, np.pi), (20.0, np.pi / 2.0))
    )
    assert planned.motion_time_s == pytest.approx(sides, rel=2e-3)


def test_windows_end_on_exact_stops_to_the_last_bit() -> None:
    """A hair before one, the next window would be that hair."""
    for lengths in np.random.default_rng(2).uniform((0.1, 1.0, 1.0, 1.0), (1.0, 9.0, 9.0, 9.0), (60, 4)):
        segments = polyline([(x, 0.0) for x in (0.0, *np.cumsum(lengths))])
        segments[1] = replace(segments[1], place=replace(segments[1].place, exact_stop=False))
        planned = plan_path(MACHINE, segments)
        stops = planned.toolpath.exact_stops_mm()
        assert [chunk.s_commit_mm for chunk in planned.chunks if chunk.s_commit_mm in stops] == stops.tolist()


def test_stop_and_turn_back_on_the_same_line() -> None:
    planned = plan_path(MACHINE, polyline([(0, 0), (30, 0), (0, 0)]))
    setpoints = planned.setpoints()
    assert np.max(setpoints.position_mm[:, 0]) == pytest.approx(30.0, abs=1e-6)
    assert max(difference_ratios(setpoints.position_mm, MACHINE).values()) <= ALLOWED_RATIO


@dataclass
class Spoiled:
    """The kinematic method, spoiled in some of its windows."""

    spoil: Callable[[WindowPlan], WindowPlan]
    windows: set[int]
    name: str = "spoiled"
    stopping_mm: float = 20.0
    whole_path: bool = False
    asked: int = field(default=0)

    def plan(self, toolpath: Toolpath, window: Window) -> WindowPlan:
        self.asked += 1
        plan = make_method("lp", MACHINE, 0.25).plan(toolpath, window)
        return self.spoil(plan) if self.asked in self.windows else plan


def fails(_: WindowPlan) -> WindowPlan:
    raise SolverError("no plan in this window")


def finds_nothing(_: WindowPlan) -> WindowPlan:
    raise InfeasibleLimitsError("no motion", quantity="jerk", axis="X", s_mm=1.0, ratio=2.0)


def too_fast(plan: WindowPlan) -> WindowPlan:
    """Everything 1 % faster: limits are exceeded, the certificate must find it."""
    p = plan.profile
    faster = replace(
        p,
        q_mm2_s2=1.02 * p.q_mm2_s2,
        dq_ds_mm_s2=1.02 * p.dq_ds_mm_s2,
        d2q_ds2_per_s2=1.02 * p.d2q_ds2_per_s2,
        jerk_mm_s3=1.02**1.5 * p.jerk_mm_s3,
    )
    return replace(plan, profile=faster)


@pytest.mark.parametrize("spoil", [fails, finds_nothing, too_fast])
@pytest.mark.parametrize("windows", [{2}, {3, 5}])
def test_window_without_a_plan_takes_the_stop_and_goes_on(
    spoil: Callable[[WindowPlan], WindowPlan], windows: set[int]
) -> None:
    planned = plan_path(MACHINE, spline(WAVE), SHORT_WINDOWS, Spoiled(spoil, windows))
    fallen = [chunk for chunk in planned.chunks if chunk.figures.fallback]
    assert [chunk.sequence for chunk in fallen] == sorted(windows)
    for chunk in fallen:
        assert chunk.s_commit_mm == chunk.s_stop_mm == planned.chunks[chunk.sequence - 2].s_stop_mm
    setpoints = planned.setpoints()
    assert max(difference_ratios(setpoints.position_mm, MACHINE).values()) <= ALLOWED_RATIO
    assert planned.fine_audit().holds
    assert setpoints.s_mm[-1] == pytest.approx(planned.toolpath.end_mm, abs=1e-9)


def test_window_from_rest_without_a_plan_is_halved_until_a_part_has_one() -> None:
    """At standstill there is no stop in reserve, and the program still continues."""
    planned = plan_path(MACHINE, spline(WAVE), SHORT_WINDOWS, Spoiled(fails, {1, 2}))
    first, second = planned.chunks[:2]
    assert first.figures.fallback and not second.figures.fallback
    assert first.s_commit_mm == first.s_stop_mm == pytest.approx(0.25 * second.s_stop_mm, rel=0.3)
    assert planned.fine_audit().holds
    after_a_fallback = plan_path(MACHINE, spline(WAVE), SHORT_WINDOWS, Spoiled(fails, {2, 3}))
    assert [chunk.figures.fallback for chunk in after_a_fallback.chunks[:4]] == [False, True, True, False]
    assert after_a_fallback.fine_audit().holds


def test_path_of_which_no_part_has_a_plan_is_an_error() -> None:
    with pytest.raises(SolverError, match="no plan in this window"):
        plan_path(MACHINE, spline(WAVE), SHORT_WINDOWS, Spoiled(fails, ALL))
    with pytest.raises(InfeasibleLimitsError, match="no motion"):
        plan_path(MACHINE, spline(WAVE), SHORT_WINDOWS, Spoiled(finds_nothing, ALL))


def test_plan_that_fails_its_audit_is_never_published() -> None:
    with pytest.raises(SolverError, match=r"fails its audit: \w+ of .*1\.0\d+ times its limit at s = "):
        plan_path(MACHINE, spline(WAVE), SHORT_WINDOWS, Spoiled(too_fast, ALL))


def test_plan_whose_certificate_is_not_a_number_is_never_published() -> None:
    unknown = replace(MACHINE, jerk_limit_mm_s3=(25000.0, float("nan")))
    with pytest.raises(SolverError, match="fails its audit"):
        plan_path(unknown, spline(WAVE), SHORT_WINDOWS, Spoiled(fails, set()))


def test_program_of_corners_of_a_micrometre_has_a_plan_in_every_window() -> None:
    """Feedrates from 150 mm/s on the sides to 1 mm/s in the corners of one window."""
    lines = ["G21 G90 G17 F9000 G64 P0.001"]
    lines += [f"G1 X{20 * k + 10 * (k % 3 == 0)} Y{15 * (k % 2) + 0.3 * (k % 5)}" for k in range(1, 25)]
    text = "\n".join([*lines, "M2", ""])
    for name in ("case_a", "router_simulation"):
        machine = load_machine(name)
        segments = list(read_program(Program.from_text(text), "corners.ngc", machine.dimensions, 0.001))
        planned = plan_path(machine, segments, PlannerParameters())
        assert len(planned.chunks) >= 3
        assert {chunk.figures.solver for chunk in planned.chunks} == {"nlp"}
        assert planned.fine_audit().holds


def test_restart_after_a_stop_goes_on_from_there() -> None:
    segments: list[Segment] = spline(WAVE)
    planner = StreamPlanner(MACHINE, SHORT_WINDOWS)
    for segment in segments:
        planner.add_segment(segment)
    first, second = planner.next_chunk(), planner.next_chunk()
    assert first is not None and second is not None
    planner.restart_after_stop(first.sequence)
    third = planner.next_chunk()
    assert third is not None
    assert third.sequence == 3
    assert third.s_start_mm == first.s_stop_mm
    assert third.t_start_s == first.t_start_s + first.profile.duration_s
    start = third.profile.states_at(np.zeros(1))
    assert (start.v_mm_s[0], start.a_mm_s2[0]) == (0.0, 0.0)


def test_restart_after_an_unknown_chunk_changes_nothing() -> None:
    planner = StreamPlanner(MACHINE, SHORT_WINDOWS)
    for segment in spline(WAVE):
        planner.add_segment(segment)
    first = planner.next_chunk()
    assert first is not None
    planner.restart_after_stop(7)
    second = planner.next_chunk()
    assert second is not None and second.s_start_mm == first.s_commit_mm


def test_unknown_method_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="method 'magic' is unknown; there are: lp"):
        StreamPlanner(MACHINE, PlannerParameters(method="magic"))


def test_plan_needs_the_whole_path() -> None:
    """Without its last segment a program is never finished: nothing may be planned to an end that is not one."""
    planner = StreamPlanner(MACHINE, SHORT_WINDOWS)
    for segment in spline(WAVE)[:-1]:
        planner.add_segment(segment)
    while planner.next_chunk() is not None:
        pass
    assert not planner.finished
    assert planner.committed_s_mm < toolpath_of(spline(WAVE)).end_mm - 20.0
