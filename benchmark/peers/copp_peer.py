"""COPP's TOPP3 (package copp-py): minimum time under velocity, acceleration and jerk limits on stations.

Its time law: at the stations ``a = (ds/dt)^2`` and ``b = d2s/dt2``, b linear in s between them, constant path jerk on
the first and the last interval, from and to standstill; evaluated by its own ``interpolation`` functions.
The jerk limit is linearised. As in its examples, the first profile is that of its TOPP2-RA, and every round linearises
at the previous profile.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import Any

import copp_py
import numpy as np
from benchmark.peers.motion import PeerError, PeerMotion, sample_at_ticks

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine

# Its solver needs numbers near 1. In mm and s, or with fewer equilibration steps, the conic form fails on some of these
# grids or ends far from the optimum.
_LENGTH_UNIT_MM = 10.0
_TIME_UNIT_S = 0.1
_EQUILIBRATION_STEPS = 50
_ROUNDS = 8
_SETTLED = 1e-4
_ASIDE_MM = 0.01
_REST_SHARE = 0.3
_GROWTH = 1.25


class Stations(Enum):
    """Stations at which COPP applies the limits, and its upper bound of the feedrate."""

    EVEN = "even"
    """Equidistant stations, feedrate bounded by the profile of TOPP2-RA, as in its examples."""
    GRADED = "graded"
    """Our best setting: finer near standstill; a station on each side of every joint of the path, because the third
    derivative jumps there; no upper bound, which on a grid is partly below the optimum (0.2 % of the time)."""


@dataclass(frozen=True)
class CoppSetting:
    """Solver (``lp``: maximises the integral of a; ``socp``: minimises the time itself), stations and their spacing."""

    solver: str
    stations: Stations
    spacing_mm: float

    def stations_mm(self, toolpath: Toolpath, machine: Machine) -> FloatArray:
        """Stations, shape (n,), from 0 to the end of the path."""
        end_mm = toolpath.end_mm
        if self.stations is Stations.EVEN:
            return np.linspace(0.0, end_mm, round(end_mm / self.spacing_mm) + 1)
        return _graded(toolpath.joints_mm(0.0, end_mm), end_mm, self.spacing_mm, _rest_mm(machine))


def _rest_mm(machine: Machine) -> float:
    """Length of the intervals at standstill: a part of the distance in which the jerk builds up the acceleration."""
    builds_up = [
        acceleration**3 / (6.0 * jerk**2)
        for acceleration, jerk in zip(machine.acceleration_limit_mm_s2, machine.jerk_limit_mm_s3, strict=True)
    ]
    return _REST_SHARE * min(builds_up)


def _graded(joints_mm: FloatArray, end_mm: float, spacing_mm: float, rest_mm: float) -> FloatArray:
    """Stations whose distance grows from both ends up to the spacing, with one on each side of each joint."""
    steps = [min(rest_mm, spacing_mm)]
    while steps[-1] * _GROWTH < spacing_mm:
        steps.append(steps[-1] * _GROWTH)
    head = np.concatenate([[0.0], np.cumsum(steps)])
    tail = end_mm - head[::-1]
    inner = joints_mm[(joints_mm > head[-1] + spacing_mm) & (joints_mm < tail[0] - spacing_mm)]
    edges = np.sort(np.concatenate([head[-1:], inner - _ASIDE_MM, inner + _ASIDE_MM, tail[:1]]))
    parts = [
        np.linspace(low, high, max(1, int(np.ceil((high - low) / spacing_mm))), endpoint=False)
        for low, high in pairwise(edges)
    ]
    return np.concatenate([head[:-1], *parts, tail])


def plan(toolpath: Toolpath, machine: Machine, setting: CoppSetting) -> PeerMotion:
    """Plan. The compute time excludes the sampling of the path and the transfer of the limits.

    Raises:
        PeerError: a solver failed; the message is that of COPP.
    """
    stations_mm = setting.stations_mm(toolpath, machine)
    robot = _robot(toolpath, machine, stations_mm)
    s = stations_mm / _LENGTH_UNIT_MM
    began = time.perf_counter()
    try:
        profile, duration, times = _solve(robot, s, setting)
    except copp_py.CoppError as error:
        raise PeerError(str(error)) from error
    compute_time_s = time.perf_counter() - began

    def s_at(t_s: FloatArray) -> FloatArray:
        samples = copp_py.interpolation.t_to_s_topp3_samples(s, profile, times, t_s / _TIME_UNIT_S)
        return np.asarray(samples * _LENGTH_UNIT_MM)

    motion_time_s = float(duration) * _TIME_UNIT_S
    return PeerMotion(motion_time_s, compute_time_s, sample_at_ticks(s_at, motion_time_s, toolpath.end_mm))


def _robot(toolpath: Toolpath, machine: Machine, stations_mm: FloatArray) -> copp_py.Robot:
    """Path derivatives and limits at the stations, in COPP's units."""
    length, period, n = _LENGTH_UNIT_MM, _TIME_UNIT_S, len(stations_mm)
    k = machine.axis_matrix()
    points = toolpath.evaluate(stations_mm)
    r, g1, g2, g3 = (
        np.ascontiguousarray(values @ k.T) * length ** (order - 1)
        for order, values in enumerate((points.r_mm, points.dr_ds, points.d2r_ds2, points.d3r_ds3))
    )
    velocity = np.array(machine.velocity_limit_mm_s) * period / length
    acceleration = np.array(machine.acceleration_limit_mm_s2) * period**2 / length
    jerk = np.array(machine.jerk_limit_mm_s3) * period**3 / length
    robot = copp_py.Robot(len(k), capacity=n)
    robot.append_s(stations_mm / length)
    robot.set_q(r, g1, g2, 0, dddq=g3)
    robot.add_velocity_limits(velocity, -velocity, start_idx_s=0, length=n)
    robot.add_acceleration_limits(acceleration, -acceleration, start_idx_s=0, length=n)
    robot.add_jerk_limits(jerk, -jerk, start_idx_s=0, length=n)
    feed = machine.feed_limit_mm_s * period / length
    robot.constraints.add_constraint_1st(np.full((n, 1), feed**2), 0)
    return robot


