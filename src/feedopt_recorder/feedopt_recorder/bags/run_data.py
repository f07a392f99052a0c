"""A recorded run in memory."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.errors import Failure
from feedopt_core.geometry.segments import Segment
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.chunk import Chunk
from feedopt_msgs.msg import NodeStatus

_STATE_NAMES = {getattr(NodeStatus, name): name for name in ("STARTING", "READY", "RUNNING", "DONE", "FAULT")}

T = TypeVar("T", bound="SampleArrays")


@dataclass(frozen=True)
class SampleArrays:
    """What set points and states have in common; arrays of shape (n,), in order of arrival.

    Attributes:
        stamp_ns: wall-clock time when the sample was due, ns since the epoch.
        received_ns: when the recorder received it.
        program_id, sequence, tick, last: as in the message.
        period_s: time between two samples.
    """

    stamp_ns: IntArray
    received_ns: IntArray
    program_id: IntArray
    sequence: IntArray
    tick: IntArray
    last: NDArray[np.bool_]
    period_s: float

    def __len__(self) -> int:
        return len(self.tick)

    @property
    def t_s(self) -> FloatArray:
        """Motion time, s: 0 at the start of motion, negative at rest before it."""
        return np.asarray(self.tick * self.period_s, dtype=np.float64)

    def of_program(self: T, program_id: int) -> T:
        """The rows of one program."""
        return self.rows(self.program_id == program_id)

    def rows(self: T, selection: slice | IntArray | NDArray[np.bool_]) -> T:
        """Some of the rows, in order."""
        arrays = [field.name for field in fields(self) if field.name != "period_s"]
        values: dict[str, Any] = {name: getattr(self, name)[selection] for name in arrays}
        return replace(self, **values)


@dataclass(frozen=True)
class SetpointArrays(SampleArrays):
    """Set points; axis arrays have shape (n, axes).

    Attributes:
        chunk_sequence: chunk each was taken from; 0: rest before the first.
        s_mm, feedrate_mm_s: arc length and feedrate along the path.
        position_mm, velocity_mm_s, acceleration_mm_s2: of the axes.
        lateness_s: how long after its deadline each was published.
    """

    chunk_sequence: IntArray
    s_mm: FloatArray
    feedrate_mm_s: FloatArray
    position_mm: FloatArray
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    lateness_s: FloatArray


@dataclass(frozen=True)
class StateArrays(SampleArrays):
    """States of the axes; axis arrays have shape (n, axes).

    Attributes:
        setpoint_sequence: the set point each answers.
        reference_mm, position_mm, velocity_mm_s: commanded position, measured position, velocity.
        tracking_error_mm: reference minus measured position.
        control_signal_volts: output of the controller; ``saturated`` where it stands at its limit.
    """

    setpoint_sequence: IntArray
    reference_mm: FloatArray
    position_mm: FloatArray
    velocity_mm_s: FloatArray
    tracking_error_mm: FloatArray
    control_signal_volts: FloatArray
    saturated: NDArray[np.bool_]


@dataclass(frozen=True)
class StatusRow:
    """One report of one node, as in NodeStatus; ``failure`` is the cause of a FAULT, None in any other state."""

    received_ns: int
    node: str
    state: int
    program_id: int
    last_input_sequence: int
    last_output_sequence: int
    s_mm: float
    motion_time_s: float
    missed_ticks: int
    starved_chunk_sequence: int
    text: str
    failure: Failure | None

    @property
    def state_name(self) -> str:
        """Name of the state, as in NodeStatus."""
        return _STATE_NAMES.get(self.state, f"state {self.state}")

    @property
    def said(self) -> str:
        """The cause of a FAULT, or the remark of the node; empty: neither."""
        return self.text if self.failure is None else str(self.failure)


@dataclass(frozen=True)
class RunData:
    """One program of a bag.

    Attributes:
        path: the bag.
        program_id: the program; ``program_ids`` are all that the bag holds.
        machine: None where the bag has no ``/machine``.
        setpoints, states: one a period; without rows if they were not recorded.
        chunks, segments: in order.
        statuses: of every node and program, in order of arrival.
        provenance: MCAP metadata records, by name.
        complete: the file has its footer; false for a recorder that was killed.
    """

    path: Path
    program_id: int
    program_ids: tuple[int, ...]
    machine: Machine | None
    setpoints: SetpointArrays
    states: StateArrays
    chunks: tuple[Chunk, ...]
    segments: tuple[Segment, ...]
    statuses: tuple[StatusRow, ...]
    provenance: dict[str, dict[str, str]]
    complete: bool

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the axes; ``axis 0``, ... without a machine."""
        if self.machine is not None:
            return self.machine.axis_names
        return tuple(f"axis {i}" for i in range(self.setpoints.position_mm.shape[1]))

    @property
    def title(self) -> str:
        """Name of the program, else of the bag."""
        return self.provenance.get("feedopt/program", {}).get("name", "") or self.path.name

    @property
    def motion_time_s(self) -> float:
        """Time of the last set point that still moves, s."""
        moving = np.flatnonzero(self.setpoints.feedrate_mm_s > 0.0)
        return float(self.setpoints.t_s[moving[-1]]) if len(moving) else 0.0
