"""Executes a recorded program again on a running graph: for ``feedopt replay --live`` and to remake golden bags."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import yaml

from feedopt_node.errors import SecondGraphError
from feedopt_node.graph import load_graph
from feedopt_recorder.bags.check_bag import check_bag
from feedopt_tools.errors import ReplayInputError
from feedopt_tools.execute.client import ProgramRequest
from feedopt_tools.execute.domain_lock import DomainLock
from feedopt_tools.execute.execution import RunEvents, RunOptions, execute_program
from feedopt_tools.replay.recorded_program import RecordedProgram
from feedopt_tools.replay.stages import STAGES

_DOMAINS = range(100, 0, -1)
# Parameters that the run sets itself or takes from its options; the period stands in the machine file today.
_OWN = frozenset({"machine", "present_nodes", "bag_directory", "provenance_file", "method", "period_s"})


def record_again(recorded: RecordedProgram, directory: Path, stage: Callable[[str], None]) -> Path:
    """Execute a recorded program again, with its machine and parameters, on a graph of its own.

    Args:
        recorded: program, machine and parameters.
        directory: empty folder for the run.
        stage: called with the name of each step.

    Returns:
        Folder of the new bag.

    Raises:
        ReplayInputError: a parameter file has changed since the recording.
        FeedoptError: the run ended early.
    """
    _refuse_other_parameters(recorded)
    program = recorded.program()
    inputs = directory / "inputs"
    inputs.mkdir(parents=True)
    path = inputs / Path(program.name).name
    path.write_text(program.text, encoding="utf-8")
    request = ProgramRequest(
        program.name,
        path=path,
        tolerance_mm=program.tolerance_mm,
        transition_reach_mm=program.transition_reach_mm,
        transition_side=program.transition_side,
    )
    method = str(recorded.node_parameters("planner").get("method", ""))
    machine = str(recorded.write_machine(inputs))
    options = RunOptions(request, machine, directory / "run", method, sim="router_sim" in recorded.nodes)
    return execute_whole(options, stage)


def execute_whole(options: RunOptions, stage: Callable[[str], None]) -> Path:
    """Execute a program on a free ROS domain and check that its bag is complete; returns the bag.

    Raises:
        ReplayInputError: the program was not executed to its end, or the bag has gaps.
        FeedoptError: the run ended early.
    """
    os.environ["ROS_DOMAIN_ID"] = str(free_domain())
    execution = execute_program(options, RunEvents(stage=stage, progress=lambda _: None))
    if execution.failure is not None:
        raise execution.failure
    if not execution.succeeded:
        message = execution.outcome.failure if execution.outcome else "it was interrupted"
        raise ReplayInputError(f"{options.request.name}: was not executed to its end: {message}")
    findings = check_bag(execution.bag)
    if findings:
        raise ReplayInputError(f"{execution.bag}: is not complete: {findings[0].place}: {findings[0].text}")
    return execution.bag


def free_domain() -> int:
    """A ROS domain without a running graph. Raises SecondGraphError if there is none."""
    for domain in _DOMAINS:
        try:
            with DomainLock(domain):
                return domain
        except SecondGraphError:
            continue
    raise SecondGraphError("a graph runs on every ROS domain: wait until one ends")


def _refuse_other_parameters(recorded: RecordedProgram) -> None:
    graph = load_graph()
    for node in (stage.node for stage in STAGES if stage.node in recorded.nodes):
        (process,) = graph.processes([node], "")
        today = yaml.safe_load(process.parameters_yaml())[node]["ros__parameters"]
        for name, value in recorded.node_parameters(node).items():
            if name not in _OWN and today.get(name) != value:
                raise ReplayInputError(
                    f"{recorded.path}: {node} ran with {name} = {value}, its parameter file now says "
                    f"{today.get(name)}: restore it, or replay without --live"
                )
