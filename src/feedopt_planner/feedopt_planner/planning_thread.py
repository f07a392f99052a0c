"""Planning beside the executor, so that messages are taken while a window is solved. Free of ROS."""

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
    """What the thread calls, from itself.

    Attributes:
        planned: a chunk was committed.
        hungry: every segment was taken and more path is needed.
        finished: the last chunk was committed.
        failed: the program cannot be planned on; nothing more comes for it.
    """

    planned: Callable[[int, Chunk], None]
    hungry: Callable[[], None]
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
    told_hungry: bool = False
    told_finished: bool = False


class PlanningThread:
    """Plans one program at a time, at most ``seconds_ahead`` beyond the motion.

    Segments wait in an inbox until the planner needs them: what it has taken in is what back-pressure counts.

    Raises:
        ConfigError, InfeasibleLimitsError: the machine or the method cannot be planned with at all.
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
        """Last segment the planner has taken in."""
        return self._latest.last_segment_sequence if self._latest else 0

    @property
    def committed(self) -> tuple[float, float]:
        """Arc length, mm, and motion time, s, up to which motion is committed."""
        return (self._latest.committed_s_mm, self._latest.committed_t_s) if self._latest else (0.0, 0.0)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def open(self, program_id: int) -> None:
        """Begin a program; what is left of the one before is dropped."""
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
        """Note how far the interpolator is, and whether it took a stop because no chunk came."""
        with self._changed:
            if self._program is not None and self._program.program_id == program_id:
                self._program.motion_time_s = motion_time_s
                self._program.reached_s_mm = s_mm
                self._program.starved = starved_chunk_sequence
                self._changed.notify()

    def abandon(self, program_id: int) -> bool:
        """Drop a program; False where it was not open."""
        with self._changed:
            if self._program is None or self._program.program_id != program_id:
                return False
            self._program = None
            return True

    def close(self) -> None:
        """End the thread after the window it is solving."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while (program := self._next_program()) is not None:
            try:
                self._step(program)
            # Whatever goes wrong in a plan is a FAULT of its program, not the end of the node.
            except Exception as error:  # noqa: BLE001
                if self.abandon(program.program_id):
                    self._events.failed(program.program_id, error)

    def _next_program(self) -> _Program | None:
        """Wait until the open program has something to plan."""
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
            return not program.told_finished
        ahead_s = program.planner.committed_t_s - program.motion_time_s
        return ahead_s < self._seconds_ahead and (bool(program.inbox) or not program.told_hungry)

    def _step(self, program: _Program) -> None:
        planner = program.planner
        if program.starved != program.restarted:
            program.restarted = program.starved
            planner.restart_after_stop(program.restarted)
            program.told_finished = program.told_hungry = False
        planner.discard_before(program.reached_s_mm)
        chunk = planner.next_chunk()
        with self._changed:
            # Held while reporting: a program that was dropped meanwhile must not report any more.
            if self._program is program:
                self._report(program, chunk)

    def _report(self, program: _Program, chunk: Chunk | None) -> None:
        planner = program.planner
        if chunk is not None:
            self._events.planned(program.program_id, chunk)
        elif planner.finished:
            program.told_finished = True
            self._events.finished(program.program_id)
        elif program.inbox:
            program.told_hungry = False
            planner.add_segment(program.inbox.popleft())
        else:
            program.told_hungry = True
            self._events.hungry()
