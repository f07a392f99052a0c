"""The signals of a run that every view and picture shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.quantities import AxisMotion, control_signal, tracking_error
from feedopt_core.machine.machine_file import Machine
from feedopt_recorder.bags.run_data import RunData, SetpointArrays
from feedopt_tools.errors import ViewError


@dataclass(frozen=True)
class Quantity:
    """A limited quantity of every axis.

    Attributes:
        key: name in the recording.
        title: name on the axis of a plot, with its unit.
        commanded: at the set points, shape (n, axes); None where the drive model is not known.
        measured: at the states, shape (m, axes); None for what is not measured.
        limit: one for each axis, infinity for an axis without one; None where no axis has one.
        planned_limit: what a plan may use of it; the rest is left to the servo.
    """

    key: str
    title: str
    commanded: FloatArray | None
    measured: FloatArray | None
    limit: tuple[float, ...] | None
    planned_limit: tuple[float, ...] | None

    @property
    def drawn(self) -> bool:
        """There are values to draw."""
        return self.commanded is not None or self.measured is not None

    def limit_of(self, axis: int) -> float:
        """Limit of an axis; infinity without one."""
        return float("inf") if self.limit is None else self.limit[axis]


@dataclass(frozen=True)
class RunSignals:
    """All signals of one run.

    Attributes:
        t_s, s_mm, feedrate_mm_s, lateness_ms: at the set points, shape (n,).
        programmed_mm_s: programmed feed there; infinity where only the machine's limit holds. None without segments.
        tool_mm: commanded tool position, shape (n, 3).
        state_t_s, state_s_mm: time and arc length of the states, shape (m,).
        quantities: velocity, acceleration, jerk, control signal and tracking error of the axes.
    """

    run: RunData
    t_s: FloatArray
    s_mm: FloatArray
    feedrate_mm_s: FloatArray
    programmed_mm_s: FloatArray | None
    lateness_ms: FloatArray
    tool_mm: FloatArray
    state_t_s: FloatArray
    state_s_mm: FloatArray
    quantities: dict[str, Quantity]

    @property
    def feed_limit_mm_s(self) -> float:
        """Feed limit of the machine; NaN where it is not known."""
        return self.run.machine.feed_limit_mm_s if self.run.machine else float("nan")

    @property
    def top_feed_mm_s(self) -> float:
        """Largest feedrate of the run, at least one; the top of the colour scale."""
        return max(1.0, float(np.max(self.feedrate_mm_s)))


def signals_of(run: RunData) -> RunSignals:
    """Curves of a run.

    Raises:
        ViewError: the bag holds no set points of the program.
    """
    setpoints, states = run.setpoints, run.states
    if len(setpoints) < 2:
        raise ViewError(
            f"{run.path}: the recording holds no set points of program {run.program_id}, so there is nothing to draw"
        )
    answered = np.clip(np.searchsorted(setpoints.tick, states.tick), 0, len(setpoints) - 1)
    return RunSignals(
        run=run,
        t_s=setpoints.t_s,
        s_mm=setpoints.s_mm,
        feedrate_mm_s=setpoints.feedrate_mm_s,
        programmed_mm_s=_programmed_feed(run),
        lateness_ms=1e3 * setpoints.lateness_s,
        tool_mm=tool_from_axes(run.machine, setpoints.position_mm),
        state_t_s=states.t_s,
        state_s_mm=setpoints.s_mm[answered],
        quantities=_quantities(run),
    )


def speed_pieces(s_mm: FloatArray, count: int) -> list[tuple[int, int]]:
    """Split a path into pieces of equal length: index ranges (first, last), both included. Neighbours share a point."""
    marks = np.linspace(s_mm[0], s_mm[-1], count + 1)
    edges = np.unique(np.concatenate([[0], np.searchsorted(s_mm, marks[1:-1]), [len(s_mm) - 1]]))
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def jerk_of(setpoints: SetpointArrays) -> FloatArray:
    """Mean jerk of each axis between a set point and the one before, mm/s^3, shape (n, axes); zero for the first."""
    steps_s = np.maximum(np.diff(setpoints.tick), 1)[:, None] * setpoints.period_s
    jerk = np.diff(setpoints.acceleration_mm_s2, axis=0) / steps_s
    return np.asarray(np.concatenate([np.zeros((1, jerk.shape[1])), jerk]))


def _quantities(run: RunData) -> dict[str, Quantity]:
    machine, setpoints, states = run.machine, run.setpoints, run.states
    jerk = jerk_of(setpoints)
    volts: FloatArray | None = None
    error_mm: FloatArray | None = None
    if machine is not None:
        motion = AxisMotion(
            velocity_mm_s=setpoints.velocity_mm_s.T,
            acceleration_mm_s2=setpoints.acceleration_mm_s2.T,
            jerk_mm_s3=jerk.T,
            s_mm=setpoints.s_mm,
            t_s=setpoints.t_s,
        )
        volts = control_signal(machine.drive, motion).T if machine.drive else None
        error_mm = tracking_error(machine.tracking, motion).T if machine.tracking else None
    measured = (states.control_signal_volts, states.tracking_error_mm) if len(states) else (None, None)
    velocity_limit = _given(machine.velocity_limit_mm_s) if machine else None
    acceleration_limit = _given(machine.acceleration_limit_mm_s2) if machine else None
    jerk_limit = _given(machine.jerk_limit_mm_s3) if machine else None
    control_limit = machine.control_limit_volts if machine else None
    error_limit = _thousandfold(machine.tracking_error_limit_mm) if machine else None
    acceleration = setpoints.acceleration_mm_s2
    rows = [
        Quantity("velocity", "velocity, mm/s", setpoints.velocity_mm_s, None, velocity_limit, velocity_limit),
        Quantity("acceleration", "acceleration, mm/s²", acceleration, None, acceleration_limit, acceleration_limit),
        Quantity("jerk", "jerk, mm/s³", jerk, None, jerk_limit, jerk_limit),
        Quantity("control_signal", "control signal, V", volts, measured[0], control_limit, control_limit),
        Quantity(
            "tracking_error",
            "tracking error, µm",
            None if error_mm is None else 1e3 * error_mm,
            None if measured[1] is None else 1e3 * measured[1],
            error_limit,
            _thousandfold(machine.planned_tracking_error_mm) if machine else None,
        ),
    ]
    return {row.key: row for row in rows}


def _given(limits: tuple[float, ...]) -> tuple[float, ...] | None:
    """Limits to draw; None if the machine file gives none for any axis."""
    return limits if np.any(np.isfinite(limits)) else None


def _thousandfold(row: tuple[float, ...] | None) -> tuple[float, ...] | None:
    return None if row is None else tuple(1e3 * value for value in row)


def tool_from_axes(machine: Machine | None, position_mm: FloatArray) -> FloatArray:
    """Tool positions of axis positions, shape (n, axes): shape (n, 3); without a machine the axes are x, y, z.

    Where more axes than coordinates follow the tool, as on a gantry, the tool is where they are closest to in the
    least-squares sense.
    """
    tool = np.zeros((len(position_mm), 3))
    if machine is None:
        count = min(3, position_mm.shape[1])
        tool[:, :count] = position_mm[:, :count]
    else:
        tool[:, : machine.dimensions] = position_mm @ machine.tool_matrix().T
    return tool


def _programmed_feed(run: RunData) -> FloatArray | None:
    if not run.segments:
        return None
    limits = np.array([segment.place.feed_limit_mm_s for segment in run.segments])
    if not np.any(np.isfinite(limits)):
        return None
    toolpath_starts = np.array([segment.place.s_start_mm for segment in run.segments])
    owner = np.clip(np.searchsorted(toolpath_starts, run.setpoints.s_mm, side="right") - 1, 0, len(limits) - 1)
    return np.asarray(limits[owner])
