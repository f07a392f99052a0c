"""Buffers the moves of a program; straight moves are gathered into blocks."""

from __future__ import annotations

import math

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.programs.moves import ArcMove, LineMoves, Move, NurbsMove, PathMode, ProgramEvent


class MoveBuffer:
    """Gathers straight moves of one kind into one block, keeps the order with everything else.

    Attributes:
        points_mm, lines, feeds_mm_s: buffered straight moves: the first ``count`` rows.
        count: number of buffered moves.
        rapid: the buffered moves are rapids.
    """

    def __init__(self, capacity: int) -> None:
        self.points_mm = np.empty((capacity, 3))
        self.lines = np.empty(capacity, dtype=np.int64)
        self.feeds_mm_s = np.empty(capacity)
        self.count = 0
        self.rapid = False
        self._mode = PathMode()
        self._start_mm = np.zeros(3)
        self._ready: list[Move] = []

    def begin(self, start_mm: FloatArray, mode: PathMode) -> None:
        """Set start and mode of the next straight moves; buffered moves in another mode are flushed."""
        if self.count and mode != self._mode:
            self.flush()
        if not self.count:
            self._start_mm = start_mm.copy()
            self._mode = mode

    def straight(self, start_mm: FloatArray, end_mm: FloatArray, line: int, feed_mm_s: float, mode: PathMode) -> None:
        """Add a straight move; an infinite feed is a rapid."""
        rapid = math.isinf(feed_mm_s)
        if self.count == len(self.lines) or (self.count and rapid != self.rapid):
            self.flush()
        self.begin(start_mm, mode)
        self.rapid = rapid
        self.points_mm[self.count] = end_mm
        self.lines[self.count] = line
        self.feeds_mm_s[self.count] = feed_mm_s
        self.count += 1

    def add(self, move: ArcMove | NurbsMove | ProgramEvent) -> None:
        """Add anything else."""
        self.flush()
        self._ready.append(move)

    def flush(self) -> None:
        """Turn the buffered straight moves into one block."""
        if self.count:
            self._ready.append(
                LineMoves(
                    self._start_mm,
                    self.points_mm[: self.count].copy(),
                    self.lines[: self.count].copy(),
                    self.feeds_mm_s[: self.count].copy(),
                    self.rapid,
                    self._mode,
                )
            )
            self.count = 0

    def take(self) -> list[Move]:
        """Everything that is ready, in order."""
        ready, self._ready = self._ready, []
        return ready
