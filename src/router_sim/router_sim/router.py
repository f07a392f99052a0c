"""The simulated router: a servo loop and a drive for every axis, one step per set point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from feedopt_core.errors import FeedoptError
from router_sim.controllers import make_controller
from router_sim.parameters import RouterSimParameters
from router_sim.plant import AxisPlant, Encoder


class SetpointError(FeedoptError):
    """An invalid set point: wrong number of axes, or a value that is not finite."""


@dataclass(frozen=True)
class AxisStates:
    """State of all axes at the instant of one set point; every tuple has one entry an axis.

    Attributes:
        reference_mm: commanded position.
        position_mm: reading of the encoder on the motor at that instant.
        velocity_mm_s: true velocity of the motor at that instant, in axis units.
        tool_position_mm: true position of the tool, behind belt, lead error and backlash; not measured by the servo.
        tracking_error_mm: ``reference_mm - position_mm``.
        control_signal_volts: output of the controller, after saturation, held until the next set point.
        saturated: the control signal is at its limit.
    """

    reference_mm: tuple[float, ...]
    position_mm: tuple[float, ...]
    velocity_mm_s: tuple[float, ...]
    tool_position_mm: tuple[float, ...]
    tracking_error_mm: tuple[float, ...]
    control_signal_volts: tuple[float, ...]
    saturated: tuple[bool, ...]


class SimulatedRouter:
    """Servo loops and drives of a router, one step per set point.

    Tick k reads every encoder at the instant of set point k, computes the control signal from set point k and that
    reading, and holds it for one servo period, during which the drive moves. So the tracking error of tick k compares
    set point and encoder at the same instant, as a servo does. The error law to which the servo is tuned then holds
    without a constant delay, which would add to its velocity coefficient.

    Axes are independent. The two motors of a gantry are two axes with the same set point.
    """

    def __init__(self, parameters: RouterSimParameters) -> None:
        self._axis_names = parameters.axis_names
        period_s = parameters.servo_period_s
        self._plants = [AxisPlant(plant, period_s, parameters.substeps) for plant in parameters.plants]
        self._encoders = [
            Encoder(plant.encoder_resolution_mm, plant.encoder_noise_mm, f"{parameters.seed} {axis}")
            for axis, plant in enumerate(parameters.plants)
        ]
        self._saturation_volts = [plant.saturation_volts for plant in parameters.plants]
        self._controllers = [
            make_controller(parameters.controller, servo, plant.saturation_volts, period_s)
            for servo, plant in zip(parameters.servos, parameters.plants, strict=True)
        ]
        self.reset([0.0] * len(self._axis_names))

    def reset(self, position_mm: Sequence[float]) -> None:
        """Start from standstill at a position, with controllers and noise reset; shape (n_axes,).

        Raises:
            SetpointError: wrong length, or a value is not finite.
        """
        self._check("position_mm", position_mm)
        for position, plant, encoder, controller in zip(
            position_mm, self._plants, self._encoders, self._controllers, strict=True
        ):
            plant.reset(float(position))
            encoder.reset()
            controller.reset(encoder.measure(plant.position_mm))

    def step(
        self, position_mm: Sequence[float], velocity_mm_s: Sequence[float], acceleration_mm_s2: Sequence[float]
    ) -> AxisStates:
        """Compute the states at one set point and move to the next; each argument has shape (n_axes,).

        Returns:
            The states at the instant of this set point.

        Raises:
            SetpointError: wrong length, or a value is not finite; no axis has moved then.
        """
        self._check("position_mm", position_mm)
        self._check("velocity_mm_s", velocity_mm_s)
        self._check("acceleration_mm_s2", acceleration_mm_s2)
        measured = [
            encoder.measure(plant.position_mm) for encoder, plant in zip(self._encoders, self._plants, strict=True)
        ]
        volts = [
            controller.control_signal(*axis_input)
            for controller, *axis_input in zip(
                self._controllers, position_mm, velocity_mm_s, acceleration_mm_s2, measured, strict=True
            )
        ]
        states = AxisStates(
            reference_mm=tuple(position_mm),
            position_mm=tuple(measured),
            velocity_mm_s=tuple(plant.velocity_mm_s for plant in self._plants),
            tool_position_mm=tuple(plant.tool_position_mm for plant in self._plants),
            tracking_error_mm=tuple(reference - read for reference, read in zip(position_mm, measured, strict=True)),
            control_signal_volts=tuple(volts),
            saturated=tuple(abs(u) >= limit for u, limit in zip(volts, self._saturation_volts, strict=True)),
        )
        for plant, u in zip(self._plants, volts, strict=True):
            plant.advance(u)
        return states

    def _check(self, name: str, values: Sequence[float]) -> None:
        if len(values) != len(self._axis_names):
            axes = ", ".join(self._axis_names)
            raise SetpointError(
                f"set point has {len(values)} values of {name}, the simulated router has the axes {axes}"
            )
        for axis, value in zip(self._axis_names, values, strict=True):
            if not math.isfinite(value):
                raise SetpointError(f"set point of axis {axis} has {name} {value!r}, must be finite")
