"""Data of the interior point: rows, ends, iterate and linear system."""

from __future__ import annotations

from typing import NamedTuple

from feedopt_core.arrays import FloatArray, IntArray, RecordArray, record

VALUE, SLOPE, BEND = 0, 1, 2
"""Indices of q, q' and q'' in ``Rows.basis``."""
UP, DOWN = 0, 1
"""The sides of a row: y <= limit_up and -limit_down <= y."""
ROW = record(on_q="f8", on_slope="f8", on_root_q="f8", on_root_slope="f8", on_root_bend="f8", on_root="f8")
"""Factors in a row of q, q', sqrt(q) q, sqrt(q) q', sqrt(q) q'' and sqrt(q)."""
LINEARISED = record(on_slope="f8", on_bend="f8")
"""Factors of q' and q'' in a linearised row, before the sign and the limit of a side are applied."""
SIDE = record(
    slack="f8", dual="f8", residual="f8", on_q="f8", d_slack="f8", d_dual="f8", second_order="f8", padding="f8"
)
"""State of one side of a row: slack, multiplier, residual, factor of q, steps of slack and multiplier, and the product
of the two steps of the predictor. The padding makes it one cache line of 64 bytes."""


class Rows(NamedTuple):
    """Two-sided rows at p points of each of m spans, n rows at each point.

    Attributes:
        basis: q, q' and q'' (VALUE, SLOPE, BEND) by the three control points of the span, shape (m, p, 3, 3).
        weights_mm: quadrature weights along s, shape (m, p); points with a weight of 0 are left out.
        coefficients: of type ROW, shape (m, p, n).
        inverse_limits: of y UP and DOWN, 0 where a side has no limit; shape (m, p, n, 2).
        over_root: 1 where the row is divided by sqrt(q), shape (n,).
    """

    basis: FloatArray
    weights_mm: FloatArray
    coefficients: RecordArray
    inverse_limits: FloatArray
    over_root: FloatArray


class PackedRows(NamedTuple):
    """The rows that have a limit, in the order of the points, in contiguous memory.

    Attributes:
        basis, weights_mm: as those of :class:`Rows`.
        first, counts: index of the first row of each point, and their number, shape (m, p).
        coefficients: of type ROW, shape (n,).
        inverse_limits: shape (n, 2).
        over_root: shape (n,).
    """

    basis: FloatArray
    weights_mm: FloatArray
    first: IntArray
    counts: IntArray
    coefficients: RecordArray
    inverse_limits: FloatArray
    over_root: FloatArray


class Iterate(NamedTuple):
    """Control points, slacks and multipliers with the steps on them.

    Attributes:
        c: control points, shape (m + 2,).
        sides: of packed rows, of type SIDE, shape (n, 2).
        linearised: packed rows, of type LINEARISED, shape (n,).
        ends: limits of the outer control points, of type SIDE, shape (2,).
    """

    c: FloatArray
    sides: RecordArray
    linearised: RecordArray
    ends: RecordArray


MAIN, FIRST, SECOND = 0, 1, 2
"""Columns of a band: the main diagonal of a symmetric matrix, and the two above it."""


class System(NamedTuple):
    """Linear system of one iteration.

    Attributes:
        gradient: of the Lagrangian, shape (m + 2,).
        right: right side of the predictor, then of the corrector, shape (m + 2,).
        centre: derivative of the right side by the target of slack times multiplier, shape (m + 2,).
        band: normal matrix with the exact curvature of all limits, by columns MAIN, FIRST, SECOND, shape (m + 2, 3).
        convex: correction that reduces that curvature to its convex part, shape (m + 2, 3).
    """

    gradient: FloatArray
    right: FloatArray
    centre: FloatArray
    band: FloatArray
    convex: FloatArray


class Ends(NamedTuple):
    """Elimination of the end control points: ``c[0] = c[1] / start_ratio``, and likewise at the end.

    A ratio of 0 means that both control points are given. The limits of the outer control points are given by their
    inverse; 0 means no limit.
    """

    start_ratio: float
    end_ratio: float
    start_inverse_limit: float
    end_inverse_limit: float


class Settings(NamedTuple):
    """Conditions for the end of the iterations, and whether the steps are cautious; see ``minimise_time``."""

    cautious: bool
    tolerance: float
    feasibility: float
    max_iterations: int
