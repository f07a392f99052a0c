"""Programs one after the other on one graph: good ones, bad ones, cancelled ones. The nodes outlive them all."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from graph_run import PATIENCE_S, TINY, RunningGraph

from feedopt_core.config_files import config_directory
from feedopt_core.errors import Failure, FailureKind
from feedopt_node.run import EXIT_SECOND_GRAPH
from feedopt_recorder.bags.check_bag import check_run
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_tools.execute.client import ProgramOutcome, ProgramRequest, Progress
from feedopt_tools.execute.line_sender import BLOCK_LINES, BLOCKS_AHEAD
from feedopt_tools.execute.processes import executable_path

pytestmark = pytest.mark.graph


def refused(outcome: ProgramOutcome) -> Failure:
    """Failure of a program that cannot be read."""
    assert outcome.failure is not None
    assert outcome.failure.kind is FailureKind.PROGRAM
    return outcome.failure


def assert_runs_a_good_program(graph: RunningGraph) -> None:
    outcome = graph.run_text(TINY)
    assert outcome.succeeded, outcome.failure
    assert outcome.path_length_mm > 10.0
    assert outcome.motion_time_s > 0.0
    graph.processes.check()


@pytest.mark.parametrize(
    ("text", "line", "column", "message"),
    [
        ("x_mm,y_mm\n0,0\n4,zero\n8,0\n", 3, 3, "'zero' is not a number"),
        ("0,0\n1,1\n2,nan\n", 3, 3, "not a finite number"),
        ("0,0\n1,1,1\n", 2, 5, "has 3 fields"),
        ("", 1, 1, "holds no points"),
        ("0,0\n0,0\n", 2, 1, "repeats the point"),
    ],
)
def test_a_bad_program_is_rejected_with_its_place(
    graph: RunningGraph, text: str, line: int, column: int, message: str
) -> None:
    outcome = graph.run_text(text)
    failure = refused(outcome)
    assert (failure.source, failure.line, failure.column) == ("tiny.csv", line, column)
    assert message in failure.message
    assert outcome.segments == 0


def test_after_bad_programs_a_good_one_runs(graph: RunningGraph) -> None:
    refused(graph.run_text("nothing"))
    assert_runs_a_good_program(graph)


def test_a_missing_file_is_rejected_by_name(graph: RunningGraph, tmp_path: Path) -> None:
    path = tmp_path / "none.csv"
    outcome = graph.run(ProgramRequest("none.csv", path=path))
    assert str(path) in str(refused(outcome))


def test_a_streamed_program_is_the_same_as_its_text(graph: RunningGraph) -> None:
    """More blocks than may be under way at once: the sender has to wait for the reader."""
    remarks = "(nothing moves here)\n" * ((BLOCKS_AHEAD + 10) * BLOCK_LINES)
    text = f"G21 G90 G64 P0.05 F6000\n{remarks}G1 X10\nG3 Y5 J2.5\nG1 X-4\nM2\n"
    whole = graph.run(ProgramRequest("pocket.ngc", text=text))
    assert whole.succeeded, whole.failure
    assert whole.segments > 0
    streamed = graph.run(ProgramRequest("pocket.ngc", text=text, streamed=True))
    assert streamed.succeeded, streamed.failure
    assert (streamed.segments, streamed.path_length_mm) == (whole.segments, whole.path_length_mm)
    assert streamed.motion_time_s == pytest.approx(whole.motion_time_s, rel=1e-9)


def test_a_goal_that_no_transition_can_meet_is_rejected(graph: RunningGraph) -> None:
    outcome = graph.run(ProgramRequest("tiny.csv", text=TINY, transition_reach_mm=2.0, transition_side="above"))
    assert "no side 'above'" in refused(outcome).message
    outcome = graph.run(ProgramRequest("tiny.csv", text=TINY, transition_reach_mm=2.0))
    assert "list of points" in refused(outcome).message
    assert_runs_a_good_program(graph)


def test_a_streamed_program_may_be_bad(graph: RunningGraph) -> None:
    outcome = graph.run(ProgramRequest("bad.ngc", text="G21 F600\nG1 X10\nG1 X2-0\n", streamed=True))
    assert refused(outcome).line == 3
    assert_runs_a_good_program(graph)


def test_a_cancelled_program_comes_to_rest_on_the_path(graph: RunningGraph) -> None:
    cancelled = []

    def cancel_in_motion(progress: Progress) -> None:
        if progress.s_commanded_mm > 1.0 and not cancelled:
            cancelled.append(progress)
            graph.client.cancel()

    path = config_directory() / "programs" / "fan_contour.csv"
    outcome = graph.run(ProgramRequest("fan", path=path), cancel_in_motion)
    assert cancelled
    assert outcome.failure is not None
    assert outcome.failure.kind is FailureKind.CANCELED
    assert_runs_a_good_program(graph)


def test_another_instance_of_a_node_gives_way(graph: RunningGraph) -> None:
    node = graph.nodes["router_sim"]
    command = [str(executable_path(node.package, node.executable)), *node.ros_arguments()]
    second = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE_S, check=False, env=dict(os.environ)
    )
    assert second.returncode == EXIT_SECOND_GRAPH
    assert "another router_sim already runs on this ROS domain" in second.stderr
    assert_runs_a_good_program(graph)


def test_the_bag_holds_every_program_whole(graph: RunningGraph) -> None:
    """Last in this module: it ends the graph, which must go with exit code 0 everywhere."""
    assert_runs_a_good_program(graph)
    codes = graph.processes.stop()
    assert codes == dict.fromkeys(graph.names, 0)
    assert graph.processes.remarks == []
    last = read_bag(graph.bag)
    assert check_run(last) == ()
    for program_id in last.program_ids:
        run = read_bag(graph.bag, program_id)
        assert np.array_equal(run.setpoints.sequence, np.arange(1, len(run.setpoints) + 1))
        assert np.array_equal(np.diff(run.setpoints.tick), np.ones(len(run.setpoints) - 1))
        assert run.setpoints.tick[0] < 0
        assert np.array_equal(run.states.setpoint_sequence, run.setpoints.sequence)
        assert run.setpoints.last[-1] and run.states.last[-1]
        assert run.setpoints.feedrate_mm_s[-1] == 0.0
        # At rest from the first set point to the last: also where the program was cancelled.
        steps = np.abs(np.diff(run.setpoints.position_mm, axis=0))
        assert np.all(steps <= 0.001 * np.array(run.machine.velocity_limit_mm_s) * 1.001)
        assert np.all(steps[0] == 0.0) and np.all(steps[-1] == 0.0)
