"""The cases of the planner benchmark, section by section. Each yields rows as they are measured."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from benchmark.planner.contours import hand_like, long_smooth, serpentine
from benchmark.planner.measuring import Measured, measure, plan_segments, resident_mb, window_share
from benchmark.programs.catalogue import MACHINES, all_programs

from feedopt_core.config_files import find_config
from feedopt_core.errors import FeedoptError
from feedopt_core.geometry.segments import Segment
from feedopt_core.machine.machine_file import Machine, load_machine
from feedopt_core.motion.chunk import Chunk
from feedopt_core.pipeline.read_program import open_program, read_program
from feedopt_core.pipeline.survey import survey_program
from feedopt_core.planner.stream_planner import PlannerParameters

_MESH_CONVERGED = 1e-3
_THESIS_SPACING_MM = 0.5
_FINEST_MM = 0.03
_SCALE_M = (1.0, 10.0, 100.0, 250.0, 500.0, 750.0, 1000.0)


@dataclass(frozen=True)
class Failed:
    """A method that found no plan, with the cause."""

    case: str
    method: str
    setting: str
    cause: str


@dataclass(frozen=True)
class Scaled:
    """Figures of a stream up to a length: computing time including that of the segments, memory, worst window."""

    length_m: float
    motion_s: float
    compute_s: float
    resident_mb: float
    window_share: float
    fallbacks: int


Row = Measured | Failed | Scaled


def fan() -> list[Segment]:
    """Segments of the fan contour."""
    program = find_config("programs", "fan_contour", ".csv")
    return list(read_program(open_program(program), program.name, dimensions=2))


def kinematic(runs: int) -> Iterator[Row]:
    """The fan contour with axis limits only."""
    segments = fan()
    for case in ("case_a", "case_b"):
        for method in ("lp", "lp_nlp"):
            yield _attempt(case, segments, load_machine(case), PlannerParameters(method=method), runs)


def drives(runs: int) -> Iterator[Row]:
    """Control signal and tracking error: every method, and the mesh-converged optimum of the whole path."""
    segments, limited = fan(), table_3_1()
    for machine in (limited, without_velocity_limit(limited)):
        case = f"fan, {'v 150' if machine is limited else 'v free'}, u 10 V, e 0.02 mm"
        for method in ("lp", "lp_nlp"):
            yield _attempt(case, segments, machine, PlannerParameters(method=method), runs)
        yield from _converged(case, segments, machine)
    thesis = PlannerParameters(method="thesis", knot_spacing_mm=_THESIS_SPACING_MM)
    yield _attempt("fan, v 150, u 10 V, e 0.02 mm", segments, limited, thesis, 1)
    hand = hand_like()
    for method in ("lp", "lp_nlp"):
        yield _attempt("hand-like (own drawing)", hand, limited, PlannerParameters(method=method), runs)
    yield _attempt("hand-like (own drawing)", hand, limited, thesis, 1)


def table_3_1() -> Machine:
    """Machine of the thesis' simulation study: velocity, control signal and full tracking error, no jerk limit."""
    machine = load_machine("router_simulation")
    free = (float("inf"),) * len(machine.axis_names)
    return replace(machine, name="table_3_1", jerk_limit_mm_s3=free, tracking_error_reserve_mm=None)


def without_velocity_limit(machine: Machine) -> Machine:
    """The machine without its velocity limits, except the velocity that the control signal can sustain."""
    return replace(machine, velocity_limit_mm_s=(float("inf"),) * len(machine.axis_names), feed_limit_mm_s=1e4)


def _converged(case: str, segments: list[Segment], machine: Machine) -> Iterator[Row]:
    """The whole path in one window; the knot spacing is halved until the time changes by less than 0.1 %."""
    spacing_mm, before_s = 2.0 * PlannerParameters().knot_spacing_mm, float("inf")
    while spacing_mm > _FINEST_MM:
        spacing_mm /= 2.0
        row = _attempt(case, segments, machine, PlannerParameters(method="oneshot", knot_spacing_mm=spacing_mm), 1)
        yield row
        if not isinstance(row, Measured) or abs(row.motion_s / before_s - 1.0) < _MESH_CONVERGED:
            return
        before_s = row.motion_s


