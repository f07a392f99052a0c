"""One program on a graph of its own, from the first process to the last exit code."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from feedopt_core.errors import FeedoptError
from feedopt_core.machine.machine_file import load_machine, machine_path
from feedopt_node.errors import SecondGraphError
from feedopt_node.graph import ParameterValue, load_graph
from feedopt_node.run import EXIT_SECOND_GRAPH
from feedopt_recorder.provenance import collect_provenance, write_provenance
from feedopt_recorder.run_folder import BAG_NAME
from feedopt_tools.errors import NodeDiedError
from feedopt_tools.execute.client import GraphClient, ProgramOutcome, ProgramRequest, Progress
from feedopt_tools.execute.domain_lock import DomainLock, domain_id
from feedopt_tools.execute.processes import GraphProcesses

LOGS_NAME = "logs"


@dataclass(frozen=True)
class RunOptions:
    """What to run and where its files go.

    Attributes:
        request: the program.
        machine: machine file or its name.
        directory: folder of the run: bag, logs, provenance.
        method: planning method; empty: as in config/nodes/planner.yaml.
        sim: with the simulated router.
    """

    request: ProgramRequest
    machine: str
    directory: Path
    method: str = ""
    sim: bool = True


@dataclass(frozen=True)
class RunEvents:
    """What the caller hears: a line for each stage, and progress many times a second."""

    stage: Callable[[str], None]
    progress: Callable[[Progress], None]


@dataclass
class Execution:
    """A finished run.

    Attributes:
        outcome: answer of the toolpath node; None where it never came.
        failure: what ended the run early; None: nothing did.
        exit_codes: of every node.
        remarks: where force was needed to end a node.
        bag: folder of the recording.
        start_s: from the first process to READY of all.
        missed_ticks, starved_chunk_sequence: last word of the interpolator.
    """

    bag: Path
    outcome: ProgramOutcome | None = None
    failure: FeedoptError | None = None
    interrupted: bool = False
    exit_codes: Mapping[str, int] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    start_s: float = 0.0
    missed_ticks: int = 0
    starved_chunk_sequence: int = 0

    @property
    def succeeded(self) -> bool:
        """The program was executed to its end and every node ended cleanly."""
        finished = self.failure is None and self.outcome is not None and self.outcome.succeeded
        return finished and not any(self.exit_codes.values()) and not self.remarks


def execute_program(options: RunOptions, events: RunEvents) -> Execution:
    """Start the graph, execute the program, end the graph.

    Ctrl-C and SIGTERM stop the program on the path first; a second one ends the nodes at once.

    Raises:
        SecondGraphError: a command already runs a graph on this domain.
        ConfigError: machine or installation cannot be used.
    """
    machine = load_machine(options.machine)
    with DomainLock(domain_id()):
        options.directory.mkdir(parents=True, exist_ok=True)
        graph = load_graph()
        present = graph.chosen_nodes(sim=options.sim)
        provenance = options.directory / "provenance.json"
        machine_file = str(machine_path(options.machine).absolute())
        nodes = graph.processes(present, machine_file, _extra(options, provenance))
        write_provenance(
            provenance,
            collect_provenance(
                machine_yaml=machine.yaml_text,
                # As they were asked for: where files stand on this computer tells nothing on another.
                parameters={
                    node.name: node.parameters_yaml()
                    for node in graph.processes(present, options.machine, _chosen(options))
                },
                program_name=options.request.name,
                program_text=_program_text(options.request),
                tolerance_mm=options.request.tolerance_mm,
                transition_reach_mm=options.request.transition_reach_mm,
                transition_side=options.request.transition_side,
                method=options.method,
            ),
        )
        processes = GraphProcesses(nodes, options.directory / LOGS_NAME)
        execution = Execution(bag=options.directory / BAG_NAME)
        with _sigterm_as_interrupt():
            _run(execution, options, processes, present, events)
    return execution


def _run(
    execution: Execution, options: RunOptions, processes: GraphProcesses, present: Sequence[str], events: RunEvents
) -> None:
    began_s = time.monotonic()
    client: GraphClient | None = None
    try:
        events.stage(f"starting {', '.join(present)}")
        processes.start()
        client = GraphClient(present, processes.check)
        client.wait_ready()
        execution.start_s = time.monotonic() - began_s
        events.stage(f"ready after {execution.start_s:.1f} s")
        execution.outcome = _execute(client, options.request, execution, events)
    except KeyboardInterrupt:
        execution.interrupted = True
    except NodeDiedError as error:
        second = error.exit_code == EXIT_SECOND_GRAPH
        execution.failure = SecondGraphError(str(error)) if second else error
    except FeedoptError as error:
        execution.failure = error
    finally:
        events.stage("ending the nodes")
        execution.exit_codes = processes.stop()
        execution.remarks = tuple(processes.remarks)
        if client is not None:
            interpolator = client.statuses.get("interpolator")
            if interpolator is not None:
                execution.missed_ticks = int(interpolator.missed_ticks)
                execution.starved_chunk_sequence = int(interpolator.starved_chunk_sequence)
            client.close()


def _execute(client: GraphClient, request: ProgramRequest, execution: Execution, events: RunEvents) -> ProgramOutcome:
    client.send(request)
    try:
        # Within the try: who reads this line may interrupt at once, and the program stops on the path.
        events.stage(f"executing {request.name}")
        return client.follow(events.progress)
    except KeyboardInterrupt:
        execution.interrupted = True
        client.cancel()
        events.stage("stopping on the path; once more to end at once")
        return client.follow(events.progress)


def _chosen(options: RunOptions) -> dict[str, dict[str, ParameterValue]]:
    """Parameters that the caller chose."""
    return {"planner": {"method": options.method}} if options.method else {}


def _extra(options: RunOptions, provenance: Path) -> dict[str, dict[str, ParameterValue]]:
    recorder: dict[str, ParameterValue] = {
        "bag_directory": str((options.directory / BAG_NAME).absolute()),
        "provenance_file": str(provenance.absolute()),
    }
    return {"recorder": recorder, **_chosen(options)}


def _program_text(request: ProgramRequest) -> str:
    """The program as far as it is text; the toolpath node judges it."""
    if request.path is None:
        return request.text
    try:
        return request.path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


@contextmanager
def _sigterm_as_interrupt() -> Iterator[None]:
    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
