"""Set points of one program, shared by the executor, which adds the inputs, and the tick threads. Free of ROS."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import replace

import numpy as np

from feedopt_core.errors import Failure
from feedopt_core.geometry.segments import Segment
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.chunk import Chunk
from feedopt_core.motion.setpoints import InterpolatorParameters, SetpointBlock, SetpointStream


class ProgramMotion:
    """Thread-safe set-point stream of one program.

    Args:
        program_id: the program.
        machine, parameters: machine and parameters of the stream.
        start_ahead_s: motion time that must be committed before the first set point, unless the program is shorter.

    Attributes:
        program_id: the program.
        failure: cause of the FAULT with which the program ends; None: no FAULT.
    """

    def __init__(
        self, program_id: int, machine: Machine, parameters: InterpolatorParameters, start_ahead_s: float
    ) -> None:
        self.program_id = program_id
        self.failure: Failure | None = None
        self._stream = SetpointStream(machine, parameters)
        self._waiting: deque[Chunk] = deque()
        self._last_segment = 0
        self._start_ahead_s = start_ahead_s
        self._may_start = False
        self._abandoned = False
        self._changed = threading.Condition()

    @property
    def motion_time_s(self) -> float:
        """Motion time reached, s."""
        return self._stream.motion_time_s

    @property
    def starved_chunk_sequence(self) -> int:
        """Chunk whose stop was executed because the next chunk did not arrive in time; 0: none."""
        return self._stream.starved_chunk_sequence

    def add_segment(self, segment: Segment) -> None:
        """Add the next segment. Raises ToolpathError if it does not continue the previous one."""
        with self._changed:
            self._stream.add_segment(segment)
            self._last_segment = segment.place.sequence
            self._admit()

    def add_chunk(self, chunk: Chunk) -> None:
        """Add the next chunk; it waits until its path has arrived, because ROS keeps no order between topics.

        Raises:
            ToolpathError: it does not continue the previous chunk.
        """
        with self._changed:
            self._waiting.append(chunk)
            self._admit()

    def abandon(self, failure: Failure | None = None) -> None:
        """Stop on the path with the stop of the last chunk, and end: no further chunk will arrive."""
        with self._changed:
            self._abandoned = True
            self.failure = self.failure or failure
            self._changed.notify_all()

    def next_block(self, count: int) -> SetpointBlock | None:
        """The next set points; waits for the first ones. None if the program was abandoned before the first set point.

        Raises:
            FeedoptError: the set points cannot be computed.
        """
        with self._changed:
            while not self._may_start or (block := self._stream.next_block(count)) is None:
                if self._abandoned:
                    return None
                self._changed.wait()
            if self._abandoned and self.starved_chunk_sequence and not np.any(block.v_mm_s):
                return replace(block, finished=True)
            return block

    def _admit(self) -> None:
        while self._waiting and self._waiting[0].last_segment_sequence <= self._last_segment:
            chunk = self._waiting.popleft()
            self._stream.add_chunk(chunk)
            self._may_start = self._may_start or chunk.last or chunk.t_commit_s >= self._start_ahead_s
            self._changed.notify_all()
