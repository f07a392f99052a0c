"""Set points computed ahead of their ticks in a separate thread, because one block takes longer than a period."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

from feedopt_interpolator.conversions import SetpointRows
from feedopt_interpolator.program_motion import ProgramMotion
from feedopt_interpolator.real_time import request_real_time_priority

BLOCK_TICKS = 20
BLOCKS_AHEAD = 2


class SetpointBuffer:
    """The next blocks of set points of a program, ready for publishing.

    Args:
        motion: the program.
        priority: SCHED_FIFO priority of the computing thread.
        starved: called from that thread when the motion stops because the next chunk did not arrive in time.
    """

    def __init__(self, motion: ProgramMotion, priority: int, starved: Callable[[ProgramMotion], None]) -> None:
        self._motion = motion
        self._priority = priority
        self._starved = starved
        self._blocks: deque[SetpointRows] = deque()
        self._error: Exception | None = None
        self._ended = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="set points", daemon=True)

    def start(self) -> None:
        """Start computing."""
        self._thread.start()

    def take(self) -> SetpointRows | None:
        """Wait for the next block and return it; None after the last.

        Raises:
            Exception: the error raised while the block was computed.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._blocks or self._ended)
            if self._blocks:
                self._changed.notify()
                return self._blocks.popleft()
            if self._error is not None:
                raise self._error
            return None

    def close(self) -> None:
        """Stop computing."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._motion.abandon()
        self._thread.join()

    def _run(self) -> None:
        request_real_time_priority(self._priority)
        starved = 0
        try:
            while (rows := self._next()) is not None:
                with self._changed:
                    self._blocks.append(rows)
                    self._changed.notify()
                if self._motion.starved_chunk_sequence != starved:
                    starved = self._motion.starved_chunk_sequence
                    self._starved(self._motion)
                if rows.finished:
                    break
        # Passed to the thread that takes the blocks, which reports the failure of the program.
        except Exception as error:  # noqa: BLE001
            self._error = error
        with self._changed:
            self._ended = True
            self._changed.notify()

    def _next(self) -> SetpointRows | None:
        with self._changed:
            self._changed.wait_for(lambda: len(self._blocks) < BLOCKS_AHEAD or self._ended)
            if self._ended:
                return None
        block = self._motion.next_block(BLOCK_TICKS)
        return None if block is None else SetpointRows(block)