def _solve(robot: copp_py.Robot, s: FloatArray, setting: CoppSetting) -> tuple[copp_py.Profile3rd, float, FloatArray]:
    """Profile, its duration and the times at the stations, in COPP's units."""
    rest = (0.0, 0.0)
    topp2: Any = copp_py.solver.topp2_ra
    problem = topp2.Problem(robot.constraints, idx_s_interval=(0, len(s) - 1), a_boundary=rest)
    a = topp2.solve(problem, topp2.Options())
    if setting.stations is Stations.EVEN:
        robot.constraints.amax_substitute(a, 0)
    topp3: Any = getattr(copp_py.solver, f"topp3_{setting.solver}")
    settings = copp_py.clarabel.ClarabelSettings(max_threads=1, equilibrate_max_iter=_EQUILIBRATION_STEPS)
    options = topp3.Options(clarabel_settings=settings)

    def round_at(a: FloatArray) -> tuple[copp_py.Profile3rd, float, FloatArray]:
        problem = topp3.Problem(robot.constraints, a, idx_s_start=0, a_boundary=rest, b_boundary=rest)
        profile = topp3.solve(problem, options)
        return profile, *copp_py.interpolation.s_to_t_topp3(s, profile)

    found = round_at(a)
    for _ in range(_ROUNDS):
        before = found
        try:
            found = round_at(before[0].a)
        except copp_py.CoppError:
            # The previous profile also satisfies the true limits at the stations and is kept.
            break
        if abs(before[1] - found[1]) <= _SETTLED * found[1]:
            break
    return found
