"""TOPP-RA (package toppra): minimum time under velocity and acceleration limits on a grid, without a jerk limit.

Its time law: ``ds/dt`` at the grid points, constant ``d2s/dt2`` between them.
"""

from __future__ import annotations

import logging
import time
from typing import Any

import numpy as np
import toppra
from benchmark.peers.motion import PeerError, PeerMotion, sample_at_ticks
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraintVarying
from toppra.interpolator import AbstractGeometricPath

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine

_LEAST_LIMIT_MM_S = 1e-3


class _AxisPath(AbstractGeometricPath):  # type: ignore[misc]
    """The toolpath in axis coordinates with the interface of toppra."""

    def __init__(self, toolpath: Toolpath, machine: Machine) -> None:
        self._toolpath = toolpath
        self._axis_matrix = machine.axis_matrix()

    def __call__(self, path_positions: Any, order: int = 0) -> FloatArray:
        points = self._toolpath.evaluate(np.atleast_1d(path_positions))
        values = (points.r_mm, points.dr_ds, points.d2r_ds2)[order] @ self._axis_matrix.T
        return np.asarray(values if np.ndim(path_positions) else values[0])

    @property
    def dof(self) -> int:
        return len(self._axis_matrix)

    @property
    def path_interval(self) -> FloatArray:
        return np.array([0.0, self._toolpath.end_mm])


def plan(toolpath: Toolpath, machine: Machine, spacing_mm: float) -> PeerMotion:
    """Plan on an equidistant grid. The compute time excludes the sampling of the path and its limits.

    Raises:
        PeerError: toppra found no parametrisation.
    """
    logging.getLogger("toppra").setLevel(logging.ERROR)
    path = _AxisPath(toolpath, machine)
    velocity = np.array(machine.velocity_limit_mm_s)
    acceleration = np.array(machine.acceleration_limit_mm_s2)

    def velocity_limits(s_mm: float) -> FloatArray:
        # The feed limit as an axis limit: a limit of |g1| feed on any axis keeps ds/dt at or below the feed.
        direction = np.abs(path(s_mm, 1))
        limit = np.maximum(np.minimum(velocity, direction * machine.feed_limit_mm_s), _LEAST_LIMIT_MM_S)
        return np.stack([-limit, limit], axis=1)

    grid = np.linspace(0.0, toolpath.end_mm, round(toolpath.end_mm / spacing_mm) + 1)
    constraints = [
        JointVelocityConstraintVarying(velocity_limits),
        JointAccelerationConstraint(np.stack([-acceleration, acceleration], axis=1)),
    ]
    instance = toppra.algorithm.TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel")
    began = time.perf_counter()
    _, v_mm_s, _ = instance.compute_parameterization(0.0, 0.0)
    if v_mm_s is None:
        raise PeerError(f"toppra: {instance.problem_data.return_code}")
    times_s = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(grid) / (v_mm_s[1:] + v_mm_s[:-1]))])
    compute_time_s = time.perf_counter() - began
    a_mm_s2 = np.diff(v_mm_s**2) / (2.0 * np.diff(grid))

    def s_at(t_s: FloatArray) -> FloatArray:
        k = np.clip(np.searchsorted(times_s, t_s, side="right") - 1, 0, len(a_mm_s2) - 1)
        tau = t_s - times_s[k]
        return np.asarray(grid[k] + (v_mm_s[k] + 0.5 * a_mm_s2[k] * tau) * tau)

    motion_time_s = float(times_s[-1])
    return PeerMotion(motion_time_s, compute_time_s, sample_at_ticks(s_at, motion_time_s, toolpath.end_mm))
