"""Replays a bag stage by stage and reports where the output differs from the recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from feedopt_core.errors import FeedoptError
from feedopt_recorder.errors import BagError
from feedopt_tools.errors import ReplayInputError
from feedopt_tools.replay.columns import Columns
from feedopt_tools.replay.comparison import IGNORED, Difference, Tolerances, TopicComparison, compare_topic
from feedopt_tools.replay.recorded_program import RecordedProgram
from feedopt_tools.replay.stages import STAGES, Stage


@dataclass(frozen=True)
class StageResult:
    """One stage of one bag.

    Attributes:
        node: the node the stage stands for.
        topics: its output topics.
        failure: the error that ended the stage early; empty if it ran to its end.
    """

    node: str
    topics: tuple[TopicComparison, ...]
    failure: str = ""

    @property
    def agrees(self) -> bool:
        """The stage ran to its end and every message agrees with the recorded one."""
        return not self.failure and all(topic.agrees for topic in self.topics)


@dataclass(frozen=True)
class Replay:
    """Results of one bag, one for each recorded stage, in the order of the pipeline."""

    path: Path
    stages: tuple[StageResult, ...]

    @property
    def agrees(self) -> bool:
        """Every stage agrees."""
        return all(stage.agrees for stage in self.stages)


def replay_bag(path: Path, tolerances: Tolerances) -> Replay:
    """Feed every stage its recorded inputs and compare its outputs with the recorded ones.

    Args:
        path: the bag.
        tolerances: allowed differences.

    Raises:
        BagError: the bag cannot be read, or lacks what a stage needs.
        ConfigError: this version does not accept the recorded machine or parameters.
    """
    recorded = RecordedProgram(path)
    return Replay(path, tuple(_run(stage, recorded, tolerances) for stage in _stages(recorded)))


def compare_bags(path: Path, other: Path, tolerances: Tolerances) -> Replay:
    """Compare two recordings of one program, topic by topic, as if the second were a replay of the first.

    Raises:
        BagError: one of them cannot be read.
    """
    first, second = RecordedProgram(path), RecordedProgram(other)
    # The toolpath node numbers programs from its start: the same program may have another number in another run.
    ignored = (*IGNORED, "program_id")
    return Replay(
        path,
        tuple(
            StageResult(
                stage.node,
                tuple(
                    compare_topic(topic, placed(first, topic), second.columns(topic), tolerances, ignored=ignored)
                    for topic in stage.outputs
                ),
            )
            for stage in _stages(first)
        ),
    )


def _stages(recorded: RecordedProgram) -> list[Stage]:
    """Stages whose node was recorded. Without the simulated router, its stage is missing."""
    found = [stage for stage in STAGES if stage.node in recorded.nodes]
    if not found:
        raise ReplayInputError(
            f"{recorded.path}: has no record feedopt/parameters, which a replay needs; record it with feedopt run"
        )
    return found


def _run(stage: Stage, recorded: RecordedProgram, tolerances: Tolerances) -> StageResult:
    outputs = {topic: Columns() for topic in stage.outputs}
    failure = ""
    missing = [topic for topic in stage.inputs if topic not in recorded.topics]
    if missing:
        failure = f"the bag has no messages of {', '.join(missing)}"
    else:
        try:
            stage.run(recorded, outputs)
        except BagError:
            raise
        except FeedoptError as error:
            failure = f"{type(error).__name__}: {error}"
        # A changed core may fail in any way. That is a difference of this stage; the other stages are still compared.
        except Exception as error:  # noqa: BLE001
            failure = f"{type(error).__name__}: {error}"
    comparisons = tuple(
        compare_topic(topic, placed(recorded, topic), made, tolerances) for topic, made in outputs.items()
    )
    return StageResult(stage.node, comparisons, failure)


def placed(recorded: RecordedProgram, topic: str) -> Columns:
    """Recorded columns of a topic. Axis states get the arc length of their set point, so that a report can show it."""
    columns = recorded.columns(topic)
    if topic == "/axis_state" and columns.count and "s_mm" not in columns.values:
        setpoints = recorded.columns("/axis_setpoint").values
        s_mm = dict(zip(map(int, setpoints["sequence"]), setpoints["s_mm"], strict=True))
        answered = columns.values["setpoint_sequence"]
        values = {**columns.values, "s_mm": [s_mm.get(int(number), np.nan) for number in answered]}
        return Columns(columns.count, values)
    return columns


def short_text(replay: Replay) -> Iterator[str]:
    """One line for a bag that agrees; otherwise the first and the largest difference of every stage that differs."""
    counted = sum(topic.recorded for stage in replay.stages for topic in stage.topics)
    nodes = ", ".join(stage.node for stage in replay.stages)
    if replay.agrees:
        yield f"{replay.path}: {counted} messages of {nodes} agree"
        return
    differing = [stage for stage in replay.stages if not stage.agrees]
    yield f"{replay.path}: DIFFERS, first in stage {differing[0].node}"
    for stage in differing:
        yield from _stage_lines(stage, whole=False)


def long_text(replay: Replay) -> Iterator[str]:
    """All differences, and every topic that was compared."""
    yield f"{replay.path}: {'agrees' if replay.agrees else 'DIFFERS'}"
    for stage in replay.stages:
        yield from _stage_lines(stage, whole=True)


def _stage_lines(stage: StageResult, *, whole: bool) -> Iterator[str]:
    if stage.failure:
        yield f"  {stage.node}: stopped: {stage.failure}"
    for topic in stage.topics:
        if topic.agrees and not whole:
            continue
        yield f"  {stage.node} {topic.topic}: {topic.recorded} messages recorded, {topic.replayed} replayed"
        if topic.unrecorded:
            yield f"    not in the bag, not compared: {', '.join(topic.unrecorded)}"
        for name, count in topic.differing.items():
            if whole:
                yield f"    {name} differs in {count} messages"
        yield from _difference_lines(topic, whole=whole)


def _difference_lines(topic: TopicComparison, *, whole: bool) -> Iterator[str]:
    if not topic.differences:
        return
    largest = topic.largest
    chosen = topic.differences if whole else topic.differences[:1]
    for difference in chosen:
        yield f"    {'' if whole else 'first: '}{_difference_text(difference)}"
    if not whole and largest is not None and largest is not topic.differences[0]:
        yield f"    largest: {_difference_text(largest)}"


def _difference_text(difference: Difference) -> str:
    element = f"[{difference.element}]" if difference.element >= 0 else ""
    beyond = (
        f", {difference.tolerance_ratio:.3g} times the tolerance" if np.isfinite(difference.tolerance_ratio) else ""
    )
    return (
        f"{difference.field}{element} was {difference.recorded}, is {difference.replayed}{beyond} ({difference.place})"
    )
