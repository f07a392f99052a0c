"""Windowed planning of a path while it arrives.

Every window is planned from the committed state to standstill at the end of the window (or at the next exact stop).
Only its first part is committed; the remaining part is the stop held in reserve. So the committed motion always ends
in a feasible stop, even if no more path arrives, the solver fails or planning takes too long. The reasoning is in
docs/decisions/.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.errors import InfeasibleLimitsError, SolverError
from feedopt_core.geometry.segments import Segment
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.certificate import ALLOWED_RATIO, Certificate
from feedopt_core.motion.chunk import Chunk, SolverFigures
from feedopt_core.motion.profile import FeedProfile
from feedopt_core.planner.method import PlanningMethod, StartState, Window, WindowPlan
from feedopt_core.planner.methods import METHOD_NAMES, make_method
from feedopt_core.schema import parameter

_STOPS_OF_LOOK_AHEAD = 1.6
"""In a turn that uses all of the acceleration, a stop is pi/2 times as long as on a straight line."""
_STOPS_OF_COMMITMENT = 6.0
_LEAST_LOOK_AHEAD_MM = 5.0
_HALVINGS = 6


@dataclass(frozen=True)
class PlannerParameters:
    """Parameters of the planner; the same names stand in config/nodes/planner.yaml."""

    method: str = parameter("Planning method.", default="lp_nlp", choices=METHOD_NAMES)
    knot_spacing_mm: float = parameter(
        "Largest knot spacing of q(s).", default=0.25, unit="mm", at_least=1e-3, at_most=100.0
    )
    look_ahead_mm: float = parameter(
        "Path planned beyond the committed part; 0: from the stopping distance.",
        default=0.0,
        unit="mm",
        at_least=0.0,
        at_most=1e6,
    )
    commitment_mm: float = parameter(
        "Path committed by one window; 0: from the stopping distance.",
        default=0.0,
        unit="mm",
        at_least=0.0,
        at_most=1e6,
    )


@dataclass(frozen=True)
class _Committed:
    """End of the committed motion: arc length, time, state there, and the stop that continues it."""

    s_mm: float = 0.0
    t_s: float = 0.0
    state: StartState | None = None
    stop: FeedProfile | None = None
    sequence: int = 0


class StreamPlanner:
    """Plans one program on one machine: segments in, chunks out.

    Args:
        machine: limits and drive model.
        parameters: see PlannerParameters.
        method: planning method; None: the one that the parameters name.

    Raises:
        ConfigError: unknown method.
        InfeasibleLimitsError: the machine's limits leave no motion at all.
    """

    def __init__(self, machine: Machine, parameters: PlannerParameters, method: PlanningMethod | None = None) -> None:
        self.machine = machine
        self.toolpath = Toolpath()
        self._method = method or make_method(parameters.method, machine, parameters.knot_spacing_mm)
        stop_mm = max(self._method.stopping_mm, _LEAST_LOOK_AHEAD_MM)
        self._look_ahead_mm = parameters.look_ahead_mm or _STOPS_OF_LOOK_AHEAD * stop_mm
        self._commitment_mm = parameters.commitment_mm or _STOPS_OF_COMMITMENT * stop_mm
        self._committed = _Committed()
        self._last_segment = 0
        self._stops: dict[int, tuple[float, float]] = {}
        self.finished = False

    @property
    def committed_s_mm(self) -> float:
        """Arc length up to which motion is committed."""
        return self._committed.s_mm

    @property
    def committed_t_s(self) -> float:
        """Motion time up to which motion is committed."""
        return self._committed.t_s

    @property
    def last_segment_sequence(self) -> int:
        """Sequence of the last segment taken in."""
        return self._last_segment

    def add_segment(self, segment: Segment) -> None:
        """Append the next segment. Raises ToolpathError where it does not start at the end of the one before."""
        self.toolpath.append(segment)
        self._last_segment = segment.place.sequence

    def discard_before(self, s_mm: float) -> None:
        """Drop path and stops that the interpolator has passed."""
        self.toolpath.discard_before(min(s_mm, self._committed.s_mm))
        self._stops = {sequence: stop for sequence, stop in self._stops.items() if stop[0] >= s_mm}

    def next_chunk(self) -> Chunk | None:
        """Plan and commit the next chunk; None where more path is needed or the program is finished.

        Raises:
            InfeasibleLimitsError: no motion within the limits exists from the committed state.
            SolverError: the machine is at standstill, and no plan was found even for a short part of the path ahead.
        """
        target = self._target()
        if target is None:
            return None
        began, failure = time.perf_counter(), None
        for window, commit_all, shortened in self._windows(*target):
            try:
                plan = self._method.plan(self.toolpath, window)
            except (SolverError, InfeasibleLimitsError) as error:
                failure = error
                continue
            chunk, worst = self._chunk(plan, commit_all, shortened, time.perf_counter() - began)
            # Written so that NaN fails as well.
            if worst <= ALLOWED_RATIO:
                self._commit(chunk)
                return chunk
            failure = SolverError(_audit_failure(chunk))
        if self._committed.stop is None:
            assert failure is not None
            raise failure
        # The stop in reserve has passed its audit: commit it, and plan the next window from its standstill.
        stop = WindowPlan(self._committed.stop, "stop", 0, 0, 0)
        chunk, worst = self._chunk(stop, target[2], True, time.perf_counter() - began)
        if not worst <= ALLOWED_RATIO:
            raise SolverError(_audit_failure(chunk))
        self._commit(chunk)
        return chunk

    def _windows(self, start_mm: float, end_mm: float, commit_all: bool) -> Iterator[tuple[Window, bool, bool]]:
        """Windows to try, each with two flags: all of it may be committed; it was shortened.

        In motion there is one window to try, because the stop in reserve is the fallback. At standstill there is no
        such stop, so a window without a plan is halved several times: where the solver fails on a long window for
        numerical reasons, it may still find a plan for a short one.
        """
        at_standstill = self._committed.stop is None and not self._method.whole_path
        for halvings in range(_HALVINGS + 1 if at_standstill else 1):
            shortened = halvings > 0
            # The whole window ends at end_mm itself: start plus difference may miss an exact stop by the last bit.
            end = start_mm + (end_mm - start_mm) / 2**halvings if shortened else end_mm
            spare_end = not commit_all and not shortened
            window = Window(start_mm, end, self._committed.state, self._committed.stop, spare_end=spare_end)
            yield window, commit_all or shortened, shortened

    def restart_after_stop(self, chunk_sequence: int) -> None:
        """Continue from the standstill at the end of a chunk's stop. The machine took it, as no chunk came in time.

        Chunks planned to replace that stop are void; the interpolator refuses them. Where the chunk itself ended at
        standstill, the next one starts there anyway and nothing changes.
        """
        # Removed here: the machine takes a stop once, but may report it several times.
        stop = self._stops.pop(chunk_sequence, None)
        if stop is None:
            return
        s_mm, t_s = stop
        self._committed = _Committed(s_mm, t_s, sequence=self._committed.sequence)
        self.finished = self.toolpath.complete and s_mm >= self.toolpath.end_mm

    def _target(self) -> tuple[float, float, bool] | None:
        """Start and end of the next window, and whether all of it may be committed."""
        start_mm, known_mm = self._committed.s_mm, self.toolpath.end_mm
        if self.finished or known_mm <= start_mm:
            return None
        window_mm = self._commitment_mm + self._look_ahead_mm
        stops = self.toolpath.exact_stops_mm()
        stops = stops[stops > start_mm]
        if self.toolpath.complete:
            stops = np.append(stops, known_mm)
        # A window that nearly reaches a stop is extended to it, so that no short window is left over.
        if len(stops) and (self._method.whole_path or stops[0] - start_mm <= window_mm + self._look_ahead_mm):
            return start_mm, float(stops[0]), True
        if self._method.whole_path or known_mm - start_mm < window_mm:
            return None
        return start_mm, start_mm + window_mm, False

    def _chunk(self, plan: WindowPlan, commit_all: bool, fallback: bool, solve_time_s: float) -> tuple[Chunk, float]:
        """Chunk of a plan with its certificate, and the largest ratio in the certificate."""
        profile, began = plan.profile, time.perf_counter()
        report = audit_profile(self.toolpath, profile, self.machine, self._committed.t_s)
        certificate = Certificate.of(report, self.machine)
        commit = len(profile.kind)
        if not commit_all and not fallback:
            limit_mm = profile.s_mm[-1] - self._look_ahead_mm
            commit = max(1, int(np.searchsorted(profile.s_mm, limit_mm, side="right")) - 1)
        figures = SolverFigures(
            self._method.name,
            plan.solver,
            plan.variables,
            plan.rows,
            plan.iterations,
            solve_time_s,
            time.perf_counter() - began,
            fallback,
        )
        s_stop_mm, s_commit_mm = float(profile.s_mm[-1]), float(profile.s_mm[commit])
        chunk = Chunk(
            sequence=self._committed.sequence + 1,
            last_segment_sequence=self._last_segment,
            last=self.toolpath.complete and s_commit_mm >= self.toolpath.end_mm,
            s_start_mm=float(profile.s_mm[0]),
            s_commit_mm=s_commit_mm,
            s_stop_mm=s_stop_mm,
            t_start_s=self._committed.t_s,
            t_commit_s=self._committed.t_s + float(profile.times_s[commit]),
            dwell_s=self.toolpath.dwell_s(s_commit_mm) if commit == len(profile.kind) else 0.0,
            profile=profile,
            certificate=certificate,
            figures=figures,
        )
        return chunk, report.worst.ratio

    def _commit(self, chunk: Chunk) -> None:
        count = int(np.searchsorted(chunk.profile.s_mm, chunk.s_commit_mm))
        stop = chunk.profile[count:] if count < len(chunk.profile.kind) else None
        state = None if stop is None else StartState(float(stop.q_mm2_s2[0]), float(stop.dq_ds_mm_s2[0]))
        t_s = chunk.t_commit_s + chunk.dwell_s
        self._committed = _Committed(chunk.s_commit_mm, t_s, state, stop, chunk.sequence)
        # A fallback commits the stop of the chunk before. The next chunk starts at its end in any case.
        self._stops = {sequence: end for sequence, end in self._stops.items() if end[0] != chunk.s_commit_mm}
        if stop is not None:
            self._stops[chunk.sequence] = (chunk.s_stop_mm, chunk.t_start_s + chunk.profile.duration_s)
        self.finished = chunk.last


def _audit_failure(chunk: Chunk) -> str:
    found = chunk.certificate
    return (
        f"the plan from {chunk.s_start_mm:.3f} to {chunk.s_stop_mm:.3f} mm fails its audit: {found.worst_quantity} of "
        f"{found.worst_axis or 'the path'} is {found.worst_ratio:.4f} times its limit at s = {found.worst_s_mm:.3f} mm"
    )
