"""The programmed path before smoothing, read from the program text in the bag."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.pipeline.read_program import Program, ProgramKind, read_moves
from feedopt_core.programs.moves import ArcMove, LineMoves, Move, NurbsMove
from feedopt_core.programs.points_csv import read_points
from feedopt_recorder.bags.run_data import RunData

_ARC_STEP_RAD = 0.05
_NURBS_POINTS = 200


@dataclass(frozen=True)
class ProgrammedPath:
    """Programmed path as strips of points, shape (n, 3) each; ``rapid`` says which are rapids.

    ``remark`` says why it is not there, or how much of it is missing; else empty.
    """

    strips: tuple[FloatArray, ...]
    rapid: tuple[bool, ...]
    remark: str


def programmed_path(run: RunData) -> ProgrammedPath:
    """Programmed path of a run; without strips and with a remark if the text is missing or cannot be read."""
    program = run.provenance.get("feedopt/program", {})
    text, name = program.get("text", ""), program.get("name", "")
    if not text:
        return ProgrammedPath((), (), "the bag does not hold the program's text")
    try:
        read = Program.from_text(text)
        if read.kind is not ProgramKind.POINTS:
            return path_of_moves(read_moves(read, name))
        points_mm = read_points(io.StringIO(text), name).points_mm
        return ProgrammedPath((np.pad(points_mm, ((0, 0), (0, 3 - points_mm.shape[1]))),), (False,), "")
    except ToolpathError as error:
        return ProgrammedPath((), (), f"the program cannot be drawn: {error}")


def path_of_moves(moves: Iterable[Move]) -> ProgrammedPath:
    """Points along moves; arcs and curves are sampled finely enough for drawing. Raises ToolpathError of the reader."""
    strips, rapid = list[FloatArray](), list[bool]()
    for move in moves:
        if isinstance(move, LineMoves):
            strips.append(np.vstack([move.start_mm, move.points_mm]))
            rapid.append(move.rapid)
        elif isinstance(move, ArcMove):
            strips.append(arc_points(move, _ARC_STEP_RAD))
            rapid.append(False)
        elif isinstance(move, NurbsMove):
            strips.append(curve_points(move, _NURBS_POINTS))
            rapid.append(False)
    return ProgrammedPath(tuple(strips), tuple(rapid), "")


def arc_points(move: ArcMove, step_rad: float) -> FloatArray:
    """Points of an arc or helix, its ends included, at most an angle apart, shape (n, 3)."""
    angle = np.linspace(0.0, move.sweep_rad, 2 + int(move.sweep_rad / step_rad))[:, None]
    radius = move.start_mm - move.center_mm
    turned = radius * np.cos(angle) + np.cross(move.normal, radius) * np.sin(angle)
    return np.asarray(move.center_mm + turned + move.normal * move.rise_mm * angle / move.sweep_rad)


def curve_points(move: NurbsMove, count: int) -> FloatArray:
    """Points of a curve at equal steps of its parameter, its ends included, shape (count, 3)."""
    homogeneous = np.column_stack([move.control_points_mm * move.weights[:, None], move.weights])
    values = BSpline(move.knots, homogeneous, move.degree)(np.linspace(move.knots[0], move.knots[-1], count))
    return np.asarray(values[:, :3] / values[:, 3:])
