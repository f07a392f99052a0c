"""Planning in a thread of its own, so that messages are received while a window is solved. Free of ROS."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from feedopt_core.geometry.segments import Segment
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.chunk import Chunk
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner


@dataclass(frozen=True)
class PlanningEvents:
    """Callbacks of the planning thread, called from that thread.

    Attributes:
        planned: a chunk was committed.
        path_needed: every segment was used and planning needs more path.
        finished: the last chunk was committed.
        failed: planning of the program failed; no further chunk follows.
    """

    planned: Callable[[int, Chunk], None]
    path_needed: Callable[[], None]
    finished: Callable[[int], None]
    failed: Callable[[int, Exception], None]


@dataclass
class _Program:
    program_id: int
    planner: StreamPlanner
    inbox: deque[Segment] = field(default_factory=deque)
    motion_time_s: float = 0.0
    reached_s_mm: float = 0.0
    starved: int = 0
    restarted: int = 0
    reported_path_needed: bool = False
    reported_finished: bool = False


class PlanningThread:
    """Plans one program at a time, at most ``seconds_ahead`` of motion time ahead of the interpolator.

    Segments wait in an inbox until the planner needs them. Back-pressure counts only segments taken from the inbox.

    Raises:
        ConfigError, InfeasibleLimitsError: planning is impossible with this machine or method.
    """

    def __init__(
        self, machine: Machine, parameters: PlannerParameters, seconds_ahead: float, events: PlanningEvents
    ) -> None:
        StreamPlanner(machine, parameters)
        self._machine = machine
        self._parameters = parameters
        self._seconds_ahead = seconds_ahead
        self._events = events
        self._program: _Program | None = None
        self._latest: StreamPlanner | None = None
        self._closing = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="planning", daemon=True)

    @property
    def last_segment_sequence(self) -> int:
        """Last segment that the planner has taken from the inbox."""
        return self._latest.last_segment_sequence if self._latest else 0

    @property
    def committed(self) -> tuple[float, float]:
        """Arc length, mm, and motion time, s, up to which motion is committed."""
        return (self._latest.committed_s_mm, self._latest.committed_t_s) if self._latest else (0.0, 0.0)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def open(self, program_id: int) -> None:
        """Begin a program; the rest of the previous one is dropped."""
        with self._changed:
            self._latest = StreamPlanner(self._machine, self._parameters)
            self._program = _Program(program_id, self._latest)
            self._changed.notify()

    def add_segment(self, segment: Segment) -> None:
        """Put a segment of the open program into the inbox."""
        with self._changed:
            if self._program is not None:
                self._program.inbox.append(segment)
                self._changed.notify()

    def motion_reached(
        self, program_id: int, *, motion_time_s: float, s_mm: float, starved_chunk_sequence: int
    ) -> None:
        """Store the progress of the interpolator and the chunk whose stop it executed because no chunk arrived."""
        with self._changed:
            if self._program is not None and self._program.program_id == program_id:
                self._program.motion_time_s = motion_time_s
                self._program.reached_s_mm = s_mm
                self._program.starved = starved_chunk_sequence
                self._changed.notify()

    def abandon(self, program_id: int) -> bool:
        """Drop a program; False if it was not open."""
        with self._changed:
            if self._program is None or self._program.program_id != program_id:
                return False
            self._program = None
            return True

    def close(self) -> None:
        """End the thread after its current window."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while (program := self._next_program()) is not None:
            try:
                self._step(program)
            # Any error in planning is a FAULT of its program and must not end the node.
            except Exception as error:  # noqa: BLE001
                if self.abandon(program.program_id):
                    self._events.failed(program.program_id, error)

    def _next_program(self) -> _Program | None:
        """Wait until there is work for the open program."""
        with self._changed:
            while not self._closing:
                if self._program is not None and self._has_work(self._program):
                    return self._program
                self._changed.wait()
            return None

    def _has_work(self, program: _Program) -> bool:
        if program.starved != program.restarted:
            return True
        if program.planner.finished:
            return not program.reported_finished
        ahead_s = program.planner.committed_t_s - program.motion_time_s
        return ahead_s < self._seconds_ahead and (bool(program.inbox) or not program.reported_path_needed)

    def _step(self, program: _Program) -> None:
        planner = program.planner
        if program.starved != program.restarted:
            program.restarted = program.starved
            planner.restart_after_stop(program.restarted)
            program.reported_finished = program.reported_path_needed = False
        planner.discard_before(program.reached_s_mm)
        chunk = planner.next_chunk()
        with self._changed:
            # The lock is held during the report: a program that was dropped in the meantime must not report.
            if self._program is program:
                self._report(program, chunk)

    def _report(self, program: _Program, chunk: Chunk | None) -> None:
        planner = program.planner
        if chunk is not None:
            self._events.planned(program.program_id, chunk)
        elif planner.finished:
            program.reported_finished = True
            self._events.finished(program.program_id)
        elif program.inbox:
            program.reported_path_needed = False
            planner.add_segment(program.inbox.popleft())
        else:
            program.reported_path_needed = True
            self._events.path_needed()
