"""Set points: equidistant, standstill before and after, equal for every size of the blocks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from core_motion import PlannedPath, plan_path
from core_paths import kinematic_machine, line, spline
from hypothesis import given, settings
from hypothesis import strategies as st

from feedopt_core.errors import ToolpathError
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.setpoints import InterpolatorParameters, SetpointBlock, SetpointStream
from feedopt_core.planner.stream_planner import PlannerParameters

MACHINE = kinematic_machine(feed=80.0)
WAVE = spline([(6.0 * k, 5.0 * np.sin(0.9 * k)) for k in range(10)])
PARAMETERS = InterpolatorParameters(rest_before_ticks=20, rest_after_ticks=30)
FIELDS = (
    "tick",
    "chunk_sequence",
    "s_mm",
    "v_mm_s",
    "position_mm",
    "velocity_mm_s",
    "acceleration_mm_s2",
)


@pytest.fixture(scope="module")
def planned() -> PlannedPath:
    planned = plan_path(MACHINE, WAVE, PlannerParameters(look_ahead_mm=20.0, commitment_mm=10.0))
    assert len(planned.chunks) > 2
    return planned


def stream_of(planned: PlannedPath, parameters: InterpolatorParameters = PARAMETERS) -> SetpointStream:
    stream = SetpointStream(planned.machine, parameters)
    for segment in planned.toolpath.segments:
        stream.add_segment(segment)
    for chunk in planned.chunks:
        assert stream.add_chunk(chunk)
    return stream


def drained(stream: SetpointStream, sizes: list[int]) -> SetpointBlock:
    """All set points, in blocks of the given sizes over and over, as one."""
    blocks = list[SetpointBlock]()
    while (block := stream.next_block(sizes[len(blocks) % len(sizes)])) is not None:
        assert not (blocks and blocks[-1].finished)
        blocks.append(block)
    assert blocks[-1].finished
    joined: dict[str, Any] = {name: np.concatenate([getattr(block, name) for block in blocks]) for name in FIELDS}
    return replace(blocks[-1], **joined)


@pytest.fixture(scope="module")
def whole(planned: PlannedPath) -> SetpointBlock:
    return drained(stream_of(planned), [10**6])


def test_ticks_run_from_the_rest_before_to_the_rest_after(planned: PlannedPath, whole: SetpointBlock) -> None:
    motion_ticks = int(np.ceil(planned.motion_time_s / 0.001))
    assert whole.tick.tolist() == list(range(-20, motion_ticks + 30 + 1))


def test_machine_rests_before_and_after(planned: PlannedPath, whole: SetpointBlock) -> None:
    before, after = whole.tick <= 0, whole.tick >= np.ceil(planned.motion_time_s / 0.001)
    for rows, at_mm in ((before, 0.0), (after, planned.toolpath.end_mm)):
        expected = planned.toolpath.evaluate(np.array([at_mm])).r_mm[0]
        assert np.allclose(whole.position_mm[rows], expected, atol=1e-9)
        assert np.allclose(whole.s_mm[rows], at_mm, atol=1e-9)
        for values in (whole.v_mm_s[rows], whole.velocity_mm_s[rows], whole.acceleration_mm_s2[rows]):
            assert np.allclose(values, 0.0, atol=1e-6)
    assert np.all(whole.chunk_sequence[whole.tick < 0] == 0)
    assert np.all(whole.chunk_sequence[whole.tick >= 0] > 0)


def test_set_points_lie_on_the_path_at_their_time(planned: PlannedPath, whole: SetpointBlock) -> None:
    starts = np.array([chunk.t_start_s for chunk in planned.chunks])
    for index in range(100, len(whole.tick) - 100, 37):
        t = whole.tick[index] * 0.001
        chunk = planned.chunks[int(np.searchsorted(starts, t, side="right")) - 1]
        assert whole.chunk_sequence[index] == chunk.sequence
        state = chunk.profile.states_at(np.array([t - chunk.t_start_s]))
        assert whole.s_mm[index] == pytest.approx(state.s_mm[0], abs=1e-12)
        assert whole.v_mm_s[index] == pytest.approx(state.v_mm_s[0], abs=1e-12)
    assert np.allclose(whole.position_mm, planned.toolpath.evaluate(whole.s_mm).r_mm, atol=1e-12)


def test_velocity_and_acceleration_are_those_of_the_positions(whole: SetpointBlock) -> None:
    h = 0.001
    inner = slice(1, -1)
    velocity = (whole.position_mm[2:] - whole.position_mm[:-2]) / (2.0 * h)
    acceleration = np.diff(whole.position_mm, n=2, axis=0) / h**2
    # The error of a central difference: the jerk's h^2 / 6, and two periods of jerk where it jumps.
    assert np.allclose(whole.velocity_mm_s[inner], velocity, atol=25000.0 * h**2)
    assert np.allclose(whole.acceleration_mm_s2[inner], acceleration, atol=2.0 * 25000.0 * h)
    assert np.allclose(np.linalg.norm(whole.velocity_mm_s, axis=1), whole.v_mm_s, atol=1e-9)


@settings(max_examples=12)
@given(sizes=st.lists(st.integers(1, 700), min_size=1, max_size=6).filter(lambda sizes: sum(sizes) > 3 * len(sizes)))
def test_size_of_the_blocks_changes_nothing(planned: PlannedPath, whole: SetpointBlock, sizes: list[int]) -> None:
    blocks = drained(stream_of(planned), sizes)
    for name in FIELDS:
        values, expected = getattr(blocks, name), getattr(whole, name)
        assert values.shape == expected.shape
        assert np.allclose(values, expected, rtol=1e-12, atol=1e-12)


def test_no_set_point_before_the_first_chunk(planned: PlannedPath) -> None:
    stream = SetpointStream(MACHINE, PARAMETERS)
    stream.add_segment(planned.toolpath.segments[0])
    assert stream.next_block(10) is None
    assert stream.add_chunk(planned.chunks[0])
    block = stream.next_block(10)
    assert block is not None
    assert block.tick.tolist() == list(range(-20, -10))


def test_no_set_point_behind_the_last(planned: PlannedPath) -> None:
    stream = stream_of(planned)
    drained(stream, [500])
    assert stream.next_block(10) is None


def test_motion_time_of_whole_ticks_gains_no_tick() -> None:
    """A move stretched in time to exactly 400 periods ends at tick 400."""
    factor = plan_path(kinematic_machine(), [line(10.0)]).motion_time_s / 0.4
    machine = kinematic_machine(
        150.0 * factor, (150.0 * factor,) * 2, (500.0 * factor**2,) * 2, (25000.0 * factor**3,) * 2
    )
    planned = plan_path(machine, [line(10.0)])
    assert planned.motion_time_s == pytest.approx(0.4, abs=1e-12)
    block = drained(stream_of(planned, InterpolatorParameters(rest_before_ticks=0, rest_after_ticks=0)), [1000])
    assert (block.tick[0], block.tick[-1]) == (0, 400)


@pytest.mark.parametrize("period_s", [0.0005, 0.002, 0.01])
def test_period_is_that_of_the_machine(planned: PlannedPath, period_s: float) -> None:
    of_machine = replace(planned, machine=replace(planned.machine, period_s=period_s))
    block = drained(stream_of(of_machine, InterpolatorParameters(0, 0)), [1000])
    assert block.tick[-1] == int(np.ceil(planned.motion_time_s / period_s - 1e-9))
    assert block.s_mm[-1] == pytest.approx(planned.toolpath.end_mm, abs=1e-12)


def test_gantry_gets_a_set_point_for_each_motor() -> None:
    rows = ((1.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    machine = Machine("gantry", "", ("Xr", "Xl", "Y"), rows, 80.0, (150.0,) * 3, (500.0,) * 3, (25000.0,) * 3)
    block = drained(stream_of(plan_path(machine, spline([(0, 0), (10, 3), (20, -4)]))), [1000])
    assert block.position_mm.shape[1] == 3
    for values in (block.position_mm, block.velocity_mm_s, block.acceleration_mm_s2):
        assert np.array_equal(values[:, 0], values[:, 1])


def test_path_that_has_not_arrived_is_an_error(planned: PlannedPath) -> None:
    stream = SetpointStream(MACHINE, PARAMETERS)
    for chunk in planned.chunks:
        stream.add_chunk(chunk)
    with pytest.raises(ToolpathError, match="outside the path"):
        stream.next_block(1000)


def test_stream_forgets_what_lies_behind(planned: PlannedPath) -> None:
    stream = stream_of(planned)
    drained(stream, [100])
    assert stream.toolpath.start_mm > 0.0


def test_motion_time_follows_the_ticks(planned: PlannedPath) -> None:
    stream = stream_of(planned)
    assert stream.motion_time_s == 0.0
    stream.next_block(15)
    assert stream.motion_time_s == 0.0
    stream.next_block(105)
    assert stream.motion_time_s == pytest.approx(0.1, abs=1e-12)
