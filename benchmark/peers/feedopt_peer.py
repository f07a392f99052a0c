"""feedopt's own planner in the comparison: in windows, as in the planner node, and the whole path in one window."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from benchmark.peers.motion import PeerError, PeerMotion, sample_at_ticks

from feedopt_core.errors import InfeasibleLimitsError, SolverError
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine
from feedopt_core.pipeline.plan_program import plan_program
from feedopt_core.planner.method import Window
from feedopt_core.planner.methods import make_method
from feedopt_core.planner.stream_planner import PlannerParameters


def plan_windowed(program: Path, machine: Machine) -> PeerMotion:
    """Plan chunk by chunk. The compute time includes reading, smoothing, planning and certificates.

    Raises:
        PeerError: no plan was found.
    """
    try:
        plan = plan_program(program, machine, PlannerParameters())
    except (InfeasibleLimitsError, SolverError) as error:
        raise PeerError(str(error)) from error
    return PeerMotion(plan.motion_time_s, plan.compute_time_s, plan.setpoints.s_mm)


def plan_one_shot(toolpath: Toolpath, machine: Machine) -> PeerMotion:
    """Plan the whole path as one window. The compute time includes sampling of the path, solution and check.

    Raises:
        PeerError: no plan was found.
    """
    parameters = PlannerParameters()
    method = make_method(parameters.method, machine, parameters.knot_spacing_mm)
    began = time.perf_counter()
    try:
        profile = method.plan(toolpath, Window(0.0, toolpath.end_mm)).profile
    except (InfeasibleLimitsError, SolverError) as error:
        raise PeerError(str(error)) from error
    compute_time_s = time.perf_counter() - began

    s_mm = sample_at_ticks(lambda t_s: np.asarray(profile.states_at(t_s).s_mm), profile.duration_s, toolpath.end_mm)
    return PeerMotion(profile.duration_s, compute_time_s, s_mm)
