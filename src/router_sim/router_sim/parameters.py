"""Parameters of the simulated router: one frozen dataclass for the plant, one for the servo, one for the whole.

A parameter file holds flat keys with one entry an axis, because ROS parameters know lists but no nested records.
Every key is required: a simulated machine has no defaults, so a plant cannot differ from its file by accident.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from feedopt_core.errors import ConfigError
from feedopt_core.schema import parameter

# The coupled substep is an explicit midpoint rule: beyond this phase angle a substep its error exceeds a percent.
LARGEST_MODE_ANGLE_RAD = 0.3


class ControllerKind(Enum):
    """Control law that closes the position loop of every axis."""

    P_PI = "p_pi"
    ADAPTIVE_SLIDING_MODE = "adaptive_sliding_mode"


@dataclass(frozen=True)
class AxisPlantParameters:
    """One drive as it is: ``volts = inertia a + viscous v + offset + coulomb sign(v)``, and what that leaves out."""

    inertia_volts_s2_mm: float = parameter("Inertia, drive and load together.", unit="V/(mm/s^2)", above=0.0)
    viscous_volts_s_mm: float = parameter("Viscous friction.", unit="V/(mm/s)", above=0.0)
    offset_volts: float = parameter("Constant load: gravity, preload, amplifier offset.", unit="V")
    coulomb_positive_volts: float = parameter("Coulomb friction while moving towards plus.", unit="V", at_least=0.0)
    coulomb_negative_volts: float = parameter(
        "Coulomb friction while moving towards minus, a magnitude.", unit="V", at_least=0.0
    )
    saturation_volts: float = parameter("Largest magnitude the amplifier passes on.", unit="V", above=0.0)
    static_friction_ratio: float = parameter("Breakaway over Coulomb friction; 1 switches Stribeck off.", at_least=1.0)
    stribeck_velocity_mm_s: float = parameter(
        "Speed at which static friction has decayed by 1/e.", unit="mm/s", above=0.0
    )
    ripple_volts: float = parameter(
        "Amplitude of the load that repeats with the screw; 0 switches it off.", unit="V", at_least=0.0
    )
    lead_error_mm: float = parameter(
        "Amplitude of the screw's periodic lead error; 0 switches it off.", unit="mm", at_least=0.0
    )
    screw_pitch_mm: float = parameter("Period of ripple and lead error.", unit="mm", above=0.0)
    backlash_mm: float = parameter("Total play between screw and tool; 0 switches it off.", unit="mm", at_least=0.0)
    mode_frequency_hz: float = parameter("Frequency of the belt mode with the motor held.", unit="Hz", above=0.0)
    mode_damping_ratio: float = parameter("Damping of the belt mode with the motor held.", at_least=0.0, below=1.0)
    mode_inertia_ratio: float = parameter(
        "Share of the inertia behind the belt; 0 makes it rigid.", at_least=0.0, below=1.0
    )
    encoder_resolution_mm: float = parameter("One encoder count; 0 switches quantisation off.", unit="mm", at_least=0.0)
    encoder_noise_mm: float = parameter("Standard deviation of the noise before quantisation.", unit="mm", at_least=0.0)


@dataclass(frozen=True)
class ServoParameters:
    """What the servo of one axis was commissioned with; its drive model may differ from the plant.

    Both control laws keep their settings, so that one key switches between them.
    """

    model_inertia_volts_s2_mm: float = parameter("Inertia the servo assumes.", unit="V/(mm/s^2)", above=0.0)
    model_viscous_volts_s_mm: float = parameter("Viscous friction the servo assumes.", unit="V/(mm/s)", above=0.0)
    model_offset_volts: float = parameter("Constant load the servo assumes.", unit="V")
    model_coulomb_positive_volts: float = parameter(
        "Coulomb friction the P-PI servo feeds forward, plus.", unit="V", at_least=0.0
    )
    model_coulomb_negative_volts: float = parameter(
        "Coulomb friction the P-PI servo feeds forward, minus.", unit="V", at_least=0.0
    )
    velocity_filter_s: float = parameter(
        "Time constant of the filter on the differenced encoder.", unit="s", at_least=0.0
    )
    in_position_window_mm: float = parameter(
        "Error within which a commanded standstill stops the integrator.", unit="mm", at_least=0.0
    )
    position_gain_per_s: float = parameter("P-PI: velocity command a mm of error.", unit="1/s", above=0.0)
    velocity_gain_volts_s_mm: float = parameter(
        "P-PI: control signal a mm/s of velocity error.", unit="V/(mm/s)", above=0.0
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
        "Sliding mode: lambda, bandwidth on the sliding surface.", unit="rad/s", above=0.0
    )
    sliding_gain_volts_s_rad: float = parameter(
        "Sliding mode: Ks, gain on the sliding variable.", unit="V/(rad/s)", above=0.0
    )
    adaptation_gain_volts_rad: float = parameter(
        "Sliding mode: rho, rate of the disturbance estimate.", unit="V/rad", at_least=0.0
    )
    disturbance_limit_volts: float = parameter(
        "Sliding mode: largest magnitude of the disturbance estimate.", unit="V", at_least=0.0
    )
    transmission_mm_rad: float = parameter("Sliding mode: axis travel a radian of the motor.", unit="mm/rad", above=0.0)


@dataclass(frozen=True)
class RouterSimParameters:
    """A simulated router: ``plants`` and ``servos`` have one entry an axis, in the order of ``axis_names``.

    Raises:
        ConfigError: a mode too fast for the substeps.
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
            # The free mode rings faster than the held one, by the inertia the motor side has left.
            free_rad_s = 2.0 * math.pi * plant.mode_frequency_hz / math.sqrt(1.0 - plant.mode_inertia_ratio)
            if plant.mode_inertia_ratio > 0.0 and free_rad_s * substep_s > LARGEST_MODE_ANGLE_RAD:
                needed = math.ceil(free_rad_s * self.servo_period_s / LARGEST_MODE_ANGLE_RAD)
                raise ConfigError(f"substeps is {self.substeps}, the mode of axis {axis} needs at least {needed}")
