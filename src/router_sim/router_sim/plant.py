"""One drive of the router: motor with friction, belt mode, screw, tool and encoder.

Equation of motion, in units of the control signal::

    inertia dv/dt = volts - offset - ripple(x) - belt(x, y) - viscous v - friction(v) sign(v)

Between two changes of the direction of motion it is linear in ``v``, so a step under a constant control signal is an
exponential in closed form. The step is split where the velocity reaches zero. There the axis sticks while the force is
within the static friction; otherwise it moves on in the direction of the force.
"""

from __future__ import annotations

import math
import random

from router_sim.parameters import AxisPlantParameters


class AxisPlant:
    """Drive of one axis; positions in mm, velocities in mm/s, the input in V.

    A drive without mode, ripple and Stribeck friction takes one exact step a servo period. With them, force and
    friction are held at their midpoint values over each substep (second order), inside which the motion is exact.

    Args:
        parameters: the drive.
        period_s: time for which a control signal is held.
        substeps: number of substeps per period, for drives that need them.
    """

    def __init__(self, parameters: AxisPlantParameters, period_s: float, substeps: int) -> None:
        # Copied to attributes for speed: a coupled axis reads them a hundred times per period.
        self._saturation = parameters.saturation_volts
        self._offset = parameters.offset_volts
        self._friction_positive = parameters.coulomb_positive_volts
        self._friction_negative = parameters.coulomb_negative_volts
        self._breakaway_positive = parameters.static_friction_ratio * parameters.coulomb_positive_volts
        self._breakaway_negative = parameters.static_friction_ratio * parameters.coulomb_negative_volts
        self._static_excess = parameters.static_friction_ratio - 1.0
        self._stribeck_mm_s = parameters.stribeck_velocity_mm_s
        self._ripple_volts = parameters.ripple_volts
        self._lead_error_mm = parameters.lead_error_mm
        self._half_play_mm = 0.5 * parameters.backlash_mm
        ratio = parameters.mode_inertia_ratio
        self._load_inertia = ratio * parameters.inertia_volts_s2_mm
        self._motor_inertia = parameters.inertia_volts_s2_mm - self._load_inertia
        mode_rad_s = 2.0 * math.pi * parameters.mode_frequency_hz
        self._belt_stiffness = self._load_inertia * mode_rad_s**2
        self._belt_damping = 2.0 * parameters.mode_damping_ratio * mode_rad_s * self._load_inertia
        self._exact = ratio == 0.0 and parameters.ripple_volts == 0.0 and parameters.static_friction_ratio == 1.0
        self._substeps = 1 if self._exact else substeps
        self._step_s = period_s / self._substeps
        self._viscous = parameters.viscous_volts_s_mm
        self._time_constant_s = self._motor_inertia / self._viscous
        self._glide_s = -self._time_constant_s * math.expm1(-self._step_s / self._time_constant_s)
        self._decay = math.exp(-self._step_s / self._time_constant_s)
        self._screw_rad_mm = 2.0 * math.pi / parameters.screw_pitch_mm
        self.reset(0.0)

    def reset(self, position_mm: float) -> None:
        """Start from standstill at a motor position, belt relaxed, tool in the middle of the backlash."""
        self.position_mm = position_mm
        self.velocity_mm_s = 0.0
        self.screw_position_mm = position_mm
        self.screw_velocity_mm_s = 0.0
        self.tool_position_mm = self._nut_position_mm()

    def advance(self, volts: float) -> None:
        """Move by one period under a constant control signal, clipped to the saturation of the amplifier."""
        force = min(max(volts, -self._saturation), self._saturation) - self._offset
        if self._exact:
            self._slide(force, 1.0)
        else:
            for _ in range(self._substeps):
                self._slide_coupled(force)
        if self._load_inertia == 0.0:
            self.screw_position_mm = self.position_mm
            self.screw_velocity_mm_s = self.velocity_mm_s
        nut_mm = self._nut_position_mm()
        self.tool_position_mm = min(
            max(self.tool_position_mm, nut_mm - self._half_play_mm), nut_mm + self._half_play_mm
        )

    def _nut_position_mm(self) -> float:
        return self.screw_position_mm + self._lead_error_mm * math.sin(self._screw_rad_mm * self.screw_position_mm)

    def _direction(self, force: float) -> float:
        """Direction of motion, +1 or -1; at standstill the direction of the force, or 0 if the axis sticks."""
        if self.velocity_mm_s > 0.0:
            return 1.0
        if self.velocity_mm_s < 0.0:
            return -1.0
        if force > self._breakaway_positive:
            return 1.0
        if force < -self._breakaway_negative:
            return -1.0
        return 0.0

    def _slide(self, force: float, friction_ratio: float) -> None:
        """Exact motion over one step under a constant force; friction_ratio is kinetic over Coulomb friction."""
        velocity = self.velocity_mm_s
        direction = self._direction(force)
        if direction == 0.0:
            return
        friction = self._friction_positive if direction > 0.0 else -self._friction_negative
        terminal = (force - friction_ratio * friction) / self._viscous
        final = terminal + (velocity - terminal) * self._decay
        if final * direction >= 0.0:
            self.position_mm += terminal * self._step_s + (velocity - terminal) * self._glide_s
            self.velocity_mm_s = final
            return
        stop_s = self._time_constant_s * math.log1p(-velocity / terminal)
        self.position_mm += terminal * stop_s + velocity * self._time_constant_s
        self.velocity_mm_s = 0.0
        direction = self._direction(force)
        if direction == 0.0:
            return
        # The force that reversed the axis is constant over the step: no second stop in this step.
        rest_s = self._step_s - stop_s
        friction = self._friction_positive if direction > 0.0 else -self._friction_negative
        terminal = (force - friction_ratio * friction) / self._viscous
        gained = -math.expm1(-rest_s / self._time_constant_s)
        self.velocity_mm_s = terminal * gained
        self.position_mm += terminal * (rest_s - self._time_constant_s * gained)

    def _slide_coupled(self, force: float) -> None:
        """One substep with ripple, Stribeck friction and belt held at their values in the middle of it."""
        half_s = 0.5 * self._step_s
        position, velocity = self.position_mm, self.velocity_mm_s
        screw, screw_velocity = self.screw_position_mm, self.screw_velocity_mm_s
        belt = self._belt_stiffness * (position - screw) + self._belt_damping * (velocity - screw_velocity)
        middle = position + half_s * velocity
        middle_velocity = self._middle_velocity_mm_s(force - self._ripple(position) - belt)
        if self._load_inertia > 0.0:
            stretch_mm = middle - screw - half_s * screw_velocity
            stretch_mm_s = middle_velocity - screw_velocity - half_s * belt / self._load_inertia
            belt = self._belt_stiffness * stretch_mm + self._belt_damping * stretch_mm_s
            self.screw_velocity_mm_s = screw_velocity + self._step_s * belt / self._load_inertia
            self.screw_position_mm = screw + half_s * (screw_velocity + self.screw_velocity_mm_s)
        self._slide(force - self._ripple(middle) - belt, self._friction_ratio(middle_velocity))

    def _middle_velocity_mm_s(self, force: float) -> float:
        """Velocity after half a substep; 0 if the axis stops before."""
        velocity = self.velocity_mm_s
        direction = self._direction(force)
        if direction == 0.0:
            return 0.0
        friction = self._friction_positive if direction > 0.0 else -self._friction_negative
        drive = force - self._friction_ratio(velocity) * friction - self._viscous * velocity
        middle = velocity + 0.5 * self._step_s * drive / self._motor_inertia
        return middle if middle * direction > 0.0 else 0.0

    def _friction_ratio(self, velocity_mm_s: float) -> float:
        if self._static_excess == 0.0:
            return 1.0
        speed = velocity_mm_s / self._stribeck_mm_s
        return 1.0 + self._static_excess * math.exp(-speed * speed)

    def _ripple(self, position_mm: float) -> float:
        return self._ripple_volts * math.sin(self._screw_rad_mm * position_mm) if self._ripple_volts > 0.0 else 0.0


class Encoder:
    """Encoder on the motor: adds normally distributed noise, then rounds to the nearest count.

    Args:
        resolution_mm: one count; 0: no rounding.
        noise_mm: standard deviation of the noise; 0: no noise.
        seed: text as the seed of the noise.
    """

    def __init__(self, resolution_mm: float, noise_mm: float, seed: str) -> None:
        self._resolution_mm = resolution_mm
        self._noise_mm = noise_mm
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Restart the noise from its seed."""
        self._random = random.Random(self._seed)

    def measure(self, position_mm: float) -> float:
        """Reading of a position, both in mm."""
        if self._noise_mm > 0.0:
            position_mm += self._random.gauss(0.0, self._noise_mm)
        if self._resolution_mm > 0.0:
            position_mm = math.floor(position_mm / self._resolution_mm + 0.5) * self._resolution_mm
        return position_mm
