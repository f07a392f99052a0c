"""Maps from arc length to the parameter of a curve: the interpolators of the literature with one interface.

The project itself uses the map of geometry/arc_length.py. The others are here for comparison
(``feedopt bench interpolators``): natural interpolation, Taylor series of first and second order, a predictor-corrector
of second order, and the feed-correction polynomials of the NURBS thesis as published.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.arc_length import ORDER, ArcLengthMap
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.geometry.path_points import ParameterRates, parameter_rates

_CORRECTED_MM = 1e-9
_MOST_CORRECTIONS = 8
_SIMPSON_TOLERANCE_MM = 1e-12
_MOST_HALVINGS = 24
_SQUARED_ERROR = 1e-10


class ParameterMap(Protocol):
    """Map from arc length to curve parameter; ArcLengthMap is one."""

    def parameter(self, s_mm: FloatArray) -> FloatArray:
        """Curve parameters at increasing arc lengths from the start of the curve, one per period, shape (n,)."""
        ...


@dataclass(frozen=True)
class NaturalMap:
    """Parameter proportional to the arc length: constant feed gives constant steps of the parameter."""

    curve: NurbsCurve
    length_mm: float

    def parameter(self, s_mm: FloatArray) -> FloatArray:
        """See ParameterMap."""
        first, last = self.curve.joints[0], self.curve.joints[-1]
        return np.asarray(first + (last - first) * s_mm / self.length_mm)


@dataclass(frozen=True)
class TaylorMap:
    """``u + u_s ds``, with ``u_ss ds^2 / 2`` added in second order, from set point to set point.

    Attributes:
        curve: the curve.
        order: 1 or 2.
    """

    curve: NurbsCurve
    order: int

    def parameter(self, s_mm: FloatArray) -> FloatArray:
        """See ParameterMap."""
        u, last = float(self.curve.joints[0]), float(self.curve.joints[-1])
        out = np.empty(len(s_mm))
        for index, step_mm in enumerate(np.diff(s_mm, prepend=0.0)):
            rates = _rates(self.curve, u)
            bend = 0.5 * float(rates.second[0]) * step_mm**2 if self.order == 2 else 0.0
            u = min(u + float(rates.first[0]) * step_mm + bend, last)
            out[index] = u
        return out


@dataclass(frozen=True)
class PredictorCorrectorMap:
    """Prediction by a midpoint step (second-order Runge-Kutta), correction by its arc length from Simpson's rule.

    The correction is repeated until the error of the step is at most 1e-9 mm.
    """

    curve: NurbsCurve

    def parameter(self, s_mm: FloatArray) -> FloatArray:
        """See ParameterMap."""
        u, last = float(self.curve.joints[0]), float(self.curve.joints[-1])
        out = np.empty(len(s_mm))
        for index, step_mm in enumerate(np.diff(s_mm, prepend=0.0)):
            half = step_mm / (2.0 * float(_speeds(self.curve, np.array([u]))[0]))
            step = step_mm / float(_speeds(self.curve, np.array([min(u + half, last)]))[0])
            for _ in range(_MOST_CORRECTIONS):
                speeds = _speeds(self.curve, np.minimum(u + step * np.array([0.0, 0.5, 1.0]), last))
                error_mm = step_mm - step * float(speeds @ [1.0, 4.0, 1.0]) / 6.0
                if abs(error_mm) <= _CORRECTED_MM:
                    break
                step += error_mm / float(speeds[2])
            u = min(u + step, last)
            out[index] = u
        return out


def feed_correction_map(curve: NurbsCurve) -> ArcLengthMap:
    """Feed-correction polynomials as published (NURBS thesis, section 3.3.2).

    Polynomials of 7th order fitted to (s, u) pairs by least squares, with value and first and second derivative held
    at both ends (so C2); the pairs are halved until the mean squared error of u is at most 1e-10. The pairs are those
    of an adaptive Simpson quadrature (section 3.3.1, 1e-12 mm).

    Raises:
        ToolpathError: dr/du is zero at some parameter.
    """
    u, s_mm = _arc_length_pairs(curve)
    if not np.all(np.diff(s_mm) > 0.0):
        raise ToolpathError("dr/du of the curve is zero at some parameter; move its control points apart")
    pieces, todo = list[tuple[int, FloatArray]](), [(0, len(u) - 1)]
    while todo:
        first, last = todo.pop()
        coefficients, squared_error = _fit_correction(curve, u[first : last + 1], s_mm[first : last + 1])
        if squared_error <= _SQUARED_ERROR or last - first < 2 * (ORDER - 1):
            pieces.append((first, coefficients))
        else:
            middle = (first + last) // 2
            todo += [(middle, last), (first, middle)]
    joints = np.array([s_mm[first] for first, _ in pieces] + [s_mm[-1]])
    stacked = np.stack([coefficients for _, coefficients in pieces])
    return ArcLengthMap(joints, stacked, _largest_error_mm(curve, ArcLengthMap(joints, stacked, 0.0), u, s_mm))


def _rates(curve: NurbsCurve, u: float) -> ParameterRates:
    """du/ds and higher derivatives at one parameter."""
    return parameter_rates(*curve.evaluate(np.array([u]))[1:])


def _speeds(curve: NurbsCurve, u: FloatArray) -> FloatArray:
    """|dr/du|, mm."""
    return np.asarray(np.linalg.norm(curve.evaluate(u)[1], axis=1))


def _arc_length_pairs(curve: NurbsCurve) -> tuple[FloatArray, FloatArray]:
    """Ends of the intervals of an adaptive Simpson quadrature (eq. 3.32, 3.33), and the arc lengths there."""
    starts, ends = curve.joints[:1], curve.joints[-1:]
    tolerance_mm = _SIMPSON_TOLERANCE_MM
    done_u, done_mm = [], []
    for halving in range(_MOST_HALVINGS + 1):
        at = starts[:, None] + (ends - starts)[:, None] * np.linspace(0.0, 1.0, 5)
        f = _speeds(curve, at.ravel()).reshape(at.shape)
        width = ends - starts
        whole = width * (f[:, [0, 2, 4]] @ [1.0, 4.0, 1.0]) / 6.0
        halves = width * (f @ [1.0, 4.0, 2.0, 4.0, 1.0]) / 12.0
        # The bisection also ends when the halved tolerance is below the rounding error.
        good = np.abs(halves - whole) / 10.0 < np.maximum(tolerance_mm, 1e-15 * halves)
        good |= halving == _MOST_HALVINGS
        done_u.append(starts[good])
        done_mm.append(halves[good])
        middle = (starts + ends) / 2.0
        starts, ends = (
            np.concatenate([starts[~good], middle[~good]]),
            np.concatenate([middle[~good], ends[~good]]),
        )
        tolerance_mm /= 2.0
        if not starts.size:
            break
    u = np.concatenate(done_u)
    order = np.argsort(u)
    lengths = np.concatenate(done_mm)[order]
    return np.append(u[order], curve.joints[-1]), np.concatenate([[0.0], np.cumsum(lengths)])


def _fit_correction(curve: NurbsCurve, u: FloatArray, s_mm: FloatArray) -> tuple[FloatArray, float]:
    """Coefficients over normalised arc length, lowest power first, and the mean squared error of u (eq. 3.39, 3.43)."""
    length = float(s_mm[-1] - s_mm[0])
    sigma = (s_mm - s_mm[0]) / length
    phi = np.vander(sigma, ORDER, increasing=True)
    power = np.arange(ORDER, dtype=float)
    ends = np.zeros((6, ORDER))
    ends[0, 0], ends[1, 1], ends[2, 2] = 1.0, 1.0, 2.0
    ends[3:] = np.stack([np.ones(ORDER), power, power * (power - 1.0)])
    rates = parameter_rates(*curve.evaluate(np.array([u[0], u[-1]]))[1:])
    first, second = rates.first * length, rates.second * length**2
    held = np.array([u[0], first[0], second[0], u[-1], first[1], second[1]])
    matrix = np.block([[phi.T @ phi, ends.T], [ends, np.zeros((6, 6))]])
    solution = np.linalg.lstsq(matrix, np.concatenate([phi.T @ u, held]), rcond=None)[0]
    coefficients = solution[:ORDER]
    return coefficients, float(np.mean((phi @ coefficients - u) ** 2))


def _largest_error_mm(curve: NurbsCurve, fitted: ArcLengthMap, u: FloatArray, s_mm: FloatArray) -> float:
    """Largest arc-length error at the pairs: the error of u times |dr/du|."""
    return float(np.max(np.abs(fitted.parameter(s_mm) - u) * _speeds(curve, u)))
