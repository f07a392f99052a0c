"""Contour error: distance of the tool from the commanded path. The lag along the path is separate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from feedopt_core.arrays import FloatArray
from feedopt_tools.views.signals.signals import RunSignals, tool_from_axes

_LEAST_STEP_MM = 1e-6
_NEWTON_STEPS = 4
_DRAWN_RATIO = 0.03


@dataclass(frozen=True)
class ContourError:
    """Actual and commanded path, one row for each state that has a set point.

    Attributes:
        t_s, s_mm: motion time and commanded arc length, shape (m,).
        nearest_mm: nearest point of the commanded path, shape (m, 3).
        actual_mm: actual tool position, shape (m, 3).
        error_um: distance between the two, shape (m,); on a plane path positive to the left of travel.
        lag_um: lag of the tool along the path, shape (m,).
        factor: factor by which drawings enlarge the error: 1, 2 or 5 times a power of ten.
    """

    t_s: FloatArray
    s_mm: FloatArray
    nearest_mm: FloatArray
    actual_mm: FloatArray
    error_um: FloatArray
    lag_um: FloatArray
    factor: float

    @property
    def exaggerated_mm(self) -> FloatArray:
        """Actual path with its contour error multiplied by :attr:`factor`, shape (m, 3)."""
        return self.nearest_mm + self.factor * (self.actual_mm - self.nearest_mm)


def contour_of(signals: RunSignals) -> ContourError | None:
    """Contour error of a run; None without states or without motion.

    The commanded path is a cubic spline through the commanded positions; the nearest point on it is found by Newton
    steps from the commanded one, so that a path that crosses itself does not hide an error.
    """
    states = signals.run.states
    rows = np.concatenate([[True], np.diff(signals.s_mm) > _LEAST_STEP_MM])
    if len(states) == 0 or np.sum(rows) < 4:
        return None
    s_knots, path_mm = signals.s_mm[rows], signals.tool_mm[rows]
    spline, slope = CubicSpline(s_knots, path_mm), CubicSpline(s_knots, path_mm).derivative()
    actual_mm = tool_from_axes(signals.run.machine, states.position_mm)
    s = signals.state_s_mm.copy()
    for _ in range(_NEWTON_STEPS):
        tangent = slope(s)
        step = np.sum((actual_mm - spline(s)) * tangent, axis=1) / np.maximum(np.sum(tangent**2, axis=1), 1e-12)
        s = np.clip(s + step, s_knots[0], s_knots[-1])
    nearest_mm, tangent = spline(s), slope(s)
    offset = actual_mm - nearest_mm
    error_um = 1e3 * np.linalg.norm(offset, axis=1)
    if np.ptp(signals.tool_mm[:, 2]) == 0.0:
        left = tangent[:, 0] * offset[:, 1] - tangent[:, 1] * offset[:, 0]
        error_um = np.where(left < 0.0, -error_um, error_um)
    return ContourError(
        t_s=signals.state_t_s,
        s_mm=signals.state_s_mm,
        nearest_mm=nearest_mm,
        actual_mm=actual_mm,
        error_um=error_um,
        lag_um=1e3 * (signals.state_s_mm - s),
        factor=_factor(float(np.max(np.abs(error_um))) * 1e-3, float(np.max(np.ptp(signals.tool_mm, axis=0)))),
    )


def _factor(error_mm: float, size_mm: float) -> float:
    """The largest of 1, 2, 5, 10, ... that draws the largest error below a few per cent of the path's size."""
    room = _DRAWN_RATIO * size_mm / max(error_mm, 1e-9)
    if room <= 1.0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(room))
    return float(max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= room))
