"""Rows in one piece of memory: those with a limit, or a part of them; and the room that they leave."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import BoolArray, FloatArray, IntArray
from feedopt_core.compiled import compiled
from feedopt_core.solver.interior_point_data import ROW_SIZE, PackedRows, Rows


def packed(rows: Rows) -> tuple[PackedRows, IntArray]:
    """Rows that have a limit, and their places among all."""
    limits = rows.inverse_limits
    limited = (limits[..., 0] != 0.0) | (limits[..., 1] != 0.0)
    counts = np.sum(limited, axis=-1)
    ends = np.cumsum(counts).reshape(counts.shape)
    index = np.flatnonzero(limited)
    those = PackedRows(
        rows.basis,
        rows.weights_mm,
        ends - counts,
        counts,
        rows.coefficients.reshape(-1, ROW_SIZE)[index],
        limits.reshape(-1, 2)[index],
        rows.over_root[index % len(rows.over_root)],
    )
    return those, index


def part(rows: PackedRows, kept: BoolArray) -> PackedRows:
    """Some of the rows, shape (n,)."""
    before = np.concatenate([[0], np.cumsum(kept)])
    first = before[rows.first]
    return rows._replace(
        first=first,
        counts=before[rows.first + rows.counts] - first,
        coefficients=rows.coefficients[kept],
        inverse_limits=rows.inverse_limits[kept],
        over_root=rows.over_root[kept],
    )


@compiled
def rooms(rows: PackedRows, c: FloatArray, room: FloatArray) -> float:
    """Fill in what each side leaves of its limit, 0 without one, shape (n, 2).

    Returns:
        Motion time, not a number where q is not positive.
    """
    basis, weights, first, counts, coefficients, limits, over_root = rows
    spans, points = weights.shape
    time = 0.0
    room[:] = 0.0
    for k in range(spans):
        for p in range(points):
            if weights[k, p] == 0.0:
                continue
            x = basis[k, p]
            q = x[0, 0] * c[k] + x[0, 1] * c[k + 1] + x[0, 2] * c[k + 2]
            slope = x[1, 0] * c[k] + x[1, 1] * c[k + 1] + x[1, 2] * c[k + 2]
            bend = x[2, 0] * c[k] + x[2, 1] * c[k + 1] + x[2, 2] * c[k + 2]
            if not q > 0.0:
                return np.nan
            root_q = np.sqrt(q)
            time += weights[k, p] / root_q
            for r in range(first[k, p], first[k, p] + counts[k, p]):
                up, down = limits[r, 0], limits[r, 1]
                row = coefficients[r]
                y = row[0] * q + row[1] * slope + root_q * row[5]
                if over_root[r] > 0.0:
                    y += root_q * (row[2] * q + row[3] * slope + row[4] * bend)
                if up != 0.0:
                    room[r, 0] = 1.0 - up * y
                if down != 0.0:
                    room[r, 1] = 1.0 + down * y
    return time
