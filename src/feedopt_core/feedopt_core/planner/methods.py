"""The planning methods by name. Each plans one window of the path, from its start state to standstill at its end.

``lp``
    Minimum motion time under velocity, acceleration and jerk limits of each axis. Where the machine has a drive or
    tracking model, these limits are lowered so far that control signal and tracking error hold in the worst case.
    Solved by the interior point in ``solver/``, with a quadratic B-spline for q(s).
``lp_nlp``
    Minimum motion time as ``lp``, but control signal and tracking error are limits themselves, so that the machine is
    used better. Same solver. Where it fails on a window, it is run again with cautious steps on a finer mesh, started
    from the plan of ``lp`` if that exists. Where this fails too, the plan of ``lp`` is taken. This is the default.
``oneshot``
    As ``lp_nlp``, but every window reaches to the end of the program or to the next exact stop, on a mesh with a
    quarter of the knot spacing. It waits for the path up to there. It is the reference for the motion time that
    shorter windows lose.
``thesis``
    The formulation of the dual-windowing thesis, for comparison: a linear program that maximises the integral of q,
    solved by HiGHS; from its result a nonlinear program that maximises the integral of v under control signal and
    tracking error, solved by SQP, or by Ipopt where SQP fails; where both fail, the result of the linear program.
"""

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
"""Knot spacing of the other methods over that of ``oneshot``, whose time is within 0.1 % of that of finer meshes."""


def _lp(machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    return TimeOptimalMethod("lp", "lp", MotionLimits(machine.axis_names, derived_limits(machine)), knot_spacing_mm)


def _lp_nlp(machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    return TimeOptimalMethod("lp_nlp", "nlp", MotionLimits.of(machine), knot_spacing_mm, _safe_limits(machine))


def _oneshot(machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    spacing_mm, safe = knot_spacing_mm / _ONESHOT_REFINEMENT, _safe_limits(machine)
    return TimeOptimalMethod("oneshot", "nlp", MotionLimits.of(machine), spacing_mm, safe, whole_path=True)


def _thesis(machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    # Imported here: no other method needs CasADi, which takes a tenth of a second to import and has no rosdep key.
    from feedopt_core.planner.thesis.method import ThesisMethod
    from feedopt_core.planner.thesis.program import load_casadi

    load_casadi()
    return ThesisMethod(MotionLimits.of(machine), derived_limits(machine), knot_spacing_mm)


def _safe_limits(machine: Machine) -> MotionLimits | None:
    """Kinematic limits under which the drive limits hold in the worst case; None where the machine has no models."""
    derived = derived_limits(machine)
    driven = machine.drive is not None or machine.tracking is not None
    return MotionLimits(machine.axis_names, derived) if driven else None


_FACTORIES: dict[str, MethodFactory] = {"lp": _lp, "lp_nlp": _lp_nlp, "oneshot": _oneshot, "thesis": _thesis}
METHOD_NAMES = tuple(_FACTORIES)


def make_method(name: str, machine: Machine, knot_spacing_mm: float) -> PlanningMethod:
    """Planning method by its name on the command line.

    Raises:
        ConfigError: the name is unknown, or a package that the method needs is not installed.
        InfeasibleLimitsError: the machine's limits leave no motion at all.
    """
    if name not in _FACTORIES:
        raise ConfigError(f"method {name!r} is unknown; there are: {', '.join(METHOD_NAMES)}")
    return _FACTORIES[name](machine, knot_spacing_mm)
