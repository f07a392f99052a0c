"""Feed-forward gains that give the P-PI servo a specified quasi-static tracking error.

With sampled set points ``r(k T)`` of a smooth reference, the error of the linear servo loop is ``e = G r`` at the
sampling instants, with ``z = exp(s T)`` and ::

    G = (1/P + C (D - k_v s) - f_v s - f_a s^2 - f_j s^2 (1 - 1/z) / T) / (1/P + C (K_p + D))

P: drive with a zero-order hold, C: velocity PI, D: velocity estimate from the encoder. The Maclaurin series of G is a
quasi-static error law, ``e = Kv v + Ka a + Kj j + Ks snap + ...``. Each of the four feed-forward gains changes one
coefficient and the higher ones, so the gains for four specified coefficients follow one after the other.
Derivation: docs/simulated_router.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from router_sim.parameters import ServoParameters

_Series: TypeAlias = NDArray[np.float64]  # coefficients of s^0, s^1, ...

# The pole of the integrator is removed by a multiplication by s, so the snap coefficient (s^4) needs terms up to s^5.
_TERMS = 8


@dataclass(frozen=True)
class FeedForwardGains:
    """Feed-forward of the P-PI servo.

    ``velocity_ratio`` multiplies the velocity reference in the velocity command. The other gains add to the control
    signal: V/(mm/s), V/(mm/s^2) and V/(mm/s^3).
    """

    velocity_ratio: float
    viscous_volts_s_mm: float
    inertia_volts_s2_mm: float
    jerk_volts_s3_mm: float


def feed_forward_gains(servo: ServoParameters, period_s: float) -> FeedForwardGains:
    """Gains for which a drive equal to the model of the servo follows the error law of ``servo``.

    The specified series is ``Kv s + Ka s^2 + Kj s^3 + 0 s^4``. It has no snap term, so the law holds up to the fifth
    derivative.

    Args:
        servo: gains, drive model and specified error coefficients.
        period_s: period of the servo loop.
    """
    inverse_z = _exponential(-period_s)
    backward = _constant(1.0) - inverse_z
    retained = math.exp(-period_s / servo.velocity_filter_s) if servo.velocity_filter_s > 0.0 else 0.0
    estimate = _divide((1.0 - retained) / period_s * backward, _constant(1.0) - retained * inverse_z)
    integral = servo.velocity_integral_per_s * period_s * _divide(_constant(1.0), _over_s(backward))
    velocity_loop = servo.velocity_gain_volts_s_mm * (_times_s(_constant(1.0), 1) + integral)
    drive = _times_s(_inverse_drive(servo, period_s), 1)
    stiffness = drive + _multiply(velocity_loop, estimate + servo.position_gain_per_s * _constant(1.0))
    wanted = np.zeros(_TERMS)
    wanted[1:4] = servo.error_velocity_gain_s, servo.error_acceleration_gain_s2, servo.error_jerk_gain_s3

    # All terms are multiplied by s. The feed-forward terms cancel the remainder, one order after the other.
    excess = drive + _multiply(velocity_loop, estimate) - _multiply(wanted, stiffness)
    commanded = _times_s(velocity_loop, 1)
    velocity_ratio = float(excess[1] / commanded[1])
    excess = excess - velocity_ratio * commanded
    viscous, inertia = float(excess[2]), float(excess[3])
    jerk = _times_s(backward / period_s, 3)
    return FeedForwardGains(velocity_ratio, viscous, inertia, float(excess[4] / jerk[4]))


def _inverse_drive(servo: ServoParameters, period_s: float) -> _Series:
    """Series of 1/P: inertia and viscous friction behind a zero-order hold, from volts to mm."""
    time_constant_s = servo.model_inertia_volts_s2_mm / servo.model_viscous_volts_s_mm
    gained = -math.expm1(-period_s / time_constant_s)
    glide_s = time_constant_s * gained
    z = _exponential(period_s)
    lag = z - (1.0 - gained) * _constant(1.0)
    numerator = ((period_s - glide_s) * lag + glide_s * gained * _constant(1.0)) / servo.model_viscous_volts_s_mm
    return _divide(_multiply(z - _constant(1.0), lag), numerator)


def _constant(value: float) -> _Series:
    series = np.zeros(_TERMS)
    series[0] = value
    return series


def _exponential(time_s: float) -> _Series:
    return np.array([time_s**order / math.factorial(order) for order in range(_TERMS)])


def _multiply(left: _Series, right: _Series) -> _Series:
    return np.convolve(left, right)[:_TERMS]


def _divide(numerator: _Series, denominator: _Series) -> _Series:
    quotient = np.zeros(_TERMS)
    for order in range(_TERMS):
        known = float(quotient[:order] @ denominator[order:0:-1])
        quotient[order] = (numerator[order] - known) / denominator[0]
    return quotient


def _times_s(series: _Series, power: int) -> _Series:
    return np.concatenate([np.zeros(power), series])[:_TERMS]


def _over_s(series: _Series) -> _Series:
    # The highest coefficient is lost. The zero in its place has no effect: only terms up to s^5 are used.
    return np.append(series[1:], 0.0)
