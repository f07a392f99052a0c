"""The standstill element: constant jerk J, s = J t^3 / 6. Its length and the largest jerk that the limits allow.

It lies next to each standstill of the path. With the distance x from the standstill, q = p x^(4/3) and
p = (9 J / 2)^(2/3), an axis has (sign: +1 where the element leaves the standstill, -1 where it reaches it)

    velocity      p^(1/2) g1 x^(2/3)
    acceleration  p (g2 x^(4/3) + sign 2/3 g1 x^(1/3))
    jerk          p^(3/2) (g3 x^2 + sign 2 g2 x + 2/9 g1)

so every limit on the element is an upper bound of p alone. Nothing is linearised, and the profile contains the
standstill itself (q = 0). Control signal and tracking error are polynomials of degree 2 and 3 in p^(1/2); p^(1/2) stays
below the first point where one of them reaches its limit.
"""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.compiled import compiled
from feedopt_core.constraints.axis_geometry import AxisGeometry, axis_geometry, q_limit
from feedopt_core.errors import InfeasibleLimitsError
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.limits import KinematicLimits, MotionLimits

_FRACTION = 0.3
_INSIDE_MM = 1e-9
_LEAST_MM = 1e-6
"""Least length of the standstill element; in a shorter one the rounding of arc lengths would be too large a part."""
_SAMPLES = np.concatenate([[1e-15, 1e-4], np.linspace(0.02, 1.0 - 1e-7, 15)])
"""Places on the element, as parts of its length. The last is just inside, because the path may have a joint at its
end."""
_STEP, _FAR = 0.05, 8.0
"""Step and end of the search for the first crossing of a polynomial limit, in units of a y that is surely inside."""
_BISECTIONS = 40
_UNLIMITED = 1e6
"""Value of p^(1/2) above what any feed limit allows. It stands for an axis that does not move and so sets no limit."""


def standstill_length_mm(toolpath: Toolpath, limits: KinematicLimits, s_standstill_mm: float, sign: int) -> float:
    """Length of the standstill element: a part of the distance over which the jerk builds up the full acceleration.

    Args:
        toolpath: contains the standstill.
        limits: all finite; where the machine gives none they are derived from those of the drives.
        s_standstill_mm: arc length of the standstill.
        sign: +1 where the element leaves the standstill, -1 where it reaches it.
    """
    # Evaluated just inside the element: at an exact stop the direction of the path may jump.
    geometry = axis_geometry(toolpath, limits.axis_matrix, np.array([s_standstill_mm + sign * _INSIDE_MM]))
    with np.errstate(divide="ignore"):
        jerk = float(np.min(limits.jerk_mm_s3 / np.abs(geometry.g1[:, 0])))
        acceleration = float(np.min(limits.acceleration_mm_s2 / np.abs(geometry.g1[:, 0])))
    return max(_FRACTION * acceleration**3 / (6.0 * jerk**2), _LEAST_MM)


