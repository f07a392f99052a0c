"""The planning methods by name."""

from __future__ import annotations

from feedopt_core.config.machine import Machine
from feedopt_core.errors import ConfigError
from feedopt_core.feedrate.lp import KinematicMethod
from feedopt_core.feedrate.method import PlanningMethod
from feedopt_core.limits.derived import derived_limits

METHOD_NAMES = ("lp",)


def make_method(name: str, machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    """Planning method by its name on the command line.

    Raises:
        ConfigError: no such method.
        InfeasibleLimitsError: the machine's limits leave no motion at all.
    """
    if name == "lp":
        return KinematicMethod(derived_limits(machine), knot_spacing_mm)
    raise ConfigError(f"method {name!r} is unknown; there are: {', '.join(METHOD_NAMES)}")
