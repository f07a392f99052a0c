"""Set points in time: exact s(t) from the feed profile, then r(s) from the toolpath, in blocks of equidistant ticks.

Set points are equidistant in time from the standstill before the motion to the standstill after it. This also holds
while the machine waits on the path because no further chunk came in time. The motion ends at the first tick at or after
the end of the last profile.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import Segment
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.chunk import Chunk
from feedopt_core.schema import parameter

_JOIN_MM = 1e-6


@dataclass(frozen=True)
class InterpolatorParameters:
    """Parameters of the interpolator; the same names stand in config/nodes/interpolator.yaml."""

    rest_before_ticks: int = parameter(
        "Set points at standstill before the motion.", default=50, at_least=0, at_most=10_000
    )
    rest_after_ticks: int = parameter(
        "Set points at standstill after it, while the servo settles.", default=250, at_least=0, at_most=10_000
    )


@dataclass(frozen=True)
class SetpointBlock:
    """Consecutive set points; arrays of shape (n,) or (n, n_axes).

    Attributes:
        tick: sample index, 0 at the start of motion, negative before.
        chunk_sequence: chunk each sample was taken from; 0 before the first.
        s_mm, v_mm_s: arc length and feedrate along the path.
        position_mm, velocity_mm_s, acceleration_mm_s2: of the axes.
        finished: the last row is the last set point of the program.
    """

    tick: IntArray
    chunk_sequence: IntArray
    s_mm: FloatArray
    v_mm_s: FloatArray
    position_mm: FloatArray
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    finished: bool


class SetpointStream:
    """Interpolates one program: segments and chunks in, blocks of set points out.

    Attributes:
        starved_chunk_sequence: chunk whose stop was taken last because no further chunk came in time; 0: none.
    """

    def __init__(self, machine: Machine, parameters: InterpolatorParameters) -> None:
        self.toolpath = Toolpath()
        self.starved_chunk_sequence = 0
        self._axis_matrix = machine.axis_matrix()
        self._period_s = machine.period_s
        self._parameters = parameters
        self._chunks: deque[Chunk] = deque()
        self._next_tick = -parameters.rest_before_ticks
        # Program time = tick * period - wait: the time spent waiting at standstill is not part of any profile.
        self._wait_s = 0.0
        self._end_tick: int | None = None

    @property
    def motion_time_s(self) -> float:
        """Program time of the next set point (0 before the motion)."""
        return max(0.0, self._next_tick * self._period_s - self._wait_s)

    def add_segment(self, segment: Segment) -> None:
        """Append the next segment. Raises ToolpathError where it does not start at the end of the one before."""
        self.toolpath.append(segment)

    def add_chunk(self, chunk: Chunk) -> bool:
        """Append the next chunk; False where it is refused because the machine already takes the stop before it.

        Raises:
            ToolpathError: the chunk does not continue the ones before.
        """
        if not self._chunks:
            if abs(chunk.s_start_mm) > _JOIN_MM:
                raise ToolpathError(
                    f"the first feed-profile chunk starts at s = {chunk.s_start_mm:g} mm, not at 0: a chunk is lost"
                )
            self._chunks.append(chunk)
            return True
        before = self._chunks[-1]
        if self.starved_chunk_sequence == before.sequence:
            if abs(chunk.s_start_mm - before.s_stop_mm) > _JOIN_MM:
                return False
            # The machine rests (or is about to) where this chunk starts; it leaves at the first tick at which both
            # hold.
            stopped_s = before.t_start_s + before.profile.duration_s
            self._wait_s += max(self.motion_time_s, stopped_s) - chunk.t_start_s
        elif abs(chunk.s_start_mm - before.s_commit_mm) > _JOIN_MM:
            raise ToolpathError(
                f"feed-profile chunk {chunk.sequence} starts at s = {chunk.s_start_mm:g} mm, the one before ends at "
                f"{before.s_commit_mm:g} mm: a chunk is lost"
            )
        self._chunks.append(chunk)
        return True

    def next_block(self, count: int) -> SetpointBlock | None:
        """The next set points, at most ``count``; None before the first chunk and after the last set point.

        Raises:
            ToolpathError: the path of the chunks has not arrived.
        """
        if not self._chunks or (self._end_tick is not None and self._next_tick > self._end_tick):
            return None
        ticks = np.arange(self._next_tick, self._next_tick + count)
        self._find_end(int(ticks[-1]))
        if self._end_tick is not None:
            ticks = ticks[ticks <= self._end_tick]
        t_s = np.asarray(ticks * self._period_s - self._wait_s, dtype=np.float64)
        s, v, a, source = self._motion(t_s)
        points = self.toolpath.evaluate(s)
        k = self._axis_matrix
        self._next_tick += len(ticks)
        self._forget(float(s[0]), float(t_s[0]))
        return SetpointBlock(
            tick=ticks,
            chunk_sequence=source,
            s_mm=s,
            v_mm_s=v,
            position_mm=points.r_mm @ k.T,
            velocity_mm_s=v[:, None] * (points.dr_ds @ k.T),
            acceleration_mm_s2=(v**2)[:, None] * (points.d2r_ds2 @ k.T) + a[:, None] * (points.dr_ds @ k.T),
            finished=self._end_tick is not None and self._next_tick > self._end_tick,
        )

    def _find_end(self, last_tick: int) -> None:
        """Set the last tick once the last chunk is here; before that, note a stop taken for lack of the next chunk."""
        newest = self._chunks[-1]
        if newest.last:
            # The 1e-9 is slack for rounding: a motion time of a whole number of ticks must not get one more.
            motion_end = int(np.ceil((newest.t_commit_s + newest.dwell_s + self._wait_s) / self._period_s - 1e-9))
            self._end_tick = motion_end + self._parameters.rest_after_ticks
        elif last_tick * self._period_s - self._wait_s >= newest.t_commit_s + newest.dwell_s:
            self.starved_chunk_sequence = newest.sequence

    def _motion(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Path motion and chunk at each instant; standstill before the first chunk and after the last."""
        starts = np.array([chunk.t_start_s for chunk in self._chunks])
        owner = np.clip(np.searchsorted(starts, t_s, side="right") - 1, 0, len(starts) - 1)
        s, v, a = np.empty_like(t_s), np.empty_like(t_s), np.empty_like(t_s)
        source = np.empty(len(t_s), dtype=np.int64)
        for index in np.unique(owner):
            chunk, here = self._chunks[index], owner == index
            # Before its start or after its end, a profile with a standstill there stays in it.
            states = chunk.profile.states_at(t_s[here] - chunk.t_start_s)
            s[here], v[here], a[here] = states.s_mm, states.v_mm_s, states.a_mm_s2
            source[here] = chunk.sequence
        source[t_s < 0.0] = 0
        return s, v, a, source

    def _forget(self, s_mm: float, t_s: float) -> None:
        """Drop chunks and path that the set points have passed."""
        while len(self._chunks) > 1 and self._chunks[1].t_start_s <= t_s:
            self._chunks.popleft()
        self.toolpath.discard_before(s_mm)
