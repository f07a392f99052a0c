"""Transitions between layers of closed contours: motion time with the same limits, planner and audit.

Run: ``./feedopt bench transitions [--layers N] [--step MM] [--reach MM] [--machine NAME] [--method NAME]``. Each
program is smoothed, planned and audited as any other. The layer transitions of Euler spirals are compared with common
programs: circular lead-out and lead-in within the layers, with the step down between them, and a plunge on the contour
itself. The benchmark reports figures, without pass or fail.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.table import Table

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.fine_grid import audit_profile
from feedopt_core.audit.setpoints import audit_setpoints
from feedopt_core.config_files import find_config
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine, load_machine
from feedopt_core.motion.certificate import merge
from feedopt_core.pipeline.plan_program import interpolate
from feedopt_core.planner.stream_planner import PlannerParameters, StreamPlanner
from feedopt_core.programs.contours import CurveMove, move_ends
from feedopt_core.programs.layers.transitions import TransitionSide, with_layer_transitions
from feedopt_core.programs.moves import ArcMove, LineMoves, Move, NurbsMove
from feedopt_core.programs.points_csv import read_points
from feedopt_core.smoothing.cubic_spline import DEFAULT_TOLERANCE_MM, interpolate_points
from feedopt_core.smoothing.stage import smooth

UP = np.array([0.0, 0.0, 1.0])
WAYS = ("laps in one plane", "plunge on the contour", "quarter arcs", "half circles", "Euler spirals")


@dataclass(frozen=True)
class TransitionRow:
    """One kind of transition between layers on one contour.

    Attributes:
        contour, way: names of the contour and of the transition.
        length_mm: length of the whole path.
        motion_time_s: time from standstill to standstill.
        worst_ratio: largest ratio to a limit, on the fine grid and at the set points.
        fallbacks: windows without a plan, which end in the stop of the previous window.
    """

    contour: str
    way: str
    length_mm: float
    motion_time_s: float
    worst_ratio: float
    fallbacks: int


def main(argv: list[str]) -> int:
    """Command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="feedopt bench transitions", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--layers", type=int, default=5, help="contours on top of each other")
    parser.add_argument("--step", type=float, default=1.0, metavar="MM", help="distance of the layers, mm")
    parser.add_argument("--reach", type=float, default=10.0, metavar="MM", help="largest distance from the contour, mm")
    parser.add_argument("--machine", default="router_heng", help="machine file with a z axis, or its name")
    parser.add_argument("--method", default="lp", help="planning method")
    arguments = parser.parse_args(argv)
    if arguments.layers < 2 or not (arguments.step > 0.0 and arguments.reach > 0.0):
        parser.error("needs two layers or more, and --step and --reach above zero")
    machine = load_machine(arguments.machine)
    progress = Console(stderr=True)
    rows = []
    for (contour, moves), way in itertools.product(contours().items(), WAYS):
        progress.print(f"{contour}: {way}", highlight=False)
        program = stacked(moves, way, arguments.layers, arguments.step, arguments.reach)
        rows.append(plan_moves(contour, way, program, machine, arguments.method))
    out = Console(width=None if sys.stdout.isatty() else 130)
    out.print(table_of(rows, arguments.layers - 1))
    out.print(
        f"{arguments.layers} layers {arguments.step:g} mm apart, at most {arguments.reach:g} mm beside the contour, "
        f"{machine.name}, {arguments.method}, tolerance {DEFAULT_TOLERANCE_MM:g} mm"
    )
    if any(row.fallbacks for row in rows):
        out.print("a fall-back is a stop because a window had no plan: such a row is slower than the limits allow")
    return 0


def contours() -> dict[str, list[CurveMove]]:
    """Closed contours at z = 0, anticlockwise."""
    return {"rounded rectangle, 80 x 50 mm": _rounded_rectangle(80.0, 50.0, 12.0), "fan contour, spline": _fan()}


def stacked(contour: Sequence[CurveMove], way: str, layers: int, step_mm: float, reach_mm: float) -> list[Move]:
    """Program of the contour, layer by layer, with one of the WAYS between layers.

    The radius of quarter arcs is the reach, that of half circles half of the reach, so all have the same reach.
    """
    start_mm, (tangent, normal) = move_ends(contour[0])[0], _frame(contour[0])
    down = -step_mm * UP
    program: list[Move] = []
    for layer in range(layers):
        at = layer * down
        if layer and way == "quarter arcs":
            corner = reach_mm * normal
            out_mm, in_mm = (start_mm + corner + sign * reach_mm * tangent for sign in (1.0, -1.0))
            program.append(_arc(start_mm, out_mm, start_mm + corner, math.pi / 2.0, at - down))
            program.append(_line(out_mm + at - down, in_mm + at))
            program.append(_arc(in_mm, start_mm, start_mm + corner, math.pi / 2.0, at))
        elif layer and way == "half circles":
            top_mm, center_mm = start_mm + reach_mm * normal, start_mm + 0.5 * reach_mm * normal
            program.append(_arc(start_mm, top_mm, center_mm, math.pi, at - down))
            program.append(_line(top_mm + at - down, top_mm + at))
            program.append(_arc(top_mm, start_mm, center_mm, math.pi, at))
        elif layer and way != "laps in one plane":
            program.append(_line(start_mm + at - down, start_mm + at))
        program += [_moved(move, at if way != "laps in one plane" else 0.0 * UP) for move in contour]
    if way == "Euler spirals":
        return list(with_layer_transitions(iter(program), reach_mm, TransitionSide.OUTSIDE))
    return program


