"""Parameters of the simulated router: one frozen dataclass for the plant, one for the servo, one for the whole.

A parameter file has flat keys with one entry per axis, because ROS parameters can be lists but not nested records.
Every key is required. There are no defaults, so that a plant always agrees with its file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from feedopt_core.errors import ConfigError
from feedopt_core.schema import parameter

# The coupled substep is an explicit midpoint rule. Above this phase angle per substep its error exceeds one per cent.
LARGEST_MODE_ANGLE_RAD = 0.3


class ControllerKind(Enum):
    """Control law that closes the position loop of every axis."""

    P_PI = "p_pi"
    ADAPTIVE_SLIDING_MODE = "adaptive_sliding_mode"


@dataclass(frozen=True)
class AxisPlantParameters:
    """One real drive: ``volts = inertia a + viscous v + offset + coulomb sign(v)``, and effects beyond this model."""

    inertia_volts_s2_mm: float = parameter("Inertia, drive and load together.", unit="V/(mm/s^2)", above=0.0)
    viscous_volts_s_mm: float = parameter("Viscous friction.", unit="V/(mm/s)", above=0.0)
    offset_volts: float = parameter("Constant load: gravity, preload, amplifier offset.", unit="V")
    coulomb_positive_volts: float = parameter("Coulomb friction in positive direction.", unit="V", at_least=0.0)
    coulomb_negative_volts: float = parameter(
        "Coulomb friction in negative direction, as a magnitude.", unit="V", at_least=0.0
    )
    saturation_volts: float = parameter("Magnitude at which the amplifier saturates.", unit="V", above=0.0)
    static_friction_ratio: float = parameter("Static over Coulomb friction; 1: no Stribeck effect.", at_least=1.0)
    stribeck_velocity_mm_s: float = parameter(
        "Speed at which static minus Coulomb friction has fallen to 1/e.", unit="mm/s", above=0.0
    )
    ripple_volts: float = parameter("Amplitude of the load ripple of the screw; 0: no ripple.", unit="V", at_least=0.0)
    lead_error_mm: float = parameter(
        "Amplitude of the periodic lead error of the screw; 0: no lead error.", unit="mm", at_least=0.0
    )
    screw_pitch_mm: float = parameter("Period of ripple and lead error.", unit="mm", above=0.0)
    backlash_mm: float = parameter("Total backlash between screw and tool; 0: none.", unit="mm", at_least=0.0)
    mode_frequency_hz: float = parameter("Frequency of the belt mode with the motor held.", unit="Hz", above=0.0)
    mode_damping_ratio: float = parameter("Damping of the belt mode with the motor held.", at_least=0.0, below=1.0)
    mode_inertia_ratio: float = parameter(
        "Share of the inertia behind the belt; 0: rigid belt.", at_least=0.0, below=1.0
    )
    encoder_resolution_mm: float = parameter("One encoder count; 0: no quantisation.", unit="mm", at_least=0.0)
    encoder_noise_mm: float = parameter("Standard deviation of the noise before quantisation.", unit="mm", at_least=0.0)


@dataclass(frozen=True)
class ServoParameters:
    """Settings of the servo of one axis; its drive model can differ from the plant.

    The settings of both control laws are always present, so that one key selects the law.
    """

    model_inertia_volts_s2_mm: float = parameter("Inertia the servo assumes.", unit="V/(mm/s^2)", above=0.0)
    model_viscous_volts_s_mm: float = parameter("Viscous friction the servo assumes.", unit="V/(mm/s)", above=0.0)
    model_offset_volts: float = parameter("Constant load the servo assumes.", unit="V")
    model_coulomb_positive_volts: float = parameter(
        "Coulomb friction fed forward by the P-PI servo, positive direction.", unit="V", at_least=0.0
    )
    model_coulomb_negative_volts: float = parameter(
        "Coulomb friction fed forward by the P-PI servo, negative direction.", unit="V", at_least=0.0
    )
    velocity_filter_s: float = parameter(
        "Time constant of the filter of the velocity estimate.", unit="s", at_least=0.0
    )
    in_position_window_mm: float = parameter(
        "Largest error at a commanded standstill for which the integrator is held.", unit="mm", at_least=0.0
    )
    position_gain_per_s: float = parameter("P-PI: velocity command per mm of error.", unit="1/s", above=0.0)
    velocity_gain_volts_s_mm: float = parameter(
        "P-PI: control signal per mm/s of velocity error.", unit="V/(mm/s)", above=0.0
    )
    velocity_integral_per_s: float = parameter(
        "P-PI: inverse of the integral time of the velocity loop.", unit="1/s", above=0.0
    )
    error_velocity_gain_s: float = parameter("P-PI: Kv of the quasi-static error the servo is tuned to.", unit="s")
    error_acceleration_gain_s2: float = parameter(
        "P-PI: Ka of the quasi-static error the servo is tuned to.", unit="s^2"
    )
    error_jerk_gain_s3: float = parameter("P-PI: Kj of the quasi-static error the servo is tuned to.", unit="s^3")
    sliding_bandwidth_rad_s: float = parameter(
        "Sliding mode: lambda, bandwidth of the sliding surface.", unit="rad/s", above=0.0
    )
    sliding_gain_volts_s_rad: float = parameter(
        "Sliding mode: Ks, gain of the sliding variable.", unit="V/(rad/s)", above=0.0
    )
    adaptation_gain_volts_rad: float = parameter(
        "Sliding mode: rho, rate of the disturbance estimate.", unit="V/rad", at_least=0.0
    )
    disturbance_limit_volts: float = parameter(
        "Sliding mode: largest magnitude of the disturbance estimate.", unit="V", at_least=0.0
    )
    transmission_mm_rad: float = parameter("Sliding mode: axis travel per motor radian.", unit="mm/rad", above=0.0)


@dataclass(frozen=True)
class RouterSimParameters:
    """A simulated router: ``plants`` and ``servos`` have one entry per axis, in the order of ``axis_names``.

    Raises:
        ConfigError: the frequency of a belt mode is too high for the number of substeps.
    """

    axis_names: tuple[str, ...] = parameter("Names of the axes.", names=True)
    servo_period_s: float = parameter("Period of the servo.", unit="s", above=0.0, at_most=0.01)
    substeps: int = parameter("Steps of the plant in one servo period.", at_least=1, at_most=1000)
    seed: int = parameter("Seed of the encoder noise.", at_least=0)
    controller: ControllerKind = parameter("Control law of every axis.")
    plants: tuple[AxisPlantParameters, ...] = parameter("Drive of each axis.")
    servos: tuple[ServoParameters, ...] = parameter("Servo of each axis.")

    def __post_init__(self) -> None:
        substep_s = self.servo_period_s / self.substeps
        for axis, plant in zip(self.axis_names, self.plants, strict=True):
            # The free belt mode has a higher frequency than with the motor held: the motor side has finite inertia.
            free_rad_s = 2.0 * math.pi * plant.mode_frequency_hz / math.sqrt(1.0 - plant.mode_inertia_ratio)
            if plant.mode_inertia_ratio > 0.0 and free_rad_s * substep_s > LARGEST_MODE_ANGLE_RAD:
                needed = math.ceil(free_rad_s * self.servo_period_s / LARGEST_MODE_ANGLE_RAD)
                raise ConfigError(f"substeps is {self.substeps}, the mode of axis {axis} needs at least {needed}")
