"""Smooth set points with closed-form derivatives, sampled once a servo period."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from router_sim.router import AxisStates, SimulatedRouter

PERIOD_S = 0.001


@dataclass(frozen=True)
class Move:
    """Set points of a move; every array has shape (ticks, axes)."""

    position_mm: NDArray[np.float64]
    velocity_mm_s: NDArray[np.float64]
    acceleration_mm_s2: NDArray[np.float64]
    jerk_mm_s3: NDArray[np.float64]

    def run(self, router: SimulatedRouter) -> list[AxisStates]:
        """States of a router that starts at rest at the first set point and follows the move."""
        rows = zip(
            self.position_mm.tolist(), self.velocity_mm_s.tolist(), self.acceleration_mm_s2.tolist(), strict=True
        )
        router.reset(self.position_mm[0].tolist())
        return [router.step(*row) for row in rows]

    def quasi_static_error_mm(self, kv_s: list[float], ka_s2: list[float], kj_s3: list[float]) -> NDArray[np.float64]:
        """Error law ``Kv v + Ka a + Kj j``, shape (ticks, axes)."""
        return kv_s * self.velocity_mm_s + ka_s2 * self.acceleration_mm_s2 + kj_s3 * self.jerk_mm_s3


def turning_angle(rate_rad_s: float, ramp_s: float, hold_s: float) -> list[NDArray[np.float64]]:
    """Angle and its first three derivatives: rest, a rate that rises smoothly, holds and falls again, rest.

    The rate follows the ninth-degree smooth step, so the angle has five continuous derivatives.
    """
    rest_s = 0.1
    t = np.arange(0.0, 2.0 * (rest_s + ramp_s) + hold_s, PERIOD_S) - rest_s
    step = Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])
    swept = step.integ()
    up = np.clip(t / ramp_s, 0.0, 1.0)
    down = np.clip((2.0 * ramp_s + hold_s - t) / ramp_s, 0.0, 1.0)
    held_s = np.clip(t - ramp_s, 0.0, hold_s)
    total = swept(1.0)
    angle = rate_rad_s * (ramp_s * (swept(up) + total - swept(down)) + held_s)
    rates = [rate_rad_s * (step(up) + step(down) - 1.0)]
    rates += [
        rate_rad_s / ramp_s**order * (step.deriv(order)(up) + (-1.0) ** order * step.deriv(order)(down))
        for order in (1, 2)
    ]
    return [angle, *rates]


def ellipse(amplitudes_mm: list[float], phases_rad: list[float], angle: list[NDArray[np.float64]]) -> Move:
    """Each axis a sine of one common angle: ``amplitude (sin(angle + phase) - sin(phase))``."""
    theta, rate, rate2, rate3 = (row[:, np.newaxis] for row in angle)
    amplitude, phase = np.array(amplitudes_mm), np.array(phases_rad)
    sine, cosine = amplitude * np.sin(theta + phase), amplitude * np.cos(theta + phase)
    return Move(
        position_mm=sine - amplitude * np.sin(phase),
        velocity_mm_s=cosine * rate,
        acceleration_mm_s2=cosine * rate2 - sine * rate**2,
        jerk_mm_s3=cosine * (rate3 - rate**3) - 3.0 * sine * rate * rate2,
    )


def circle(radius_mm: float, rate_rad_s: float) -> Move:
    """X and Y on a circle that is entered and left from rest within 0.6 s."""
    return ellipse([radius_mm, radius_mm], [0.0, 0.5 * math.pi], turning_angle(rate_rad_s, 0.6, 2.0))
