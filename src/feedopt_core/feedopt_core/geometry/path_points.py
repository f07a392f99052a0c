"""Tool position and its derivatives with respect to arc length, and the change of parameter that leads there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray


@dataclass(frozen=True)
class PathPoints:
    """Path at n arc lengths; every array has shape (n, dimensions).

    Attributes:
        r_mm: tool position.
        dr_ds: unit tangent, dimensionless.
        d2r_ds2: curvature vector, 1/mm.
        d3r_ds3: its derivative, 1/mm^2.
    """

    r_mm: FloatArray
    dr_ds: FloatArray
    d2r_ds2: FloatArray
    d3r_ds3: FloatArray


@dataclass(frozen=True)
class ParameterRates:
    """du/ds, d2u/ds2 and d3u/ds3 of a curve parameter u, shape (n,) each."""

    first: FloatArray
    second: FloatArray
    third: FloatArray


def parameter_rates(r_u: FloatArray, r_uu: FloatArray, r_uuu: FloatArray) -> ParameterRates:
    """Rates of the parameter with arc length, from ``|dr/du| = ds/du``.

    Args:
        r_u, r_uu, r_uuu: derivatives with respect to the parameter, shape (n, dimensions), mm.
    """
    speed2 = np.einsum("nd,nd->n", r_u, r_u)
    along = np.einsum("nd,nd->n", r_u, r_uu)
    along_u = np.einsum("nd,nd->n", r_uu, r_uu) + np.einsum("nd,nd->n", r_u, r_uuu)
    speed = np.sqrt(speed2)
    return ParameterRates(
        first=1.0 / speed,
        second=-along / speed2**2,
        third=(4.0 * along**2 / speed2 - along_u) / (speed2**2 * speed),
    )
