"""The feed profile q(s) = feedrate^2 and its exact motion in time.

On a QUADRATIC element ``d2s/dt2 = (dq/ds)/2`` is linear in s, so s(t) is a hyperbolic, trigonometric or polynomial
function in closed form. REST_START and REST_END are standstill elements of constant path jerk, ``s = J t^3 / 6``, so
``q = (9 J / 2)^(2/3) s^(4/3)``, which is no polynomial in s. Planner, audit and interpolator all use this module.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray, RecordArray, record
from feedopt_core.compiled import compiled
from feedopt_core.errors import SolverError


class ElementKind(IntEnum):
    """Kinds of elements; the numbers are those of the message."""

    QUADRATIC = 0
    REST_START = 1
    REST_END = 2


# Plain numbers for compiled code.
_QUADRATIC, _REST_START = int(ElementKind.QUADRATIC), int(ElementKind.REST_START)
_ELEMENT = record(kind="i8", q_mm2_s2="f8", dq_ds_mm_s2="f8", d2q_ds2_per_s2="f8", jerk_mm_s3="f8")
"""An element of the profile as compiled code reads it; the fields are those of :class:`FeedProfile`."""
_S, _V, _A, _J = 0, 1, 2, 3
"""Rows of the motion along the path."""


@dataclass(frozen=True)
class MotionStates:
    """Motion along the path at n instants; shape (n,) each.

    Attributes:
        s_mm: arc length.
        v_mm_s: feedrate ds/dt.
        a_mm_s2: d2s/dt2.
        j_mm_s3: d3s/dt3.
    """

    s_mm: FloatArray
    v_mm_s: FloatArray
    a_mm_s2: FloatArray
    j_mm_s3: FloatArray


@dataclass(frozen=True)
class FeedProfile:
    """Elements in order of arc length.

    Attributes:
        kind: ElementKind of each element, shape (n,).
        s_mm: ends of the elements, shape (n + 1,).
        q_mm2_s2: q at the start of each element; 0 for REST_START.
        dq_ds_mm_s2: dq/ds there; 0 for REST_START.
        d2q_ds2_per_s2: d2q/ds2 of QUADRATIC elements; 0 for the others.
        jerk_mm_s3: path jerk of standstill elements, positive; 0 for QUADRATIC.
        times_s: time at the ends of the elements from the start of the profile, shape (n + 1,); derived.

    Raises:
        SolverError: q is negative or not finite somewhere inside an element.
    """

    kind: IntArray
    s_mm: FloatArray
    q_mm2_s2: FloatArray
    dq_ds_mm_s2: FloatArray
    d2q_ds2_per_s2: FloatArray
    jerk_mm_s3: FloatArray
    times_s: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        widths = np.diff(self.s_mm)
        durations = self._times_within(np.arange(len(self.kind)), widths)
        if not np.all(np.isfinite(durations) & (durations > 0.0)):
            worst = int(np.argmin(np.isfinite(durations) & (durations > 0.0)))
            raise SolverError(f"the feed profile stops or reverses at s = {self.s_mm[worst]:.6g} mm")
        object.__setattr__(self, "times_s", np.concatenate([[0.0], np.cumsum(durations)]))

    @property
    def duration_s(self) -> float:
        """Motion time from the first to the last element."""
        return float(self.times_s[-1])

    def __getitem__(self, elements: slice) -> FeedProfile:
        """The profile over some of its elements, in order."""
        start, stop, _ = elements.indices(len(self.kind))
        return FeedProfile(
            self.kind[start:stop],
            self.s_mm[start : stop + 1],
            self.q_mm2_s2[start:stop],
            self.dq_ds_mm_s2[start:stop],
            self.d2q_ds2_per_s2[start:stop],
            self.jerk_mm_s3[start:stop],
        )

    def q_at(self, s_mm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, dq/ds, d2q/ds2 at arc lengths inside the profile, shape (n,) each; d2q/ds2 is infinite at standstill."""
        e = self._elements_at(s_mm, self.s_mm)
        x = s_mm - self.s_mm[e]
        bend = self.d2q_ds2_per_s2[e]
        slope = self.dq_ds_mm_s2[e] + bend * x
        q = self.q_mm2_s2[e] + (self.dq_ds_mm_s2[e] + 0.5 * bend * x) * x
        for kind, sign in ((ElementKind.REST_START, 1.0), (ElementKind.REST_END, -1.0)):
            here = self.kind[e] == kind
            if np.any(here):
                width = self.s_mm[e[here] + 1] - self.s_mm[e[here]]
                from_standstill = x[here] if sign > 0.0 else width - x[here]
                scale = (4.5 * self.jerk_mm_s3[e[here]]) ** (2.0 / 3.0)
                root = np.cbrt(np.maximum(from_standstill, 0.0))
                q[here] = scale * root**4
                slope[here] = sign * scale * 4.0 / 3.0 * root
                with np.errstate(divide="ignore"):
                    bend[here] = scale * 4.0 / 9.0 / root**2
        return q, slope, bend

    def time_at(self, s_mm: FloatArray) -> FloatArray:
        """Time from the start of the profile at arc lengths inside it, shape (n,), s."""
        e = self._elements_at(s_mm, self.s_mm)
        return np.asarray(self.times_s[e] + self._times_within(e, s_mm - self.s_mm[e]))

    def states_at(self, t_s: FloatArray) -> MotionStates:
        """Exact motion at times from the start of the profile, shape (n,); clipped to its ends."""
        t_s = np.clip(t_s, 0.0, self.duration_s)
        elements = self._elements_at(t_s, self.times_s)
        return self.states_within(elements, t_s - self.times_s[elements])

    def states_within(self, elements: IntArray, tau_s: FloatArray) -> MotionStates:
        """Exact motion at times from the start of the elements, shape (n,) each."""
        elements = np.ascontiguousarray(elements)
        return MotionStates(*_motion(self._records, self.s_mm, self.times_s, elements, np.ascontiguousarray(tau_s)))

    @cached_property
    def _records(self) -> RecordArray:
        records = np.empty(len(self.kind), _ELEMENT)
        for name in _ELEMENT.names or ():
            records[name] = getattr(self, name)
        return records

    @staticmethod
    def _elements_at(values: FloatArray, edges: FloatArray) -> IntArray:
        found = np.searchsorted(edges, values, side="right") - 1
        return np.asarray(np.clip(found, 0, len(edges) - 2), dtype=np.int64)

    def _times_within(self, e: IntArray, x: FloatArray) -> FloatArray:
        """Time from the start of elements e to distances x inside them, shape (n,).

        On a QUADRATIC element with k = (d2q/ds2)/2 and feedrates v0, v1 at the ends of x:
        ``tanh(sqrt(k) t / 2) = sqrt(k) x / (v0 + v1)`` (tan for k < 0), which has no cancellation for small k.
        """
        q0, slope, k = self.q_mm2_s2[e], self.dq_ds_mm_s2[e], 0.5 * self.d2q_ds2_per_s2[e]
        q1 = q0 + (slope + k * x) * x
        with np.errstate(divide="ignore", invalid="ignore"):
            # Where an element ends in q = 0, rounding may give a tiny negative q. A larger negative q is an error of
            # the plan.
            total = np.sqrt(q0) + np.sqrt(np.where(q1 > -1e-9 * (q0 + 1.0), np.maximum(q1, 0.0), np.nan))
            mean_time = np.where(x > 0.0, 2.0 * x / total, 0.0)
            times = mean_time * _atanh_over(0.25 * k * mean_time**2)
            for kind in (ElementKind.REST_START, ElementKind.REST_END):
                here = self.kind[e] == kind
                if np.any(here):
                    jerk, width = self.jerk_mm_s3[e[here]], self.s_mm[e[here] + 1] - self.s_mm[e[here]]
                    if kind is ElementKind.REST_START:
                        times[here] = np.cbrt(6.0 * x[here] / jerk)
                    else:
                        times[here] = np.cbrt(6.0 * width / jerk) - np.cbrt(
                            6.0 * np.maximum(width - x[here], 0.0) / jerk
                        )
        return np.asarray(times)


