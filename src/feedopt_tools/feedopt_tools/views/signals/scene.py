"""All data drawn of one run, computed once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_recorder.bags.run_data import RunData
from feedopt_tools.views.signals.contour import ContourError, contour_of
from feedopt_tools.views.signals.limit_use import LimitUse, limit_use_of
from feedopt_tools.views.signals.programmed import ProgrammedPath, programmed_path
from feedopt_tools.views.signals.run_events import NodeState, RunEvent, events_of, motion_time_of, node_states
from feedopt_tools.views.signals.signals import RunSignals, signals_of

_PLANNER = "planner"


@dataclass(frozen=True)
class Reserve:
    """Lead of the plan over the motion at each report of the planner, shape (k,) each."""

    t_s: FloatArray
    s_mm: FloatArray
    ahead_s: FloatArray


@dataclass(frozen=True)
class RunScene:
    """One run with all data of its views: signals, limit utilisation, contour error, program, events."""

    signals: RunSignals
    limit_use: LimitUse
    contour: ContourError | None
    programmed: ProgrammedPath
    events: tuple[RunEvent, ...]
    states: tuple[NodeState, ...]
    reserve: Reserve | None

    @property
    def error_um(self) -> FloatArray | None:
        """Largest absolute tracking error of any axis at the set points: simulated if recorded, else predicted."""
        return self._at_setpoints("tracking_error")

    @property
    def control_volts(self) -> FloatArray | None:
        """Largest absolute control signal of any axis at the set points: simulated if recorded, else predicted."""
        return self._at_setpoints("control_signal")

    @property
    def least_reserve_s(self) -> float | None:
        """Least lead of the plan over the motion until planning ended; None if planning ended before the motion."""
        if self.reserve is None:
            return None
        end_s = self.signals.run.chunks[-1].t_commit_s
        unplanned = self.reserve.t_s + self.reserve.ahead_s < end_s - 1e-6
        return float(np.min(self.reserve.ahead_s[unplanned])) if np.any(unplanned) else None

    def _at_setpoints(self, key: str) -> FloatArray | None:
        signals, quantity = self.signals, self.signals.quantities[key]
        if quantity.measured is not None:
            size = np.max(np.abs(quantity.measured), axis=1)
            return np.asarray(np.interp(signals.t_s, signals.state_t_s, size))
        return None if quantity.commanded is None else np.asarray(np.max(np.abs(quantity.commanded), axis=1))


def scene_of(run: RunData) -> RunScene:
    """All data drawn of a run.

    Raises:
        ViewError: the run holds nothing to draw.
    """
    signals = signals_of(run)
    return RunScene(
        signals=signals,
        limit_use=limit_use_of(signals),
        contour=contour_of(signals),
        programmed=programmed_path(run),
        events=events_of(signals),
        states=node_states(signals),
        reserve=_reserve(signals),
    )


def _reserve(signals: RunSignals) -> Reserve | None:
    """Lead of the committed over the executed motion time, at each planner report during the motion."""
    run = signals.run
    if not run.chunks:
        return None
    ends_mm = np.array([run.chunks[0].s_start_mm, *(chunk.s_commit_mm for chunk in run.chunks)])
    ends_s = np.array([run.chunks[0].t_start_s, *(chunk.t_commit_s for chunk in run.chunks)])
    rows = [
        (motion_time_of(signals, status.received_ns), status.s_mm)
        for status in run.statuses
        if status.node == _PLANNER and status.program_id == run.program_id
    ]
    rows = [(t_s, s_mm) for t_s, s_mm in rows if 0.0 <= t_s <= run.motion_time_s]
    if not rows:
        return None
    t_s, committed_mm = (np.array(column) for column in zip(*rows, strict=True))
    ahead_s = np.interp(committed_mm, ends_mm, ends_s) - t_s
    return Reserve(t_s, np.interp(t_s, signals.t_s, signals.s_mm), ahead_s)
