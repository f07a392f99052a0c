"""NURBS curves in homogeneous power form: one polynomial a knot span, evaluated for many parameters at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, PPoly

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError


@dataclass(frozen=True)
class NurbsCurve:
    """A NURBS curve with its control net.

    Attributes:
        degree: polynomial degree, at least 2.
        knots: shape (n + degree + 1,), not decreasing.
        control_points_mm: shape (n, dimensions).
        weights: shape (n,), positive.
    """

    degree: int
    knots: FloatArray
    control_points_mm: FloatArray
    weights: FloatArray
    _pieces: PPoly

    @classmethod
    def from_control_net(
        cls, degree: int, knots: FloatArray, control_points_mm: FloatArray, weights: FloatArray
    ) -> NurbsCurve:
        """Check the control net and prepare the curve.

        Raises:
            ToolpathError: wrong counts, knots that decrease, weights that are not positive, or a value that is not
                finite.
        """
        count = len(control_points_mm)
        if degree < 2 or count < degree + 1:
            raise ToolpathError(
                f"NURBS of degree {degree} with {count} control points: needs degree >= 2 and more points than that"
            )
        if len(knots) != count + degree + 1 or len(weights) != count:
            raise ToolpathError(
                f"NURBS of degree {degree}, {count} control points: needs {count + degree + 1} knots, {count} weights, "
                f"has {len(knots)} and {len(weights)}"
            )
        for name, values in (("knots", knots), ("control points", control_points_mm), ("weights", weights)):
            if not np.all(np.isfinite(values)):
                raise ToolpathError(f"NURBS {name} hold a value that is not finite")
        if np.any(np.diff(knots) < 0.0) or knots[degree] >= knots[count]:
            raise ToolpathError("NURBS knots must not decrease, and must span more than one value")
        if np.any(weights <= 0.0):
            raise ToolpathError(
                f"NURBS weight {int(np.argmin(weights))} is {float(np.min(weights)):g}, must be above zero"
            )
        homogeneous = np.column_stack([control_points_mm * weights[:, None], weights])
        domain = np.unique(knots[degree : count + 1])
        spline = BSpline(knots, homogeneous, degree)
        taylor = [spline(domain[:-1], nu=k) / math.factorial(k) for k in range(degree, -1, -1)]
        pieces = PPoly.construct_fast(np.stack(taylor), domain)
        return cls(degree, knots, control_points_mm, weights, pieces)

    @property
    def joints(self) -> FloatArray:
        """Parameters where pieces meet, first and last of the domain included."""
        joints: FloatArray = self._pieces.x
        return joints

    def evaluate(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Position and the first three derivatives with respect to u, shape (n, dimensions) each, mm."""
        piece = np.clip(np.searchsorted(self.joints, u, side="right") - 1, 0, len(self.joints) - 2)
        x = (u - self.joints[piece])[:, None]
        c = self._pieces.c[:, piece]
        value, first, second, third = c[0], np.zeros_like(c[0]), np.zeros_like(c[0]), np.zeros_like(c[0])
        for row in c[1:]:
            # Horner's scheme carried through the derivatives (each is the Taylor coefficient).
            third = third * x + second
            second = second * x + first
            first = first * x + value
            value = value * x + row
        return _project(value, first, 2.0 * second, 6.0 * third)


def _project(
    h: FloatArray, h_u: FloatArray, h_uu: FloatArray, h_uuu: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """From homogeneous coordinates to the curve: Leibniz' rule for r = (w r) / w."""
    w, w_u, w_uu, w_uuu = (array[:, -1:] for array in (h, h_u, h_uu, h_uuu))
    r = h[:, :-1] / w
    r_u = (h_u[:, :-1] - w_u * r) / w
    r_uu = (h_uu[:, :-1] - 2.0 * w_u * r_u - w_uu * r) / w
    r_uuu = (h_uuu[:, :-1] - 3.0 * w_u * r_uu - 3.0 * w_uu * r_u - w_uuu * r) / w
    return r, r_u, r_uu, r_uuu