def windows(runs: int) -> Iterator[Row]:
    """Several windows against one window for the whole path or up to the next exact stop, on the same mesh."""
    for name, segments, machine in _every_path():
        case, whole = f"{name}, {machine.name}", PlannerParameters(commitment_mm=1e6)
        for setting, parameters in (("windows", PlannerParameters()), ("whole path", whole)):
            row = _attempt(case, segments, machine, parameters, runs)
            yield replace(row, setting=f"{setting}, {row.setting}") if isinstance(row, Measured) else row


def _every_path() -> Iterator[tuple[str, list[Segment], Machine]]:
    """Name, segments and machine of every path; ``bench programs`` reports programs that cannot be read."""
    paths: tuple[tuple[str, Callable[[], list[Segment]]], ...] = (
        ("fan", fan),
        ("hand-like", hand_like),
        ("long, 2 m", lambda: long_smooth(2_000.0)),
        ("serpentine, 2 m", lambda: list(serpentine(2_000.0))),
    )
    for name, make in paths:
        segments = make()
        yield name, segments, table_3_1()
        yield name, segments, load_machine("case_a")
    with tempfile.TemporaryDirectory(prefix="feedopt-planner-") as folder:
        for name, path in all_programs(Path(folder)):
            try:
                survey = survey_program(path)
            except FeedoptError:
                continue
            yield name, list(survey.segments), load_machine(MACHINES[survey.dimensions])


def speed(runs: int) -> Iterator[Row]:
    """18.5 m with about 4,000 control points, as large as the thesis' largest case; the path is our own."""
    segments, machine = long_smooth(), without_velocity_limit(table_3_1())
    for method in ("lp", "lp_nlp"):
        parameters = PlannerParameters(method=method, knot_spacing_mm=18_500.0 / 4_000.0, commitment_mm=1e6)
        yield _attempt("18.5 m (own drawing), whole path", segments, machine, parameters, runs)
        yield _attempt("18.5 m (own drawing)", segments, machine, replace(parameters, commitment_mm=0.0), runs)


def scale(runs: int) -> Iterator[Row]:
    """One stream of a kilometre, measured at several lengths: time must grow linearly, memory must not grow."""
    marks_mm = [1e3 * length_m for length_m in _SCALE_M]
    rows: list[Scaled] = []
    worst_share, fallbacks, began_s = 0.0, 0, time.process_time()

    def take(chunk: Chunk, window_s: float) -> None:
        nonlocal worst_share, fallbacks
        worst_share = max(worst_share, window_share(chunk, window_s))
        fallbacks += chunk.figures.fallback
        if chunk.s_commit_mm >= marks_mm[0] or chunk.last:
            spent_s = time.process_time() - began_s
            rows.append(Scaled(marks_mm.pop(0) / 1e3, chunk.t_commit_s, spent_s, resident_mb(), worst_share, fallbacks))

    plan_segments(serpentine(marks_mm[-1]), load_machine("router_simulation"), PlannerParameters(), take)
    yield from rows


def _attempt(
    case: str, segments: list[Segment], machine: Machine, parameters: PlannerParameters, runs: int
) -> Measured | Failed:
    setting = f"{parameters.knot_spacing_mm:g} mm"
    try:
        return measure(case, setting, segments, machine, parameters, runs=runs)
    except FeedoptError as error:
        return Failed(case, parameters.method, setting, str(error))


SECTIONS: dict[str, Callable[[int], Iterator[Row]]] = {
    "kinematic": kinematic,
    "drives": drives,
    "windows": windows,
    "speed": speed,
    "scale": scale,
}