@compiled
def _motion(
    records: RecordArray, s_mm: FloatArray, times_s: FloatArray, elements: IntArray, tau_s: FloatArray
) -> FloatArray:
    """s, v, a and j at times within elements, shape (4, n).

    Args:
        records: of the elements, shape (m,).
        s_mm, times_s: ends of the elements, shape (m + 1,).
        elements, tau_s: which element, and time from its start, shape (n,).
    """
    out = np.empty((4, len(tau_s)))
    for i in range(len(tau_s)):
        e, tau = elements[i], tau_s[i]
        element = records[e]
        jerk = element.jerk_mm_s3
        if element.kind == _QUADRATIC:
            v0 = math.sqrt(element.q_mm2_s2)
            half_slope, k = 0.5 * element.dq_ds_mm_s2, 0.5 * element.d2q_ds2_per_s2
            cosh, sinh_over, bulge = _stumpff(k, tau)
            out[_S, i] = s_mm[e] + v0 * sinh_over + half_slope * bulge
            out[_V, i] = v0 * cosh + half_slope * sinh_over
            out[_A, i] = v0 * k * sinh_over + half_slope * cosh
            out[_J, i] = k * out[_V, i]
        else:
            sign = 1.0 if element.kind == _REST_START else -1.0
            from_standstill = tau if sign > 0.0 else times_s[e + 1] - times_s[e] - tau
            standstill_mm = s_mm[e] if sign > 0.0 else s_mm[e + 1]
            out[_S, i] = standstill_mm + sign * jerk * from_standstill**3 / 6.0
            out[_V, i] = 0.5 * jerk * from_standstill**2
            out[_A, i] = sign * jerk * from_standstill
            out[_J, i] = jerk
    return out


@compiled
def _stumpff(k: float, t: float) -> tuple[float, float, float]:
    """cosh(w t), sinh(w t) / w and (cosh(w t) - 1) / w^2 with w^2 = k of either sign."""
    z = k * t**2
    if abs(z) < 0.05:
        # Series up to z^6: the truncation error is smaller than rounding.
        over, bulge = 1.0, 1.0
        for n in range(6, 0, -1):
            over = 1.0 + z * over / ((2.0 * n) * (2.0 * n + 1.0))
            bulge = 1.0 + z * bulge / ((2.0 * n + 1.0) * (2.0 * n + 2.0))
        return 1.0 + 0.5 * z * bulge, t * over, 0.5 * t**2 * bulge
    w = math.sqrt(abs(z))
    half = math.sinh(0.5 * w) if z > 0.0 else math.sin(0.5 * w)
    value = math.cosh(w) if z > 0.0 else math.cos(w)
    over = (math.sinh(w) if z > 0.0 else math.sin(w)) / w
    return value, t * over, 2.0 * t**2 * half**2 / w**2


def _atanh_over(w2: FloatArray) -> FloatArray:
    """atanh(w) / w for w^2 = w2 of either sign (atan(w) / w where it is negative), shape (n,)."""
    w = np.sqrt(np.abs(w2))
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = np.where(w2 > 0.0, np.arctanh(np.minimum(w, 1.0)), np.arctan(w)) / w
    return np.where(w < 1e-2, 1.0 + w2 * (1.0 / 3.0 + w2 * (1.0 / 5.0 + w2 / 7.0)), exact)
