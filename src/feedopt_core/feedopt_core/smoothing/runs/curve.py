"""A quintic spline as polynomials between its knots: its distance from a polyline, and its pieces as NURBS."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from feedopt_core.arrays import FloatArray
from feedopt_core.compiled import compiled
from feedopt_core.geometry.nurbs import NurbsCurve

DEGREE = 5


@dataclass(frozen=True)
class SplinePolynomials:
    """r(u) on span k: ``sum_i taylor[i, k] (u - joints[k])^i``.

    Attributes:
        joints: increasing parameters, shape (k + 1,).
        taylor: shape (6, k, d), mm.
    """

    joints: FloatArray
    taylor: FloatArray

    @classmethod
    def of_control_net(cls, knots: FloatArray, control_mm: FloatArray) -> SplinePolynomials:
        """Polynomials of a spline with clamped knots and control points."""
        joints = knots[DEGREE : len(knots) - DEGREE]
        spline = BSpline(knots, control_mm, DEGREE)
        taylor = np.stack([spline(joints[:-1], nu=i) / math.factorial(i) for i in range(DEGREE + 1)])
        return cls(joints, taylor)

    def state_at(self, joint: int) -> FloatArray:
        """Taylor coefficients after a joint other than the last one, shape (6, d)."""
        return self.taylor[:, joint]

    def cut(self, edges: FloatArray) -> SplinePolynomials:
        """The same curve with more joints, cut to their range.

        Args:
            edges: increasing parameters within the curve; first and last are the new ends.
        """
        inside = self.joints[(self.joints > edges[0]) & (self.joints < edges[-1])]
        joints = np.unique(np.concatenate([edges, inside]))
        owner = np.clip(np.searchsorted(self.joints, joints[:-1], side="right") - 1, 0, len(self.joints) - 2)
        shift = (joints[:-1] - self.joints[owner])[:, None]
        taylor = self.taylor[:, owner].copy()
        for first in range(DEGREE):
            for i in range(DEGREE - 1, first - 1, -1):
                taylor[i] += shift * taylor[i + 1]
        return SplinePolynomials(joints, taylor)

    def between(self, first: int, last: int) -> NurbsCurve:
        """The curve between two joints as a clamped NURBS curve over its parameter from zero."""
        joints = self.joints[first : last + 1] - self.joints[first]
        knots = np.concatenate([np.zeros(DEGREE), joints, np.full(DEGREE, joints[-1])])
        index = np.arange(len(joints) + DEGREE - 1)
        owner = np.clip(index - DEGREE, 0, last - first - 1)
        arguments = np.stack([knots[index + offset] - joints[owner] for offset in range(1, DEGREE + 1)])
        control_mm = blossom(self.taylor[:, first + owner], arguments)
        return NurbsCurve.from_control_net(DEGREE, knots, control_mm, np.ones(len(control_mm)))


def blossom(taylor: FloatArray, arguments: FloatArray) -> FloatArray:
    """Control points as blossoms: the symmetric form of each polynomial at five arguments.

    Args:
        taylor: coefficients, shape (6, n, d).
        arguments: shape (5, n).

    Returns:
        Shape (n, d).
    """
    symmetric = [np.ones(arguments.shape[1]), *[np.zeros(arguments.shape[1]) for _ in range(DEGREE)]]
    for argument in arguments:
        for i in range(DEGREE, 0, -1):
            symmetric[i] = symmetric[i] + argument * symmetric[i - 1]
    shares = np.stack([s / math.comb(DEGREE, i) for i, s in enumerate(symmetric)])
    return np.asarray(np.einsum("in,ind->nd", shares, taylor))


@compiled
def distance_bounds(
    joints: FloatArray, taylor: FloatArray, u: FloatArray, points_mm: FloatArray, parts: int
) -> FloatArray:
    """Bound on the distance of curve and polyline from each site to the next one, seen from either; shape (m - 1,).

    The part of the curve and the part of the polyline are compared at equal shares of their parameters: between two
    compared points the distance is no more than the larger one at its ends plus ``max |r''| du^2 / 8``.

    Args:
        joints, taylor: the curve.
        u: parameters of the sites, increasing, shape (m,); no vertex of the polyline lies between two.
        points_mm: sites, shape (m, d).
        parts: comparisons between two sites.
    """
    dimensions = points_mm.shape[1]
    bounds = np.empty(len(u) - 1)
    span = 0
    for j in range(len(u) - 1):
        width = (u[j + 1] - u[j]) / parts
        before = 0.0
        bend_before = 0.0
        worst = 0.0
        for i in range(parts + 1):
            at = u[j] + width * i
            while span < len(joints) - 2 and at >= joints[span + 1]:
                span += 1
            while span > 0 and at < joints[span]:
                span -= 1
            x = at - joints[span]
            square = 0.0
            bend_square = 0.0
            for c in range(dimensions):
                value = 0.0
                for k in range(DEGREE, -1, -1):
                    value = value * x + taylor[k, span, c]
                bend = 0.0
                for k in range(DEGREE, 1, -1):
                    bend = bend * x + k * (k - 1) * taylor[k, span, c]
                share = i / parts
                value -= points_mm[j, c] * (1.0 - share) + points_mm[j + 1, c] * share
                square += value * value
                bend_square += bend * bend
            distance = np.sqrt(square)
            bend_here = np.sqrt(bend_square)
            if i > 0:
                # Twice the larger end value bounds the second derivative of a quintic in between.
                worst = max(worst, max(distance, before) + max(bend_here, bend_before) * width * width / 4.0)
            before, bend_before = distance, bend_here
        bounds[j] = worst
    return bounds
