"""Arc length of a parametric curve and the polynomial map from arc length back to the parameter.

The map follows the feed-correction polynomials of the NURBS thesis (section 3.3.2): pieces of 7th order. Here each
piece interpolates the parameter and its first three derivatives, which are known in closed form, at both ends, so the
map is C3 inside a smooth curve, and a piece is split until its measured arc-length error is below the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.path_points import parameter_rates
from feedopt_core.geometry.quadrature import gauss_legendre

Evaluator = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray, FloatArray]]

ORDER = 8
TOLERANCE_MM = 1e-10
_MAX_PIECES = 4096
_LEAST_PIECE_MM = 1e-9
_SHARPEST_PER_MM = 1e5
_TURN_AT_JOINT = 1e-3
_NODES, _WEIGHTS = gauss_legendre(16)
_CHECKS = np.array([0.15, 0.35, 0.5, 0.65, 0.85])


class StandstillError(ToolpathError):
    """A curve with a point of zero speed or a cusp, where arc length cannot parametrise it smoothly.

    Args:
        parameter: where on the curve.
    """

    def __init__(self, parameter: float) -> None:
        super().__init__("the curve turns round on the spot here; program an exact stop or move the points apart")
        self.parameter = parameter


@dataclass(frozen=True)
class ArcLengthMap:
    """u(s) on [0, length]: ``u = sum_j coefficients[k, j] z^j`` on piece k, z in [0, 1] from s_mm[k] to s_mm[k + 1].

    Attributes:
        s_mm: joints, shape (m + 1,), mm from the start of the curve.
        coefficients: shape (m, 8), lowest power first.
        error_mm: largest |arc length of u(s) - s| found between the joints.
    """

    s_mm: FloatArray
    coefficients: FloatArray
    error_mm: float

    @property
    def length_mm(self) -> float:
        """Arc length of the whole curve."""
        return float(self.s_mm[-1])

    def parameter(self, s_mm: FloatArray) -> FloatArray:
        """Curve parameter at arc lengths from the start of the curve, shape (n,)."""
        piece = np.clip(np.searchsorted(self.s_mm, s_mm, side="right") - 1, 0, len(self.s_mm) - 2)
        z = (s_mm - self.s_mm[piece]) / (self.s_mm[piece + 1] - self.s_mm[piece])
        c = self.coefficients[piece]
        u = c[:, ORDER - 1]
        for j in range(ORDER - 2, -1, -1):
            u = u * z + c[:, j]
        return np.asarray(u)


def _hermite_matrix() -> FloatArray:
    """Coefficients of the 7th-order polynomial on [0, 1] from value and three derivatives at 0, then at 1."""
    rows = np.zeros((ORDER, ORDER))
    for derivative in range(4):
        for power in range(derivative, ORDER):
            factor = float(np.prod(np.arange(power - derivative + 1, power + 1))) if derivative else 1.0
            rows[derivative, power] = factor if power == derivative else 0.0
            rows[4 + derivative, power] = factor
    return np.asarray(np.linalg.inv(rows), dtype=np.float64)


_HERMITE = _hermite_matrix()


def arc_lengths(evaluate: Evaluator, start_u: FloatArray, end_u: FloatArray) -> FloatArray:
    """Arc length from start_u to end_u, elementwise, by 16-point Gauss-Legendre quadrature, mm."""
    width = end_u - start_u
    u = start_u[:, None] + width[:, None] * _NODES
    speed = np.linalg.norm(evaluate(u.ravel())[1], axis=1).reshape(u.shape)
    return np.asarray((speed @ _WEIGHTS) * width)


def map_arc_length(evaluate: Evaluator, joints_u: FloatArray, tolerance_mm: float = TOLERANCE_MM) -> ArcLengthMap:
    """Map arc length to the parameter of a curve that is smooth between the given joints.

    Args:
        evaluate: position and three derivatives with respect to the parameter.
        joints_u: increasing parameters between which the curve is smooth, first and last are its ends.
        tolerance_mm: bound on the arc-length error of the map.

    Raises:
        StandstillError: the curve has zero speed, a cusp or a value that is not finite somewhere.
        ToolpathError: it needs more pieces than the bound allows.
    """
    edges = np.asarray(joints_u, dtype=float)
    speeds = np.linalg.norm(evaluate(edges)[1], axis=1)
    if not np.all(speeds > 1e-9 * np.max(speeds)):
        raise StandstillError(float(edges[np.argmin(speeds)]))
    while True:
        start_u, end_u = edges[:-1], edges[1:]
        lengths = arc_lengths(evaluate, start_u, end_u)
        if not np.all(lengths > _LEAST_PIECE_MM):
            raise StandstillError(float(start_u[np.argmin(lengths > _LEAST_PIECE_MM)]))
        middle = (start_u + end_u) / 2.0
        halves = arc_lengths(evaluate, start_u, middle) + arc_lengths(evaluate, middle, end_u)
        coefficients = _hermite_pieces(evaluate, start_u, end_u, lengths)
        errors = np.abs(halves - lengths) + _map_errors(evaluate, start_u, lengths, coefficients)
        split = errors > np.maximum(tolerance_mm, 1e-14 * np.sum(lengths))
        if not np.any(split):
            _refuse_cusps(evaluate, start_u, end_u, lengths)
            s_mm = np.concatenate([[0.0], np.cumsum(lengths)])
            return ArcLengthMap(s_mm, coefficients, float(np.max(errors)))
        if len(edges) > _MAX_PIECES:
            raise ToolpathError(
                f"the curve needs more than {_MAX_PIECES} pieces for an arc-length error of {tolerance_mm:g} mm"
            )
        edges = np.sort(np.concatenate([edges, middle[split]]))


def _refuse_cusps(evaluate: Evaluator, start_u: FloatArray, end_u: FloatArray, lengths: FloatArray) -> None:
    """Refuse cusps: quadrature alone does not notice them, because the length is finite."""
    first, last = (evaluate(u)[1] for u in (start_u, end_u - 1e-12 * (end_u - start_u)))
    first /= np.linalg.norm(first, axis=1)[:, None]
    last /= np.linalg.norm(last, axis=1)[:, None]
    turn = np.linalg.norm(last - first, axis=1)
    sharp = (turn > 0.1) & (turn > _SHARPEST_PER_MM * lengths)
    broken = np.append(np.linalg.norm(first[1:] - last[:-1], axis=1) > _TURN_AT_JOINT, False)
    if np.any(sharp | broken):
        at = int(np.argmax(sharp | broken))
        raise StandstillError(float(start_u[at] if sharp[at] else end_u[at]))


def _hermite_pieces(evaluate: Evaluator, start_u: FloatArray, end_u: FloatArray, lengths: FloatArray) -> FloatArray:
    ends = []
    # One-sided derivatives: a joint may be a knot where the curve is only C2.
    inset = 1e-12 * (end_u - start_u)
    for u, at in ((start_u, start_u), (end_u, end_u - inset)):
        _, r_u, r_uu, r_uuu = evaluate(at)
        with np.errstate(divide="ignore", invalid="ignore"):
            rates = parameter_rates(r_u, r_uu, r_uuu)
        ends += [u, rates.first * lengths, rates.second * lengths**2, rates.third * lengths**3]
    return np.asarray(np.stack(ends, axis=1) @ _HERMITE.T)


def _map_errors(evaluate: Evaluator, start_u: FloatArray, lengths: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Largest |s(u(s)) - s| of each piece at the check points, mm."""
    u = coefficients @ np.vander(_CHECKS, ORDER, increasing=True).T
    start = np.repeat(start_u, len(_CHECKS))
    s = arc_lengths(evaluate, start, u.ravel()).reshape(u.shape)
    errors = np.max(np.abs(s - lengths[:, None] * _CHECKS), axis=1)
    return np.where(np.isfinite(errors), errors, np.inf)
