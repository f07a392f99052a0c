"""The planning methods by name."""

from __future__ import annotations

from collections.abc import Callable

from feedopt_core.errors import ConfigError
from feedopt_core.machine.derived_limits import derived_limits
from feedopt_core.machine.limits import MotionLimits
from feedopt_core.machine.machine_file import Machine
from feedopt_core.planner.method import PlanningMethod
from feedopt_core.planner.time_optimal.method import TimeOptimalMethod

MethodFactory = Callable[[Machine, float], PlanningMethod]
"""Makes a method from the machine and the largest knot spacing in mm."""
_ONESHOT_REFINEMENT = 4.0
"""The reference works on a mesh so much finer: its time is within 0.1 % of what still finer ones reach."""


def _lp(machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    return TimeOptimalMethod("lp", "lp", MotionLimits(machine.axis_names, derived_limits(machine)), knot_spacing_mm)


def _lp_nlp(machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    return TimeOptimalMethod("lp_nlp", "nlp", MotionLimits.of(machine), knot_spacing_mm, _safe_limits(machine))


def _oneshot(machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    spacing_mm, safe = knot_spacing_mm / _ONESHOT_REFINEMENT, _safe_limits(machine)
    return TimeOptimalMethod("oneshot", "nlp", MotionLimits.of(machine), spacing_mm, safe, whole_path=True)


def _thesis(machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    # No other method needs CasADi, which takes a tenth of a second to import and has no rosdep key.
    from feedopt_core.planner.thesis.method import ThesisMethod
    from feedopt_core.planner.thesis.program import load_casadi

    load_casadi()
    return ThesisMethod(MotionLimits.of(machine), derived_limits(machine), knot_spacing_mm)


def _safe_limits(machine: Machine) -> MotionLimits | None:
    """Kinematic limits that keep the drives' limits; None where there are none of those."""
    derived = derived_limits(machine)
    driven = machine.drive is not None or machine.tracking is not None
    return MotionLimits(machine.axis_names, derived) if driven else None


_FACTORIES: dict[str, MethodFactory] = {"lp": _lp, "lp_nlp": _lp_nlp, "oneshot": _oneshot, "thesis": _thesis}
METHOD_NAMES = tuple(_FACTORIES)


def make_method(name: str, machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    """Planning method by its name on the command line.

    Raises:
        ConfigError: no such method, or what it needs is not installed.
        InfeasibleLimitsError: the machine's limits leave no motion at all.
    """
    if name not in _FACTORIES:
        raise ConfigError(f"method {name!r} is unknown; there are: {', '.join(METHOD_NAMES)}")
    return _FACTORIES[name](machine, knot_spacing_mm)
