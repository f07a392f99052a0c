"""One window of a run: knots, sites and the smoothest curve, refined until the curve stays in the tube."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.smoothing.runs.curve import DEGREE, SplinePolynomials, blossom, distance_bounds
from feedopt_core.smoothing.runs.knots import graded_joints, graded_spans, place_sites
from feedopt_core.smoothing.runs.run_polyline import RunPolyline
from feedopt_core.smoothing.runs.tube import fit_in_tube, site_weights

_TUBE_SHARE = 0.9
_STEPS = 16
_REPAIRS = 6
_REPAIR_STEPS = 12
_FOLLOW_SPANS = (0.6, 0.3, 0.3, 0.2, 0.2, 0.2, 0.1, 0.1)
"""Stiffness at the start of each attempt: looser is smoother, tighter is surer of the tube."""
_NARROWEST = 0.7
_AIM = 0.96
_FINER = 0.5
_COMPARISONS = 4
_LEAST_SPANS = 4


@dataclass(frozen=True)
class WindowEnds:
    """Fixed values at the ends of a window.

    Attributes:
        start_u: parameter the window starts at, on the first chord.
        start: Taylor coefficients of the curve there, as many as are fixed: shape (1 to 5, d).
        start_span_mm: length scale of the first span, which is not much longer.
        end: the same at the last vertex, shape (0 to 3, d).
    """

    start_u: float
    start: FloatArray
    start_span_mm: float
    end: FloatArray


@dataclass(frozen=True)
class WindowFit:
    """The curve of a window.

    Attributes:
        curve: over the parameter of the polyline.
        sites_u: parameters it was compared with the polyline at, shape (m,).
        bounds_mm: bound on the distance between them from each site to the next one, shape (m - 1,).
    """

    curve: SplinePolynomials
    sites_u: FloatArray
    bounds_mm: FloatArray


def fit_window(polyline: RunPolyline, ends: WindowEnds, tolerance_mm: float) -> WindowFit:
    """Smoothest curve within the tolerance of the programmed polyline.

    Args:
        polyline: at least two vertices; the first chord holds the start.
        ends: fixed values.
        tolerance_mm: largest distance.

    Raises:
        ToolpathError: no curve within the tolerance was found; names the line where.
    """
    for follow_spans in _FOLLOW_SPANS:
        window = _Window(polyline, ends, tolerance_mm, follow_spans)
        window.fit(_STEPS)
        for _ in range(_REPAIRS):
            if window.holds:
                return WindowFit(window.curve, window.u, window.bounds_mm)
            window.tighten()
            window.fit(_REPAIR_STEPS)
        if window.holds:
            return WindowFit(window.curve, window.u, window.bounds_mm)
        polyline = window.refined()
    line, ratio = window.worst()
    raise ToolpathError(
        f"the smooth curve leaves the programmed points by {ratio:.3g} times the tolerance; program an exact stop "
        "at the corner or allow more tolerance",
        line=line,
    )


class _Window:
    """The problem of one window with one set of knots."""

    def __init__(self, polyline: RunPolyline, ends: WindowEnds, tolerance_mm: float, follow_spans: float) -> None:
        self._polyline, self._tolerance_mm = polyline, tolerance_mm
        graded_mm = polyline.span_mm.copy()
        graded_mm[0] = min(graded_mm[0], ends.start_span_mm)
        graded_mm = graded_spans(polyline.u, graded_mm)
        joints = graded_joints(polyline.u, graded_mm, ends.start_u)
        if len(joints) <= _LEAST_SPANS:
            joints = np.linspace(joints[0], joints[-1], _LEAST_SPANS + 1)
        self._graded_mm = graded_mm
        self.u, self._chord = place_sites(polyline.u, graded_mm, ends.start_u)
        chord, before = self._chord, polyline.u[self._chord]
        z = ((self.u - before) / (polyline.u[chord + 1] - before))[:, None]
        self._sites_mm = polyline.points_mm[chord] * (1.0 - z) + polyline.points_mm[chord + 1] * z
        self._offset_mm = np.maximum(polyline.offset_mm[chord], polyline.offset_mm[chord + 1])
        self._knots = np.concatenate([np.full(DEGREE, joints[0]), joints, np.full(DEGREE, joints[-1])])
        self._control_mm, self._free = _first_control(polyline, self._knots, ends)
        self._tube_mm = _TUBE_SHARE * tolerance_mm - self._offset_mm
        self._weights = site_weights(self._knots, self.u, follow_spans)[0]

    def fit(self, steps: int) -> None:
        """Improve the curve, and bound its distance from the polyline."""
        sites = self.u, self._sites_mm, self._tube_mm
        fit_in_tube(self._knots, sites, self._control_mm, self._free, self._weights, steps)
        self.curve = SplinePolynomials.of_control_net(self._knots, self._control_mm)
        bounds_mm = distance_bounds(self.curve.joints, self.curve.taylor, self.u, self._sites_mm, _COMPARISONS)
        self.bounds_mm = bounds_mm + np.maximum(self._offset_mm[:-1], self._offset_mm[1:])

    @property
    def holds(self) -> bool:
        """The curve is within the tolerance."""
        return bool(np.all(self.bounds_mm <= self._tolerance_mm))

    def tighten(self) -> None:
        """Narrow the tube at the sites next to places where the curve leaves the tolerance."""
        excess = self.bounds_mm / self._tolerance_mm
        factor = np.where(excess > 1.0, np.clip(_AIM / excess, _NARROWEST, 1.0), 1.0)
        self._tube_mm[:-1] *= factor
        self._tube_mm[1:] *= factor

    def refined(self) -> RunPolyline:
        """The polyline with more vertices, for closer knots, where the curve leaves the tolerance."""
        outside = np.flatnonzero(self.bounds_mm > self._tolerance_mm)
        at = np.unique(np.concatenate([outside, outside + 1]))
        line = self._polyline
        spacing = np.interp(self.u[at], line.u, self._graded_mm)
        added = RunPolyline(
            self._sites_mm[at],
            self.u[at],
            np.minimum(spacing, np.gradient(self.u)[at]) * _FINER * 2.0,
            np.interp(self.u[at], line.u, line.size),
            np.zeros(len(at)),
            line.lines[self._chord[at]],
            line.feed_mm_s[self._chord[at]],
        )
        both = line.joined(added)
        order = np.lexsort((np.arange(len(both.u)), both.u))
        every = both.part(order)
        same = np.append(False, np.diff(every.u) <= 0.0)
        # An existing vertex gets the closer spacing.
        owner = np.cumsum(~same) - 1
        merged = every.part(~same)
        span_mm = np.full(len(merged.u), np.inf)
        np.minimum.at(span_mm, owner, every.span_mm)
        return replace(merged, span_mm=span_mm)

    def worst(self) -> tuple[int, float]:
        """Program line of the place where the curve is furthest outside, and distance over tolerance there."""
        at = int(np.argmax(self.bounds_mm))
        return int(self._polyline.lines[self._chord[at]]), float(self.bounds_mm[at]) / self._tolerance_mm


def _first_control(polyline: RunPolyline, knots: FloatArray, ends: WindowEnds) -> tuple[FloatArray, tuple[int, int]]:
    """Control points on the polyline, with the fixed ones at the ends, and the range of the free ones."""
    count = len(knots) - DEGREE - 1
    window = np.lib.stride_tricks.sliding_window_view(knots[1:-1], DEGREE)
    greville = np.mean(window, axis=1)
    control_mm = np.stack([np.interp(greville, polyline.u, column) for column in polyline.points_mm.T], axis=1)
    low, high = len(ends.start), count - len(ends.end)
    for fixed, index, at in ((ends.start, np.arange(low), knots[0]), (ends.end, np.arange(high, count), knots[-1])):
        if len(fixed):
            taylor = np.zeros((DEGREE + 1, len(index), control_mm.shape[1]))
            taylor[: len(fixed)] = fixed[:, None]
            control_mm[index] = blossom(taylor, window[index].T - at)
    return control_mm, (low, high)
