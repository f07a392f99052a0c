"""What every reader makes of a program: moves in order, in millimetres and seconds, free of the program's language.

Readers yield moves as they read; smoothing turns them into segments. Positions always have three coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

from feedopt_core.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class PathMode:
    """How the path may be left between its programmed points.

    Attributes:
        exact_stop: the machine comes to rest at the end of each move.
        tolerance_mm: largest distance of the smoothed from the programmed path; None: the one of the run.
        naive_cam_mm: neighbouring straight moves that stay this close to one line are one move; 0: off.
    """

    exact_stop: bool = False
    tolerance_mm: float | None = None
    naive_cam_mm: float = 0.0


@dataclass(frozen=True)
class LineMoves:
    """Straight moves in a row, each from where the one before ended.

    Attributes:
        start_mm: where the first one starts, shape (3,).
        points_mm: end of each, shape (n, 3).
        lines: line of the program of each, from 1, shape (n,).
        feed_mm_s: programmed feed of each, shape (n,); infinity for rapids.
        rapid: rapids (G0) or feed moves, all of them.
        mode: path mode of all of them.
    """

    start_mm: FloatArray
    points_mm: FloatArray
    lines: IntArray
    feed_mm_s: FloatArray
    rapid: bool = False
    mode: PathMode = PathMode()


@dataclass(frozen=True)
class ArcMove:
    """Circular arc or helix.

    With angle t from 0 to ``sweep_rad``: ``center + (start - center) cos t + (normal x (start - center)) sin t
    + normal rise t / sweep``, where ``start - center`` is perpendicular to the normal.

    Attributes:
        start_mm, end_mm: its ends, shape (3,).
        center_mm: centre of the circle in the plane of the start, shape (3,).
        normal: unit vector the arc turns around by the right-hand rule, shape (3,).
        sweep_rad: angle turned, above zero; more than 2 pi for several turns.
        rise_mm: advance along the normal over the whole arc.
        line: line of the program.
        feed_mm_s: programmed feed.
        mode: path mode.
    """

    start_mm: FloatArray
    end_mm: FloatArray
    center_mm: FloatArray
    normal: FloatArray
    sweep_rad: float
    rise_mm: float
    line: int
    feed_mm_s: float
    mode: PathMode = PathMode()


@dataclass(frozen=True)
class NurbsMove:
    """NURBS curve; it starts at its first control point, where the move before ended.

    Attributes:
        degree: polynomial degree, at least 1.
        knots: shape (n + degree + 1,), clamped at both ends.
        control_points_mm: shape (n, 3).
        weights: shape (n,), above zero.
        line: line of the program.
        feed_mm_s: programmed feed.
        mode: path mode.
    """

    degree: int
    knots: FloatArray
    control_points_mm: FloatArray
    weights: FloatArray
    line: int
    feed_mm_s: float
    mode: PathMode = PathMode()


@dataclass(frozen=True)
class ProgramEvent:
    """Something that happens at a place on the path and is no motion: spindle, coolant, tool change, pause, dwell.

    Attributes:
        text: the words of the program, such as ``M3 S12000``.
        line: line of the program.
        stop: the machine comes to rest here first.
        dwell_s: time it then waits.
        end: the program ends here.
    """

    text: str
    line: int
    stop: bool = False
    dwell_s: float = 0.0
    end: bool = False


Move = LineMoves | ArcMove | NurbsMove | ProgramEvent