def standstill_scale_limit(
    toolpath: Toolpath, limits: MotionLimits, s_standstill_mm: float, length_mm: float, sign: int, scale: float
) -> float:
    """Largest p = (9 J / 2)^(2/3) of a standstill element of given length, mm^(2/3)/s^2.

    Args:
        toolpath: contains the element.
        limits: of the axes and the feed.
        s_standstill_mm: arc length of the standstill.
        length_mm: length of the element.
        sign: +1 where it leaves the standstill, -1 where it reaches it.
        scale: factor on every limit.

    Raises:
        InfeasibleLimitsError: friction and offset alone need the whole control signal that is allowed.
    """
    x = length_mm * _SAMPLES
    kinematic = limits.kinematic
    geometry = axis_geometry(toolpath, kinematic.axis_matrix, s_standstill_mm + sign * x)
    root = np.cbrt(x)
    acceleration = geometry.g2 * root**4 + sign * 2.0 / 3.0 * geometry.g1 * root
    jerk = geometry.g3 * x**2 + sign * 2.0 * geometry.g2 * x + 2.0 / 9.0 * geometry.g1
    bounds: list[FloatArray] = [
        q_limit(geometry, kinematic) * scale**2 / root**4,
        scale * kinematic.acceleration_mm_s2[:, None] / np.maximum(np.abs(acceleration), 1e-300),
        (scale * kinematic.jerk_mm_s3[:, None] / np.maximum(np.abs(jerk), 1e-300)) ** (2.0 / 3.0),
    ]
    velocity = geometry.g1 * root**2
    if limits.control is not None:
        bounds.append(_control_bounds(limits, geometry, velocity, acceleration, s_standstill_mm, scale))
    if limits.tracking is not None:
        tracking = limits.tracking
        terms = (
            tracking.kv_s[:, None] * velocity,
            tracking.ka_s2[:, None] * acceleration,
            tracking.kj_s3[:, None] * jerk,
        )
        allowed = np.broadcast_to(scale * tracking.limit_mm[:, None], velocity.shape)
        bounds.append(_first_crossing(terms, allowed, allowed) ** 2)
    return float(min(np.min(bound) for bound in bounds))


def _control_bounds(
    limits: MotionLimits,
    geometry: AxisGeometry,
    velocity: FloatArray,
    acceleration: FloatArray,
    s_standstill_mm: float,
    scale: float,
) -> FloatArray:
    """Upper bounds of p from the limits of the control signal, shape (n_axes, n)."""
    control = limits.control
    assert control is not None
    constant = control.offset_volts[:, None] + control.coulomb_volts[:, None] * np.sign(geometry.g1)
    allowed = scale * control.limit_volts[:, None]
    needed = np.abs(constant) / allowed
    if np.max(needed) >= 1.0:
        axis = int(np.argmax(np.max(needed, axis=1)))
        raise InfeasibleLimitsError(
            "friction and offset alone need more than the control signal allowed; raise control_limit_volts",
            quantity="control",
            axis=limits.axis_names[axis],
            s_mm=s_standstill_mm,
            ratio=float(np.max(needed)),
        )
    terms = (control.viscous_volts_s_mm[:, None] * velocity, control.inertia_volts_s2_mm[:, None] * acceleration)
    return _first_crossing(terms, allowed - constant, allowed + constant) ** 2


def _first_crossing(terms: tuple[FloatArray, ...], up: FloatArray, down: FloatArray) -> FloatArray:
    """Least y > 0 where ``terms[0] y + terms[1] y^2 + ...`` leaves (-down, up); shape of the terms."""
    flat = np.stack([term.ravel() for term in terms])
    above, below = (np.ascontiguousarray(np.broadcast_to(bound, terms[0].shape)).ravel() for bound in (up, down))
    return _crossings(flat, above, below).reshape(terms[0].shape)


@compiled
def _within(terms: FloatArray, up: FloatArray, down: FloatArray, n: int, y: float) -> bool:
    total = 0.0
    for power in range(len(terms) - 1, -1, -1):
        total = (total + terms[power, n]) * y
    return bool(-down[n] < total < up[n])


@compiled
def _crossings(terms: FloatArray, up: FloatArray, down: FloatArray) -> FloatArray:
    """First crossings of n polynomials, shape (n,): terms of shape (degree, n), bounds (n,)."""
    degree, count = terms.shape
    found = np.empty(count)
    for n in range(count):
        # Where each term stays within an equal share of the limit, the sum stays within the limit.
        share, safe = min(up[n], down[n]) / degree, _UNLIMITED
        for power in range(degree):
            if terms[power, n] != 0.0:
                safe = min(safe, (share / abs(terms[power, n])) ** (1.0 / (power + 1)))
        low = high = safe
        step = _STEP * safe
        while high < _FAR * safe:
            high += step
            if not _within(terms, up, down, n, high):
                break
            low = high
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if _within(terms, up, down, n, middle):
                low = middle
            else:
                high = middle
        found[n] = low
    return found
