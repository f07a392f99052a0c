"""What the interior point works on: rows, ends, iterate and linear system."""

from __future__ import annotations

from typing import NamedTuple

from feedopt_core.arrays import FloatArray, IntArray

LINE, BEND, ROOT, ROW_SIZE = 0, 2, 5, 6
"""Places in ``Rows.coefficients``: two of the linear part, three of the bend, the factor of sqrt(q)."""
SLACK, DUAL, RESIDUAL, ON_Q, D_SLACK, D_DUAL, SECOND, SIDE_SIZE = 0, 1, 2, 3, 4, 5, 6, 8
"""Places in ``Iterate.sides``; SECOND is the product of the predictor's steps. One side fills one cache line."""


class Rows(NamedTuple):
    """Two-sided rows at p points of m spans, n a point; see the module.

    Attributes:
        basis: q, q' and q'' by the control points of the span, shape (m, p, 3, 3).
        weights_mm: quadrature weights along s, shape (m, p); points with a weight of 0 are left out.
        coefficients: shape (m, p, n, ROW_SIZE).
        inverse_limits: of y upwards and downwards, 0 where a side has no limit; shape (m, p, n, 2).
        over_root: 1 where the row is divided by sqrt(q), shape (n,).
    """

    basis: FloatArray
    weights_mm: FloatArray
    coefficients: FloatArray
    inverse_limits: FloatArray
    over_root: FloatArray


class PackedRows(NamedTuple):
    """The rows that have a limit, point by point, in one piece of memory.

    Attributes:
        basis, weights_mm: as those of :class:`Rows`.
        first, counts: index of the first row of each point, and their number, shape (m, p).
        coefficients: shape (n, ROW_SIZE).
        inverse_limits: shape (n, 2).
        over_root: shape (n,).
    """

    basis: FloatArray
    weights_mm: FloatArray
    first: IntArray
    counts: IntArray
    coefficients: FloatArray
    inverse_limits: FloatArray
    over_root: FloatArray


class Iterate(NamedTuple):
    """Control points, slacks and multipliers with the steps on them.

    Attributes:
        c: control points, shape (m + 2,).
        sides: of packed rows, shape (n, 2, SIDE_SIZE).
        slopes: D of each row by q' and q'', shape (n, 2).
        ends: limits of the outer control points, shape (2, SIDE_SIZE).
    """

    c: FloatArray
    sides: FloatArray
    slopes: FloatArray
    ends: FloatArray


class System(NamedTuple):
    """Linear system of one iteration.

    Attributes:
        gradient: of the Lagrangian, shape (m + 2,).
        right: right side of the predictor, then of the corrector, shape (m + 2,).
        centre: what the right side gains for each unit of the complementarity aimed at, shape (m + 2,).
        band: normal matrix with the exact curvature of all limits, diagonals in the columns, shape (m + 2, 3).
        convex: what turns that curvature into its convex part, shape (m + 2, 3).
    """

    gradient: FloatArray
    right: FloatArray
    centre: FloatArray
    band: FloatArray
    convex: FloatArray


class Ends(NamedTuple):
    """Elimination of the end control points: ``c[0] = c[1] / start_ratio`` (0: c[0], c[1] are given), same at the end.

    The outer control points have limits, given by their inverse (0: none).
    """

    start_ratio: float
    end_ratio: float
    start_inverse_limit: float
    end_inverse_limit: float


class Settings(NamedTuple):
    """When the iterations end, and whether they take cautious steps; see ``minimise_time``."""

    cautious: bool
    tolerance: float
    feasibility: float
    max_iterations: int
