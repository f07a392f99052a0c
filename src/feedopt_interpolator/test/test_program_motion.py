"""Inputs of a program in any order, and its early end."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from planned_motion import machine, planned

from feedopt_core.errors import Failure, FailureKind, ToolpathError
from feedopt_core.motion.setpoints import InterpolatorParameters, SetpointBlock
from feedopt_interpolator.program_motion import ProgramMotion

NO_PLAN = Failure(kind=FailureKind.SOLVER, message="no plan")
PARAMETERS = InterpolatorParameters(rest_before_ticks=3, rest_after_ticks=5)


def motion(start_ahead_s: float = 0.0) -> ProgramMotion:
    return ProgramMotion(1, machine(), PARAMETERS, start_ahead_s)


def play(program: ProgramMotion, count: int = 20) -> list[SetpointBlock]:
    blocks = []
    while (block := program.next_block(count)) is not None:
        blocks.append(block)
        if block.finished:
            break
    return blocks


def test_chunks_wait_for_the_path_they_lead_over() -> None:
    segments, chunks = planned()
    program = motion()
    for chunk in chunks:
        program.add_chunk(chunk)
    reader = threading.Thread(target=lambda: blocks.extend(play(program)))
    blocks: list[SetpointBlock] = []
    reader.start()
    for segment in segments:
        assert not blocks
        program.add_segment(segment)
    reader.join(30.0)
    ticks = np.concatenate([block.tick for block in blocks])
    assert np.array_equal(ticks, np.arange(-3, ticks[-1] + 1))
    assert blocks[-1].finished and not any(block.finished for block in blocks[:-1])
    assert blocks[-1].s_mm[-1] == pytest.approx(segments[-1].place.s_start_mm + segments[-1].length_mm, abs=1e-9)


def test_motion_does_not_start_before_enough_is_committed() -> None:
    segments, chunks = planned(commitment_mm=15.0)
    assert len(chunks) > 2
    program = motion(start_ahead_s=chunks[1].t_commit_s)
    for segment in segments:
        program.add_segment(segment)
    started = threading.Event()
    blocks: list[SetpointBlock | None] = []

    def first() -> None:
        blocks.append(program.next_block(5))
        started.set()

    threading.Thread(target=first, daemon=True).start()
    program.add_chunk(chunks[0])
    assert not blocks
    program.add_chunk(chunks[1])
    assert started.wait(30.0)
    assert blocks[0] is not None


def test_an_abandoned_program_without_motion_ends_at_once() -> None:
    program = motion()
    program.abandon(NO_PLAN)
    assert program.next_block(20) is None
    assert program.failure is NO_PLAN


def test_an_abandoned_motion_comes_to_rest_where_its_chunk_stops() -> None:
    segments, chunks = planned(commitment_mm=15.0)
    program = motion()
    for segment in segments:
        program.add_segment(segment)
    program.add_chunk(chunks[0])
    program.abandon()
    blocks = play(program)
    s_mm = np.concatenate([block.s_mm for block in blocks])
    assert blocks[-1].finished
    assert program.starved_chunk_sequence == chunks[0].sequence
    assert s_mm[-1] == pytest.approx(chunks[0].s_stop_mm, abs=1e-9)
    assert np.all(np.diff(s_mm) >= -1e-12)
    assert np.all(blocks[-1].v_mm_s == 0.0)


def test_the_first_fault_is_kept() -> None:
    program = motion()
    program.abandon(NO_PLAN)
    program.abandon(Failure(kind=FailureKind.SEQUENCE_GAP, message="a segment is lost"))
    assert program.failure is NO_PLAN


def test_a_lost_segment_is_an_error() -> None:
    segments, _ = planned()
    program = motion()
    program.add_segment(segments[0])
    with pytest.raises(ToolpathError, match="one is lost"):
        program.add_segment(replace(segments[1], place=replace(segments[1].place, sequence=3)))
