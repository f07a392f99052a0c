"""Parameters of the simulated router: one frozen dataclass for the plant, one for the servo, one for the whole.

A parameter file holds flat keys with one entry an axis, because ROS parameters know lists but no nested records.
Every key is required: a simulated machine has no defaults, so a plant cannot differ from its file by accident.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from enum import Enum
from typing import Any

from feedopt_core.errors import ConfigError

# The coupled substep is an explicit midpoint rule: beyond this phase angle a substep its error exceeds a percent.
LARGEST_MODE_ANGLE_RAD = 0.3


class ControllerKind(Enum):
    """Control law that closes the position loop of every axis."""

    P_PI = "p_pi"
    ADAPTIVE_SLIDING_MODE = "adaptive_sliding_mode"


def _quantity(
    unit: str,
    doc: str,
    *,
    at_least: float = -math.inf,
    above: float = -math.inf,
    at_most: float = math.inf,
    below: float = math.inf,
) -> Any:
    return field(
        metadata={"unit": unit, "doc": doc, "at_least": at_least, "above": above, "at_most": at_most, "below": below}
    )


def _check_range(name: str, value: float, quantity: Mapping[str, Any]) -> None:
    if not math.isfinite(value):
        raise ConfigError(f"{name} is {value!r}, must be finite")
    for bound, holds in (
        ("at_least", value >= quantity["at_least"]),
        ("above", value > quantity["above"]),
        ("at_most", value <= quantity["at_most"]),
        ("below", value < quantity["below"]),
    ):
        if not holds:
            raise ConfigError(
                f"{name} is {value!r} {quantity['unit']}, must be {bound.replace('_', ' ')} {quantity[bound]!r}"
            )


def _check_quantities(parameters: AxisPlantParameters | ServoParameters) -> None:
    for quantity in fields(parameters):
        _check_range(quantity.name, getattr(parameters, quantity.name), quantity.metadata)


@dataclass(frozen=True)
class AxisPlantParameters:
    """One drive as it is: ``volts = inertia a + viscous v + offset + coulomb sign(v)`` and what that model leaves out.

    Raises:
        ConfigError: a value outside its range; names the key.
    """

    inertia_volts_s2_mm: float = _quantity("V/(mm/s^2)", "inertia, drive and load together", above=0.0)
    viscous_volts_s_mm: float = _quantity("V/(mm/s)", "viscous friction", above=0.0)
    offset_volts: float = _quantity("V", "constant load: gravity, preload, amplifier offset")
    coulomb_positive_volts: float = _quantity("V", "Coulomb friction while moving towards plus", at_least=0.0)
    coulomb_negative_volts: float = _quantity(
        "V", "Coulomb friction while moving towards minus, a magnitude", at_least=0.0
    )
    saturation_volts: float = _quantity("V", "largest magnitude the amplifier passes on", above=0.0)
    static_friction_ratio: float = _quantity(
        "-", "breakaway over Coulomb friction; 1 switches Stribeck off", at_least=1.0
    )
    stribeck_velocity_mm_s: float = _quantity("mm/s", "speed at which static friction has decayed by 1/e", above=0.0)
    ripple_volts: float = _quantity(
        "V", "amplitude of the load that repeats with the screw; 0 switches it off", at_least=0.0
    )
    lead_error_mm: float = _quantity(
        "mm", "amplitude of the screw's periodic lead error; 0 switches it off", at_least=0.0
    )
    screw_pitch_mm: float = _quantity("mm", "period of ripple and lead error", above=0.0)
    backlash_mm: float = _quantity("mm", "total play between screw and tool; 0 switches it off", at_least=0.0)
    mode_frequency_hz: float = _quantity("Hz", "frequency of the belt mode with the motor held", above=0.0)
    mode_damping_ratio: float = _quantity("-", "damping of the belt mode with the motor held", at_least=0.0, below=1.0)
    mode_inertia_ratio: float = _quantity(
        "-", "share of the inertia behind the belt; 0 makes it rigid", at_least=0.0, below=1.0
    )
    encoder_resolution_mm: float = _quantity("mm", "one encoder count; 0 switches quantisation off", at_least=0.0)
    encoder_noise_mm: float = _quantity("mm", "standard deviation of the noise before quantisation", at_least=0.0)

    def __post_init__(self) -> None:
        _check_quantities(self)


@dataclass(frozen=True)
class ServoParameters:
    """What the servo of one axis was commissioned with; its drive model may differ from the plant.

    Both control laws keep their settings, so that one key switches between them.

    Raises:
        ConfigError: a value outside its range; names the key.
    """

    model_inertia_volts_s2_mm: float = _quantity("V/(mm/s^2)", "inertia the servo assumes", above=0.0)
    model_viscous_volts_s_mm: float = _quantity("V/(mm/s)", "viscous friction the servo assumes", above=0.0)
    model_offset_volts: float = _quantity("V", "constant load the servo assumes")
    model_coulomb_positive_volts: float = _quantity(
        "V", "Coulomb friction the P-PI servo feeds forward, plus", at_least=0.0
    )
    model_coulomb_negative_volts: float = _quantity(
        "V", "Coulomb friction the P-PI servo feeds forward, minus", at_least=0.0
    )
    velocity_filter_s: float = _quantity("s", "time constant of the filter on the differenced encoder", at_least=0.0)
    in_position_window_mm: float = _quantity(
        "mm", "error within which a commanded rest stops the integrator", at_least=0.0
    )
    position_gain_per_s: float = _quantity("1/s", "P-PI: velocity command a mm of error", above=0.0)
    velocity_gain_volts_s_mm: float = _quantity("V/(mm/s)", "P-PI: control signal a mm/s of velocity error", above=0.0)
    velocity_integral_per_s: float = _quantity(
        "1/s", "P-PI: inverse of the integral time of the velocity loop", above=0.0
    )
    error_velocity_gain_s: float = _quantity("s", "P-PI: Kv of the quasi-static error the servo is tuned to")
    error_acceleration_gain_s2: float = _quantity("s^2", "P-PI: Ka of the quasi-static error the servo is tuned to")
    error_jerk_gain_s3: float = _quantity("s^3", "P-PI: Kj of the quasi-static error the servo is tuned to")
    sliding_bandwidth_rad_s: float = _quantity(
        "rad/s", "sliding mode: lambda, bandwidth on the sliding surface", above=0.0
    )
    sliding_gain_volts_s_rad: float = _quantity(
        "V/(rad/s)", "sliding mode: Ks, gain on the sliding variable", above=0.0
    )
    adaptation_gain_volts_rad: float = _quantity(
        "V/rad", "sliding mode: rho, rate of the disturbance estimate", at_least=0.0
    )
    disturbance_limit_volts: float = _quantity(
        "V", "sliding mode: largest magnitude of the disturbance estimate", at_least=0.0
    )
    transmission_mm_rad: float = _quantity("mm/rad", "sliding mode: axis travel a radian of the motor", above=0.0)

    def __post_init__(self) -> None:
        _check_quantities(self)


@dataclass(frozen=True)
class RouterSimParameters:
    """A simulated router: ``plants`` and ``servos`` have one entry an axis, in the order of ``axis_names``.

    Raises:
        ConfigError: no axis, a name twice, lengths that differ, a period, substep count or seed out of range, or a
            mode too fast for the substeps.
    """

    axis_names: tuple[str, ...]
    servo_period_s: float
    substeps: int
    seed: int
    controller: ControllerKind
    plants: tuple[AxisPlantParameters, ...]
    servos: tuple[ServoParameters, ...]

    def __post_init__(self) -> None:
        if not self.axis_names or len(set(self.axis_names)) != len(self.axis_names):
            raise ConfigError(f"axis_names must name every axis once, is {list(self.axis_names)!r}")
        if not len(self.axis_names) == len(self.plants) == len(self.servos):
            raise ConfigError(
                f"{len(self.axis_names)} axis_names, {len(self.plants)} plants and {len(self.servos)} servos differ"
            )
        if not (math.isfinite(self.servo_period_s) and 0.0 < self.servo_period_s <= 0.01):
            raise ConfigError(f"servo_period_s is {self.servo_period_s!r} s, must be above 0 and at most 0.01")
        if not 1 <= self.substeps <= 1000:
            raise ConfigError(f"substeps is {self.substeps!r}, must be 1 to 1000")
        if self.seed < 0:
            raise ConfigError(f"seed is {self.seed!r}, must not be negative")
        substep_s = self.servo_period_s / self.substeps
        for axis, plant in zip(self.axis_names, self.plants, strict=True):
            # The free mode rings faster than the held one, by the inertia the motor side has left.
            free_rad_s = 2.0 * math.pi * plant.mode_frequency_hz / math.sqrt(1.0 - plant.mode_inertia_ratio)
            if plant.mode_inertia_ratio > 0.0 and free_rad_s * substep_s > LARGEST_MODE_ANGLE_RAD:
                needed = math.ceil(free_rad_s * self.servo_period_s / LARGEST_MODE_ANGLE_RAD)
                raise ConfigError(f"substeps is {self.substeps}, the mode of axis {axis} needs at least {needed}")

    @classmethod
    def from_mapping(cls, section: Mapping[str, Any]) -> RouterSimParameters:
        """Parameters from the flat keys of a ``ros__parameters`` section.

        Args:
            section: per axis keys, the field names of :class:`AxisPlantParameters` and :class:`ServoParameters`, hold
                a list with one float for each of ``axis_names``; ``servo_period_s`` is a float, ``substeps`` and
                ``seed`` are integers, ``controller`` is a value of :class:`ControllerKind`.

        Raises:
            ConfigError: unknown or missing keys, a wrong type, length or range; names key and axis.
        """
        return _Section(section).parameters()


_AXIS_FIELDS: tuple[Field[Any], ...] = (*fields(AxisPlantParameters), *fields(ServoParameters))
_SCALAR_KEYS = ("axis_names", "servo_period_s", "substeps", "seed", "controller")


class _Section:
    """A parameter section while it is being checked."""

    def __init__(self, section: Mapping[str, Any]) -> None:
        known = {*_SCALAR_KEYS, *(quantity.name for quantity in _AXIS_FIELDS)}
        unknown = sorted(set(section) - known)
        if unknown:
            raise ConfigError(f"unknown keys {', '.join(unknown)}; known are {', '.join(sorted(known))}")
        missing = sorted(known - set(section))
        if missing:
            raise ConfigError(f"missing keys {', '.join(missing)}; a simulated router has no defaults")
        self._section = section
        self._axis_names = self._names()

    def parameters(self) -> RouterSimParameters:
        rows = {quantity.name: self._row(quantity) for quantity in _AXIS_FIELDS}
        axes = range(len(self._axis_names))
        return RouterSimParameters(
            axis_names=self._axis_names,
            servo_period_s=_floating("servo_period_s", self._section["servo_period_s"]),
            substeps=_integer("substeps", self._section["substeps"]),
            seed=_integer("seed", self._section["seed"]),
            controller=self._controller(),
            plants=tuple(AxisPlantParameters(*(rows[q.name][i] for q in fields(AxisPlantParameters))) for i in axes),
            servos=tuple(ServoParameters(*(rows[q.name][i] for q in fields(ServoParameters))) for i in axes),
        )

    def _names(self) -> tuple[str, ...]:
        names = self._section["axis_names"]
        if not _is_list(names) or not all(isinstance(name, str) and name for name in names):
            raise ConfigError(f"axis_names must be a list of names, is {names!r}")
        return tuple(names)

    def _row(self, quantity: Field[Any]) -> list[float]:
        values = self._section[quantity.name]
        if not _is_list(values) or len(values) != len(self._axis_names):
            wanted = f"{len(self._axis_names)} values, one for each of {', '.join(self._axis_names)}"
            raise ConfigError(f"{quantity.name} is {values!r}, needs {wanted}")
        row = []
        for axis, value in zip(self._axis_names, values, strict=True):
            place = f"{quantity.name} of axis {axis}"
            number = _floating(place, value)
            _check_range(place, number, quantity.metadata)
            row.append(number)
        return row

    def _controller(self) -> ControllerKind:
        name = self._section["controller"]
        try:
            return ControllerKind(name)
        except ValueError:
            choices = " or ".join(kind.value for kind in ControllerKind)
            raise ConfigError(f"controller is {name!r}, must be {choices}") from None


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _floating(place: str, value: Any) -> float:
    # ROS parameters are strictly typed: an integer accepted here would be refused by the node with the same file.
    if not isinstance(value, float):
        raise ConfigError(f"{place} is {value!r}, must be a floating-point number (write 10.0, 1.0e-3)")
    return value


def _integer(place: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ConfigError(f"{place} is {value!r}, must be an integer")
    return value
