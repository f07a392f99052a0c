"""Moves divided into runs at one height and what lies between them, as a stream."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from feedopt_core.arrays import IntArray
from feedopt_core.programs.contours import CurveMove
from feedopt_core.programs.moves import ArcMove, LineMoves, Move, ProgramEvent

_LEVEL_MM = 1e-9
_MOST_POINTS = 200_000


@dataclass(frozen=True)
class LevelRun:
    """Feed moves at one height in a row, without an exact stop."""

    moves: tuple[CurveMove, ...]


@dataclass(frozen=True)
class LinkMoves:
    """Moves that change the height, and rapids.

    Attributes:
        moves: in order.
        points: their number of points.
    """

    moves: tuple[CurveMove, ...]
    points: int


@dataclass(frozen=True)
class PassedMoves:
    """Moves that belong to no layer: events, moves with an exact stop, runs too long to hold."""

    moves: tuple[Move, ...]


def level_runs(moves: Iterator[Move]) -> Iterator[LevelRun | LinkMoves | PassedMoves]:
    """Divide moves; all of them come out again, in order.

    Args:
        moves: of a program.
    """
    run: list[CurveMove] = []
    points, passing = 0, False
    for move in moves:
        for level, part in _parts(move):
            if level and not isinstance(part, ProgramEvent):
                run.append(part)
                points += _point_count(part)
                if passing or points > _MOST_POINTS:
                    yield PassedMoves(tuple(run))
                    run, passing = [], True
                continue
            if run:
                yield LevelRun(tuple(run))
            run, points, passing = [], 0, False
            if isinstance(part, ProgramEvent) or part.mode.exact_stop:
                yield PassedMoves((part,))
            else:
                yield LinkMoves((part,), _point_count(part))
    if run:
        yield LevelRun(tuple(run))


def _parts(move: Move) -> Iterator[tuple[bool, Move]]:
    """Parts of a move, each with whether it belongs to a run at one height."""
    if isinstance(move, ProgramEvent) or move.mode.exact_stop:
        yield False, move
    elif isinstance(move, LineMoves):
        steps = np.abs(np.diff(move.points_mm[:, 2], prepend=move.start_mm[2]))
        level = (steps <= _LEVEL_MM) & (not move.rapid)
        edges = np.flatnonzero(np.diff(level)) + 1
        for indices in np.split(np.arange(len(level)), edges):
            yield bool(level[indices[0]]), some_of(move, indices)
    elif isinstance(move, ArcMove):
        upright = float(np.hypot(move.normal[0], move.normal[1])) <= _LEVEL_MM
        yield upright and abs(move.end_mm[2] - move.start_mm[2]) <= _LEVEL_MM, move
    else:
        yield float(np.ptp(move.control_points_mm[:, 2])) <= _LEVEL_MM, move


def some_of(move: LineMoves, indices: IntArray) -> LineMoves:
    """Neighbouring ones of straight moves in a row."""
    start_mm = move.points_mm[indices[0] - 1] if indices[0] else move.start_mm
    return replace(
        move,
        start_mm=start_mm,
        points_mm=move.points_mm[indices],
        lines=move.lines[indices],
        feed_mm_s=move.feed_mm_s[indices],
    )


def _point_count(move: CurveMove) -> int:
    return len(move.points_mm) if isinstance(move, LineMoves) else 1