def plan_moves(contour: str, way: str, moves: Iterable[Move], machine: Machine, method: str) -> TransitionRow:
    """Smooth, plan and audit one program. Raises what the planner raises."""
    planner, toolpath, chunks = StreamPlanner(machine, PlannerParameters(method=method)), Toolpath(), []
    for segment in smooth(iter(moves), DEFAULT_TOLERANCE_MM, machine.dimensions):
        toolpath.append(segment)
        planner.add_segment(segment)
        while (chunk := planner.next_chunk()) is not None:
            chunks.append(chunk)
    setpoints = interpolate(toolpath, chunks, machine)
    fine = [audit_profile(toolpath, chunk.profile, machine, chunk.t_start_s) for chunk in chunks]
    period_s = machine.period_s
    audit = merge([*fine, audit_setpoints(setpoints.position_mm, setpoints.s_mm, period_s, machine)])
    fallbacks = sum(chunk.figures.fallback for chunk in chunks)
    return TransitionRow(contour, way, toolpath.end_mm, planner.committed_t_s, audit.worst.ratio, fallbacks)


def table_of(rows: Sequence[TransitionRow], transitions: int) -> Table:
    """The figures as a table; the added time of a transition is relative to laps in one plane."""
    columns = ("path, mm", "motion, s", "a transition adds, s", "fall-backs", "worst ratio")
    table = Table("contour", "transition", *columns)
    laps: dict[str, float] = {row.contour: row.motion_time_s for row in rows if row.way == WAYS[0]}
    for row in rows:
        added_s = (row.motion_time_s - laps[row.contour]) / transitions
        table.add_row(
            row.contour,
            row.way,
            f"{row.length_mm:.1f}",
            f"{row.motion_time_s:.3f}",
            "-" if row.way == WAYS[0] else f"{added_s:.3f}",
            str(row.fallbacks),
            f"{row.worst_ratio:.4f}",
        )
    return table


def _frame(move: CurveMove) -> tuple[FloatArray, FloatArray]:
    """Tangent at the start of a contour and normal to its right, which points outwards for an anticlockwise contour."""
    if isinstance(move, LineMoves):
        way = move.points_mm[0] - move.start_mm
    elif isinstance(move, NurbsMove):
        way = move.control_points_mm[1] - move.control_points_mm[0]
    else:
        way = np.cross(move.normal, move.start_mm - move.center_mm)
    tangent = way / np.linalg.norm(way)
    return tangent, np.cross(tangent, UP)


def _line(start_mm: FloatArray, end_mm: FloatArray) -> LineMoves:
    return LineMoves(start_mm, end_mm[None, :], np.ones(1, dtype=np.int64), np.array([math.inf]))


def _arc(start_mm: FloatArray, end_mm: FloatArray, center_mm: FloatArray, sweep_rad: float, at: FloatArray) -> ArcMove:
    """Clockwise arc, translated by ``at``."""
    return ArcMove(start_mm + at, end_mm + at, center_mm + at, -UP, sweep_rad, 0.0, 1, math.inf)


def _moved(move: CurveMove, by_mm: FloatArray) -> CurveMove:
    if isinstance(move, LineMoves):
        return replace(move, start_mm=move.start_mm + by_mm, points_mm=move.points_mm + by_mm)
    if isinstance(move, NurbsMove):
        return replace(move, control_points_mm=move.control_points_mm + by_mm)
    return replace(move, start_mm=move.start_mm + by_mm, end_mm=move.end_mm + by_mm, center_mm=move.center_mm + by_mm)


def _rounded_rectangle(width_mm: float, height_mm: float, radius_mm: float) -> list[CurveMove]:
    """Rounded rectangle that starts in the middle of the lower side."""
    x, y = 0.5 * width_mm, 0.5 * height_mm
    here_mm, moves = np.array([0.0, -y, 0.0]), list[CurveMove]()
    for corner, way in (((x, -y), (1, 0)), ((x, y), (0, 1)), ((-x, y), (-1, 0)), ((-x, -y), (0, -1))):
        along, inwards = np.array([*way, 0.0]), np.array([-way[1], way[0], 0.0])
        before_mm = np.array([*corner, 0.0]) - radius_mm * along
        center_mm = before_mm + radius_mm * inwards
        after_mm = center_mm + radius_mm * along
        moves.append(_line(here_mm, before_mm))
        moves.append(ArcMove(before_mm, after_mm, center_mm, UP, math.pi / 2.0, 0.0, 1, math.inf))
        here_mm = after_mm
    return [*moves, _line(here_mm, np.array([0.0, -y, 0.0]))]


def _fan() -> list[CurveMove]:
    """The closed cubic spline through the points of the fan contour, from the outermost point of a blade."""
    file = find_config("programs", "fan_contour", ".csv")
    points = read_points(file.read_text(encoding="utf-8").splitlines(), file.name).points_mm[:-1]
    first = int(np.argmin(points[:, 1]))
    around = np.roll(points, -first, axis=0)
    closed = np.pad(np.concatenate([around, around[:1]]), ((0, 0), (0, 1)))
    moves = list[CurveMove]()
    for segment in interpolate_points(closed, list(range(len(closed)))):
        curve = segment.curve
        moves.append(NurbsMove(curve.degree, curve.knots, curve.control_points_mm, curve.weights, 1, math.inf))
    return moves


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
