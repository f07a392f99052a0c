"""The compared designs; each makes a curve from points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from benchmark.curves.nurbs_fit import fit_nurbs
from scipy import sparse
from scipy.interpolate import BSpline, splprep
from scipy.spatial import cKDTree

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.smoothing.runs.knots import graded_joints, graded_spans, place_sites, span_lengths_mm, turns_rad
from feedopt_core.smoothing.runs.simplify import PolylineSimplifier
from feedopt_core.smoothing.runs.smoother import RunSmoother
from feedopt_core.smoothing.runs.tube import DEGREE, roughness, site_basis

_BLOCK = 4096
_BISECTIONS = 12
_SLIDE = 5.0


@dataclass(frozen=True)
class Design:
    """A method that makes joined curves from points.

    Attributes:
        name: short name.
        note: description.
        curves: function of the points (shape (n, 2), mm) and a tolerance (mm) that returns the curves.
    """

    name: str
    note: str
    curves: Callable[[FloatArray, float], Sequence[NurbsCurve]]


def tube_spline(points_mm: FloatArray, tolerance_mm: float) -> list[NurbsCurve]:
    """The design in use."""
    smoother = RunSmoother(tolerance_mm)
    lines, feed = np.arange(len(points_mm)), np.full(len(points_mm), np.inf)
    pieces = []
    for low in range(0, len(points_mm), _BLOCK):
        part = slice(low, low + _BLOCK)
        pieces += smoother.add(points_mm[part], lines[part], feed[part])
    return [piece.curve for piece in pieces + smoother.finish()]


def tube_programme(points_mm: FloatArray, tolerance_mm: float) -> list[NurbsCurve]:
    """Minimum integral of |r'''|^2 with bounded distance along the normal at each site, as one quadratic programme."""
    vertices = simplified(points_mm, 0.1 * tolerance_mm)
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(vertices, axis=0), axis=1))])
    coarse = simplified(vertices, 0.5 * tolerance_mm)
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(coarse, axis=0), axis=1))])
    at *= u[-1] / at[-1]
    spans = graded_spans(at, span_lengths_mm(turns_rad(coarse), tolerance_mm))
    joints = graded_joints(at, spans, 0.0)
    sites_u, chord = place_sites(u, graded_spans(u, np.interp(u, at, spans)), 0.0)
    z = ((sites_u - u[chord]) / np.diff(u)[chord])[:, None]
    sites = vertices[chord] * (1.0 - z) + vertices[chord + 1] * z
    tangent = np.gradient(sites, sites_u, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    knots = np.concatenate([np.full(DEGREE, joints[0]), joints, np.full(DEGREE, joints[-1])])
    count = len(knots) - DEGREE - 1
    first, values = site_basis(knots, sites_u)
    rows = np.repeat(np.arange(len(sites_u)), DEGREE + 1)
    columns = (first[:, None] + np.arange(DEGREE + 1)).ravel()
    basis = sparse.csc_array((values.ravel(), (rows, columns)), shape=(len(sites_u), count))
    bands = roughness(knots)
    diagonals: list[Any] = [bands[: count - k, k] for k in range(DEGREE + 1)]
    upper = sparse.diags_array(diagonals, offsets=range(DEGREE + 1))
    one = sparse.csc_array(upper + upper.T - sparse.diags_array(bands[:, 0]))
    hesse = sparse.block_diag([one, one], format="csc")
    across = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    blocks = [
        sparse.hstack([sparse.diags_array(way[:, 0]) @ basis, sparse.diags_array(way[:, 1]) @ basis])
        for way in (across, tangent)
    ]
    centre = np.concatenate([np.sum(across * sites, axis=1), np.sum(tangent * sites, axis=1)])
    half = np.repeat([0.85 * tolerance_mm, _SLIDE * tolerance_mm], len(sites_u))
    for row in (0, len(sites_u) - 1):
        half[[row, row + len(sites_u)]] = 0.0
    import osqp

    solver = osqp.OSQP()
    solver.setup(
        sparse.csc_matrix(sparse.triu(hesse)),
        np.zeros(2 * count),
        sparse.csc_matrix(sparse.vstack(blocks)),
        centre - half,
        centre + half,
        eps_abs=2e-5,
        eps_rel=1e-9,
        max_iter=20000,
        verbose=False,
    )
    control = solver.solve().x.reshape(2, count).T
    return [NurbsCurve.from_control_net(DEGREE, knots, np.ascontiguousarray(control), np.ones(count))]


def penalised_cubic(points_mm: FloatArray, tolerance_mm: float) -> list[NurbsCurve]:
    """Cubic smoothing spline (FITPACK), one smoothing factor for the whole run, as large as the tolerance allows."""
    return [_penalised(points_mm, tolerance_mm, 3)]


def penalised_quintic(points_mm: FloatArray, tolerance_mm: float) -> list[NurbsCurve]:
    """The same with a quintic spline."""
    return [_penalised(points_mm, tolerance_mm, 5)]


def _penalised(points_mm: FloatArray, tolerance_mm: float, degree: int) -> NurbsCurve:
    low, high = 1e-12, float(len(points_mm)) * tolerance_mm**2
    chords = np.linalg.norm(np.diff(points_mm, axis=0), axis=1)
    u = np.concatenate([[0.0], np.cumsum(chords)])
    best: BSpline | None = None
    for _ in range(_BISECTIONS):
        factor = float(np.sqrt(low * high))
        fitted: Any = splprep(points_mm.T, u=u, s=factor, k=degree)
        spline = BSpline(fitted[0][0], np.stack(fitted[0][1], axis=1), degree)
        if np.max(np.linalg.norm(spline(u) - points_mm, axis=1)) <= tolerance_mm:
            low, best = factor, spline
        else:
            high = factor
    if best is None:
        raise ValueError("no smoothing factor satisfies the tolerance")
    return NurbsCurve.from_control_net(degree, best.t, best.c, np.ones(len(best.c)))


def beta_nurbs(points_mm: FloatArray, tolerance_mm: float) -> tuple[NurbsCurve, ...]:
    """Least-squares cubic NURBS with beta constraints, through the polyline simplified with half of the tolerance."""
    return fit_nurbs(simplified(points_mm, 0.5 * tolerance_mm)).curves


def simplified(points_mm: FloatArray, tolerance_mm: float) -> FloatArray:
    """Vertices of the polyline simplified within a tolerance."""
    simplifier = PolylineSimplifier(tolerance_mm)
    vertices = simplifier.add(points_mm, np.arange(len(points_mm)), np.ones(len(points_mm)))
    return vertices.joined(simplifier.finish()).points_mm


def deviation_mm(curves: Sequence[NurbsCurve], points_mm: FloatArray) -> float:
    """Largest distance from a programmed point to the curve, by samples at most 1 um apart."""
    parts = []
    for curve in curves:
        joints = curve.joints
        speed = np.max(np.linalg.norm(curve.evaluate(joints)[1], axis=1))
        count = int(np.ceil(2.0 * speed * (joints[-1] - joints[0]) / 1e-3))
        parts.append(curve.evaluate(np.linspace(joints[0], joints[-1], max(count, 2)))[0])
    return float(np.max(cKDTree(np.concatenate(parts)).query(points_mm)[0]))


DESIGNS = (
    Design("tube spline", "quintic, least integral |r'''|^2 in the tube, reweighted", tube_spline),
    Design("tube programme", "the same in the tube of normals, OSQP, whole run at once", tube_programme),
    Design("penalised quintic", "smoothing spline, one factor for the run", penalised_quintic),
    Design("penalised cubic", "smoothing spline, one factor for the run", penalised_cubic),
    Design("beta NURBS", "least squares through thinned points, G2 by beta constraints", beta_nurbs),
)
