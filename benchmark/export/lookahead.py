"""Ordinary controllers: trapezoidal speeds on straight moves, junction speeds, look-ahead; no code of the core.

Two controllers, after their published rules:

- ``grbl``: 16 moves of look-ahead; acceleration of each axis; the speed through a corner from a junction deviation
  (a circle that leaves the corner by that much: ``v^2 = a d sin / (1 - sin)`` of half the angle between the moves).
- ``klipper``: unlimited look-ahead; one acceleration along the path; corner speeds from a square corner velocity, and
  also ``v^2 = a l tan / 2``, the centripetal limit of the circle that touches both moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_STRAIGHT = 1e-9


@dataclass(frozen=True)
class Controller:
    """One controller.

    Attributes:
        name: ``grbl`` or ``klipper``.
        velocity_mm_s, acceleration_mm_s2: limits of the axes.
        junction_deviation_mm: deviation at a corner, for ``grbl``.
        square_corner_mm_s: speed through a right angle, for ``klipper``.
        lookahead_moves: number of moves within which the machine can always stop; 0: the whole program is known.
    """

    name: str
    velocity_mm_s: tuple[float, ...]
    acceleration_mm_s2: tuple[float, ...]
    junction_deviation_mm: float
    square_corner_mm_s: float
    lookahead_moves: int


@dataclass(frozen=True)
class Ride:
    """Motion of a controller over straight moves; every array has shape (n,), one entry per move.

    Attributes:
        length_mm: length of the move.
        start_mm_s, peak_mm_s, end_mm_s: speeds of its trapezoidal profile.
        acceleration_mm_s2: acceleration along the move.
        time_s: duration of the move.
    """

    length_mm: Array
    start_mm_s: Array
    peak_mm_s: Array
    end_mm_s: Array
    acceleration_mm_s2: Array
    time_s: Array

    @property
    def total_s(self) -> float:
        """Time from standstill to standstill."""
        return float(np.sum(self.time_s))

    def sampled(self, period_s: float) -> tuple[Array, Array]:
        """Distance along the moves and speed at equal times, shape (m,) each."""
        ends_s = np.concatenate([[0.0], np.cumsum(self.time_s)])
        begins_mm = np.concatenate([[0.0], np.cumsum(self.length_mm)])
        t = np.arange(0.0, ends_s[-1], period_s)
        move = np.clip(np.searchsorted(ends_s, t, side="right") - 1, 0, len(self.time_s) - 1)
        x, a = t - ends_s[move], self.acceleration_mm_s2[move]
        start, peak, end = self.start_mm_s[move], self.peak_mm_s[move], self.end_mm_s[move]
        rise_s, fall_s = (peak - start) / a, (peak - end) / a
        left_s = self.time_s[move] - x
        rising, falling = x < rise_s, left_s < fall_s
        s = start * rise_s + 0.5 * a * rise_s**2 + peak * (x - rise_s)
        v = peak.copy()
        s[rising] = (start * x + 0.5 * a * x**2)[rising]
        v[rising] = (start + a * x)[rising]
        s[falling] = (self.length_mm[move] - end * left_s - 0.5 * a * left_s**2)[falling]
        v[falling] = (end + a * left_s)[falling]
        return begins_mm[move] + s, v


def ride(controller: Controller, points_mm: Array, feed_mm_s: Array) -> Ride:
    """Execute straight moves from standstill to standstill.

    Args:
        controller: the controller.
        points_mm: ends of the moves, shape (n + 1, axes).
        feed_mm_s: programmed feed of each move, shape (n,).
    """
    moves = np.diff(points_mm, axis=0)
    length = np.linalg.norm(moves, axis=1)
    unit = moves / length[:, None]
    top = np.minimum(feed_mm_s, _along(unit, controller.velocity_mm_s))
    if controller.name == "grbl":
        a = _along(unit, controller.acceleration_mm_s2)
        corner = _grbl_corners(controller, unit)
    else:
        a = np.full(len(length), min(controller.acceleration_mm_s2))
        corner = _klipper_corners(controller, unit, length, a)
    entry = np.concatenate([[0.0], np.minimum(corner, np.minimum(top[:-1], top[1:]) ** 2)])
    reachable = _stoppable(entry, 2.0 * a * length, controller.lookahead_moves)
    v2 = np.zeros(len(length) + 1)
    for k in range(len(length)):
        behind = reachable[k + 1] if k + 1 < len(length) else 0.0
        v2[k + 1] = min(behind, v2[k] + 2.0 * a[k] * length[k])
    peak = np.sqrt(np.minimum(top**2, 0.5 * (2.0 * a * length + v2[:-1] + v2[1:])))
    start, end = np.minimum(np.sqrt(v2[:-1]), peak), np.minimum(np.sqrt(v2[1:]), peak)
    ramps_mm = (2.0 * peak**2 - start**2 - end**2) / (2.0 * a)
    time_s = (2.0 * peak - start - end) / a + np.maximum(length - ramps_mm, 0.0) / peak
    return Ride(length, start, peak, end, a, time_s)


def _along(unit: Array, limits: tuple[float, ...]) -> Array:
    """Largest value along directions that keeps every axis within its limit, shape (n,)."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.min(np.array(limits) / np.abs(unit), axis=1))


def _grbl_corners(controller: Controller, unit: Array) -> Array:
    """Largest squared speed through each corner, shape (n - 1,)."""
    turn = unit[1:] - unit[:-1]
    size = np.linalg.norm(turn, axis=1)
    sin_half = np.sqrt(np.clip(0.5 * (1.0 + np.sum(unit[:-1] * unit[1:], axis=1)), 0.0, 1.0))
    a = _along(turn / np.maximum(size, _STRAIGHT)[:, None], controller.acceleration_mm_s2)
    with np.errstate(divide="ignore", invalid="ignore"):
        v2 = a * controller.junction_deviation_mm * sin_half / (1.0 - sin_half)
    return np.where(size < _STRAIGHT, np.inf, v2)


def _klipper_corners(controller: Controller, unit: Array, length: Array, a: Array) -> Array:
    """Largest squared speed through each corner, shape (n - 1,)."""
    cos_turn = np.clip(np.sum(unit[:-1] * unit[1:], axis=1), -1.0, 1.0)
    sin_half, cos_half = np.sqrt(0.5 * (1.0 + cos_turn)), np.sqrt(0.5 * (1.0 - cos_turn))
    deviation = controller.square_corner_mm_s**2 * (np.sqrt(2.0) - 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        junction = deviation * sin_half / (1.0 - sin_half)
        touching = 0.5 * a[1:] * np.minimum(length[:-1], length[1:]) * sin_half / cos_half
        v2 = np.minimum(junction, touching)
    return np.where(cos_half < _STRAIGHT, np.inf, v2)


def _stoppable(entry: Array, gain: Array, lookahead: int) -> Array:
    """Squared entry speed of each move from which the machine can stop within the look-ahead, shape (n,)."""
    reachable = np.zeros(len(entry))
    for _ in range(lookahead or len(entry)):
        behind = np.append(reachable[1:], 0.0)
        new = np.minimum(entry, behind + gain)
        if np.array_equal(new, reachable):
            break
        reachable = new
    return reachable
