"""Replaces runs of short straight moves by the smoothest curve within the tolerance.

A run passes three stages. The polyline loses the vertices that only carry rounding (simplify). Knots are set by
how sharply what is left turns (run_knots), and the quintic spline of least integral |r'''|^2 in the tube around it is
found (run_tube), window by window (run_window): the first part of a window is final, the rest is looked ahead over; the
next window continues the curve with the same position and four derivatives. docs/decisions/ compares the design with
others by the motion time that results.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.geometry.arc_length import ArcLengthMap, StandstillError, map_arc_length
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.smoothing.runs.curve import DEGREE
from feedopt_core.smoothing.runs.run_polyline import PolylineMeasure, RunPolyline
from feedopt_core.smoothing.runs.simplify import PolylineSimplifier, Vertices
from feedopt_core.smoothing.runs.window import WindowEnds, WindowFit, fit_window

_SIMPLIFY_SHARE = 0.1
_WINDOW_SPANS = 224.0
_COMMITTED_SHARE = 0.75
_PIECE_SPANS = 64
_SNAP_SHARE = 1e-3


@dataclass(frozen=True)
class RunPiece:
    """A piece of the smooth curve.

    Attributes:
        curve: the piece over its parameter from zero.
        arc_length_map: parameter by arc length.
        line: program line of the move it starts in.
        feed_mm_s: programmed feed of the whole piece.
        deviation_mm: bound on its distance from the programmed polyline, seen from either of them.
    """

    curve: NurbsCurve
    arc_length_map: ArcLengthMap
    line: int
    feed_mm_s: float
    deviation_mm: float


class RunSmoother:
    """Smooths one run in blocks of points. The result does not depend on how the points are divided into blocks.

    The curve starts at the first point and ends at the last one; its pieces join with four equal derivatives, so
    curvature and its change are continuous.

    Args:
        tolerance_mm: largest distance between curve and polyline, seen from either.
        start_direction: unit tangent to start with at zero curvature; None leaves both free.
    """

    def __init__(self, tolerance_mm: float, start_direction: FloatArray | None = None) -> None:
        self._tolerance_mm = tolerance_mm
        self._start_direction = start_direction
        self._simplifier = PolylineSimplifier(_SIMPLIFY_SHARE * tolerance_mm)
        self._measure = PolylineMeasure(tolerance_mm)
        self._settled: RunPolyline | None = None
        self._ends: WindowEnds | None = None

    def add(self, points_mm: FloatArray, lines: IntArray, feed_mm_s: FloatArray) -> list[RunPiece]:
        """Add the next points; the first one is the start of the run.

        Args:
            points_mm: shape (n, d).
            lines: program line of the move that ends at each point, shape (n,).
            feed_mm_s: its feed, shape (n,).

        Returns:
            The pieces that are final now.

        Raises:
            ToolpathError: no curve within the tolerance was found.
        """
        vertices = self._simplifier.add(points_mm, lines, feed_mm_s)
        if not len(vertices.lines):
            return []
        self._settle(vertices, final=False)
        return self._smooth_windows()

    def finish(self, end_direction: FloatArray | None = None) -> list[RunPiece]:
        """Remaining pieces; none if all points of the run coincide.

        Args:
            end_direction: unit tangent to end with at zero curvature; None leaves both free.

        Raises:
            ToolpathError: no curve within the tolerance was found.
        """
        vertices = self._simplifier.finish()
        if len(vertices.lines) + (0 if self._settled is None else len(self._settled.u)) < 2:
            return []
        self._settle(vertices, final=True)
        pieces = self._smooth_windows()
        polyline, ends = self._rest()
        if end_direction is not None:
            tangent = np.asarray(end_direction, dtype=np.float64)
            ends = replace(ends, end=np.stack([polyline.points_mm[-1], tangent, np.zeros_like(tangent)]))
        else:
            ends = replace(ends, end=polyline.points_mm[-1:])
        fit = fit_window(polyline, ends, self._fit_tolerance_mm)
        return pieces + self._pieces(polyline, fit, len(fit.curve.joints) - 1)

    @property
    def _fit_tolerance_mm(self) -> float:
        return (1.0 - _SIMPLIFY_SHARE) * self._tolerance_mm

    def _settle(self, vertices: Vertices, *, final: bool) -> None:
        measured = self._measure.add(vertices, final=final)
        self._settled = measured if self._settled is None else self._settled.joined(measured)

    def _rest(self) -> tuple[RunPolyline, WindowEnds]:
        """The vertices that are final but not yet smoothed, and the state at their start."""
        polyline = self._settled
        assert polyline is not None, "vertices were settled"
        if self._ends is not None:
            return polyline, self._ends
        start = polyline.points_mm[:1]
        if self._start_direction is not None:
            tangent = np.asarray(self._start_direction, dtype=np.float64)
            start = np.stack([start[0], tangent, np.zeros_like(tangent)])
        return polyline, WindowEnds(0.0, start, np.inf, np.zeros((0, polyline.points_mm.shape[1])))

    def _smooth_windows(self) -> list[RunPiece]:
        """Smooth as many windows as the final vertices fill, and keep the data of the next one."""
        pieces = list[RunPiece]()
        while self._settled is not None:
            polyline, ends = self._rest()
            start_size = float(np.interp(ends.start_u, polyline.u, polyline.size))
            last = int(np.searchsorted(polyline.size, start_size + _WINDOW_SPANS))
            if last >= len(polyline.size):
                break
            fit = fit_window(polyline.part(slice(last + 1)), ends, self._fit_tolerance_mm)
            joints = fit.curve.joints
            stop = max(1, int(_COMMITTED_SHARE * (len(joints) - 1)))
            pieces += self._pieces(polyline, fit, stop)
            span_mm = 1.5 * float(joints[stop] - joints[stop - 1])
            self._ends = replace(
                ends, start_u=float(joints[stop]), start=fit.curve.state_at(stop)[:DEGREE], start_span_mm=span_mm
            )
            held = int(np.searchsorted(polyline.u, joints[stop], side="right")) - 1
            self._settled = polyline.part(slice(held, None))
        return pieces

    def _pieces(self, polyline: RunPolyline, fit: WindowFit, stop: int) -> list[RunPiece]:
        """The curve up to a joint, cut at changes of feed and into pieces of limited size."""
        joints = fit.curve.joints[: stop + 1]
        changes = polyline.u[1:][polyline.feed_mm_s[1:] != polyline.feed_mm_s[:-1]]
        cuts = np.append(_snapped(changes, joints), joints[:: min(_PIECE_SPANS, stop)])
        edges = np.unique(np.append(cuts[(cuts >= joints[0]) & (cuts <= joints[-1])], joints[-1]))
        curve = fit.curve.cut(edges)
        at = np.searchsorted(curve.joints, edges)
        pieces = list[RunPiece]()
        for low, high, start, end in zip(at[:-1], at[1:], edges[:-1], edges[1:], strict=True):
            part = curve.between(int(low), int(high))
            owner = np.clip(np.searchsorted(polyline.u, 0.5 * (start + end), side="right") - 1, 0, len(polyline.u) - 2)
            first = np.clip(np.searchsorted(polyline.u, start + 1e-9, side="right") - 1, 0, len(polyline.u) - 2)
            beside = (fit.sites_u[1:] > start) & (fit.sites_u[:-1] < end)
            deviation_mm = float(np.max(fit.bounds_mm[beside])) + _SIMPLIFY_SHARE * self._tolerance_mm
            try:
                arc_length_map = map_arc_length(part.evaluate, part.joints)
            except StandstillError as error:
                error.line = int(polyline.lines[first])
                raise
            pieces.append(
                RunPiece(
                    part, arc_length_map, int(polyline.lines[first]), float(polyline.feed_mm_s[owner]), deviation_mm
                )
            )
        return pieces


def _snapped(cuts: FloatArray, joints: FloatArray) -> FloatArray:
    """Cuts. A cut next to a joint is moved onto it, so that no span is much shorter than its neighbour."""
    nearest = np.clip(np.searchsorted(joints, cuts), 1, len(joints) - 1)
    low, high = joints[nearest - 1], joints[nearest]
    room = _SNAP_SHARE * (high - low)
    return np.where(np.abs(cuts - low) <= room, low, np.where(np.abs(high - cuts) <= room, high, cuts))
