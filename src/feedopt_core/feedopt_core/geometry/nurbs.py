"""NURBS curves in homogeneous power form: one polynomial a knot span, evaluated for many parameters at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.path_kernels import curve_points


@dataclass(frozen=True)
class NurbsCurve:
    """A NURBS curve with its control net.

    Attributes:
        degree: polynomial degree, at least 2.
        knots: shape (n + degree + 1,), not decreasing.
        control_points_mm: shape (n, dimensions).
        weights: shape (n,), positive.
        spans: start and homogeneous coefficients of each knot span, shape (m, 1 + (degree + 1) (dimensions + 1)), as
            :mod:`feedopt_core.geometry.path_kernels` reads them; derived.
        joints: parameters where spans meet, first and last of the domain included, shape (m + 1,); derived.
    """

    degree: int
    knots: FloatArray
    control_points_mm: FloatArray
    weights: FloatArray
    spans: FloatArray
    joints: FloatArray

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
        # Shape (degree + 1, spans, dimensions + 1), highest power first.
        taylor = np.stack([spline(domain[:-1], nu=k) / math.factorial(k) for k in range(degree, -1, -1)])
        coefficients = taylor.transpose(1, 0, 2).reshape(len(domain) - 1, -1)
        spans = np.ascontiguousarray(np.column_stack([domain[:-1], coefficients]))
        return cls(degree, knots, control_points_mm, weights, spans, domain)

    def evaluate(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Position and the first three derivatives with respect to u, shape (n, dimensions) each, mm."""
        shape = (len(u), self.control_points_mm.shape[1])
        r, derivatives = np.empty(shape), np.empty((3, *shape))
        curve_points(self.spans, self.degree, np.ascontiguousarray(u, dtype=np.float64), r, derivatives)
        return r, derivatives[0], derivatives[1], derivatives[2]
