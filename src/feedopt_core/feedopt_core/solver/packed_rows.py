"""Rows in contiguous memory: all that have a limit, or a part of them; and their slacks."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import BoolArray, FloatArray, IntArray
from feedopt_core.compiled import compiled
from feedopt_core.solver.interior_point_data import BEND, DOWN, SLOPE, UP, VALUE, PackedRows, Rows


def packed(rows: Rows) -> tuple[PackedRows, IntArray]:
    """Rows that have a limit, and their indices among all rows."""
    limits = rows.inverse_limits
    limited = (limits[..., UP] != 0.0) | (limits[..., DOWN] != 0.0)
    counts = np.sum(limited, axis=-1)
    ends = np.cumsum(counts).reshape(counts.shape)
    index = np.flatnonzero(limited)
    # np.take and np.compress copy whole records; indexing with an array copies field by field and is slower.
    those = PackedRows(
        rows.basis,
        rows.weights_mm,
        ends - counts,
        counts,
        np.take(rows.coefficients, index),
        limits.reshape(-1, 2)[index],
        rows.over_root[index % len(rows.over_root)],
    )
    return those, index


def part(rows: PackedRows, kept: BoolArray) -> PackedRows:
    """The rows marked in ``kept``, shape (n,)."""
    before = np.concatenate([[0], np.cumsum(kept)])
    first = before[rows.first]
    return rows._replace(
        first=first,
        counts=before[rows.first + rows.counts] - first,
        coefficients=np.compress(kept, rows.coefficients),
        inverse_limits=rows.inverse_limits[kept],
        over_root=rows.over_root[kept],
    )


@compiled
def slacks(rows: PackedRows, c: FloatArray, slack: FloatArray) -> float:
    """Fill in the slack of each side as a part of its limit, shape (n, 2); 0 for a side without a limit.

    Returns:
        Motion time, s; NaN where q is not positive.
    """
    basis, weights, first, counts, coefficients, limits, over_root = rows
    spans, points = weights.shape
    time = 0.0
    slack[:] = 0.0
    for k in range(spans):
        for p in range(points):
            if weights[k, p] == 0.0:
                continue
            q = slope = bend = 0.0
            for i in range(3):
                q += basis[k, p, VALUE, i] * c[k + i]
                slope += basis[k, p, SLOPE, i] * c[k + i]
                bend += basis[k, p, BEND, i] * c[k + i]
            if not q > 0.0:
                return np.nan
            root = np.sqrt(q)
            time += weights[k, p] / root
            for r in range(first[k, p], first[k, p] + counts[k, p]):
                up, down = limits[r, UP], limits[r, DOWN]
                row = coefficients[r]
                y = row.on_q * q + row.on_slope * slope + root * row.on_root
                if over_root[r] > 0.0:
                    y += root * (row.on_root_q * q + row.on_root_slope * slope + row.on_root_bend * bend)
                if up != 0.0:
                    slack[r, UP] = 1.0 - up * y
                if down != 0.0:
                    slack[r, DOWN] = 1.0 + down * y
    return time
