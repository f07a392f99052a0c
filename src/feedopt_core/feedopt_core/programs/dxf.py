"""DXF drawings: lines, polylines with bulges, arcs, circles, ellipses and splines of the model space."""

from __future__ import annotations

import io
import math
import struct
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from ezdxf.document import Drawing
from ezdxf.filemanagement import read, readfile
from ezdxf.lldxf.const import DXFError
from ezdxf.math import BSpline, rational_bspline_from_ellipse

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.clamped_knots import clamp_knots
from feedopt_core.programs.contours import (
    Contour,
    CurveMove,
    concatenated,
    join_contours,
    move_ends,
    order_by_nearest_end,
    reversed_contour,
)
from feedopt_core.programs.moves import ArcMove, LineMoves, NurbsMove
from feedopt_core.programs.nurbs_json import HIGHEST_DEGREE, LARGEST_COORDINATE_MM, check_knots, check_weights

JOIN_MM = 1e-3
"""Ends of entities closer than this meet; drawings round their coordinates."""
_UNITS_MM = {0: 1.0, 1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 8: 25.4e-6, 9: 25.4e-3, 13: 1e-3, 14: 100.0}
_LEAST_SIZE_MM = 1e-6
_FITTED = 2 | 4
_BROKEN = (
    DXFError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, AssertionError, RuntimeError,
    StopIteration, EOFError, struct.error,
)  # fmt: skip


def read_dxf(program: str | Path, source: str, feed_mm_s: float = math.inf) -> Iterator[CurveMove]:
    """Moves of a drawing: its contours layer by layer, within a layer by nearest end, rapids between them.

    Entities are joined where their ends meet. The unit is the drawing's $INSUNITS; a drawing without one is in mm.
    Layers come in the order of the layer table. Entities that are invisible, or on layers that are off or frozen, are
    left out.
    The line of a move is the number of its entity within the model space, from 1.

    Args:
        program: text of the drawing, or its file.
        source: its name, for errors.
        feed_mm_s: feed of all moves, above zero, since a drawing has no feed. Infinity: only the machine's limits hold.

    Raises:
        ToolpathError: the drawing cannot be read, is empty, or holds an entity that is not supported or has no size;
            names the entity's type and handle.
    """
    try:
        drawing = _open(program)
        # Coordinates that overflow are refused by name, after the arithmetic.
        with np.errstate(over="ignore", invalid="ignore"):
            layers = _contours_by_layer(drawing, _scale_mm(drawing), feed_mm_s)
    except ToolpathError as error:
        raise ToolpathError(error.message, source=source) from error
    except OSError as error:
        raise ToolpathError(f"cannot be read: {error.strerror or error}", source=source) from error
    except _BROKEN as error:
        raise ToolpathError(f"is not a DXF drawing that can be read: {error}", source=source) from error
    if not layers:
        raise ToolpathError("holds nothing to follow on its visible layers", source=source)
    here_mm, first = np.zeros(3), True
    for pieces in layers:
        for contour in order_by_nearest_end(join_contours(pieces, JOIN_MM), here_mm):
            if not first and np.any(contour.start_mm != here_mm):
                line = _line_of(contour.moves[0])
                yield LineMoves(here_mm, contour.start_mm[None, :], np.array([line]), np.array([math.inf]), rapid=True)
            yield from contour.moves
            here_mm, first = contour.end_mm, False


def _open(program: str | Path) -> Drawing:
    return readfile(program) if isinstance(program, Path) else read(io.StringIO(program))


def _scale_mm(drawing: Drawing) -> float:
    unit = int(drawing.header.get("$INSUNITS", 0))
    if unit not in _UNITS_MM:
        raise ToolpathError(f"is drawn in unit {unit} ($INSUNITS), which is not supported; save it in mm or inches")
    return _UNITS_MM[unit]


def _contours_by_layer(drawing: Drawing, scale_mm: float, feed_mm_s: float) -> list[list[Contour]]:
    """Pieces of every visible layer that has any, in the order of the layer table."""
    hidden = {layer.dxf.name.lower() for layer in drawing.layers if layer.is_off() or layer.is_frozen()}
    order = {layer.dxf.name.lower(): index for index, layer in enumerate(drawing.layers)}
    found = defaultdict[str, list[Contour]](list)
    for number, entity in enumerate(drawing.modelspace(), start=1):
        layer = str(entity.dxf.get("layer", "0")).lower()
        if layer in hidden or entity.dxf.get("invisible", 0):
            continue
        name = f"{entity.dxftype()} #{entity.dxf.handle}"
        converter = _CONVERTERS.get(entity.dxftype())
        if converter is None:
            raise ToolpathError(
                f"{name} on layer {layer!r} is not supported; there are: {', '.join(_CONVERTERS)}. "
                "Convert it, or freeze its layer"
            )
        try:
            moves = converter(entity, scale_mm, number, feed_mm_s)
            _check_moves(moves)
        except ToolpathError as error:
            raise ToolpathError(f"{name}: {error.message}") from error
        except _BROKEN as error:
            raise ToolpathError(f"{name} cannot be read: {error}") from error
        if moves:
            found[layer].append(Contour(tuple(moves)))
    return [found[layer] for layer in sorted(found, key=lambda name: (order.get(name, len(order)), name))]


def _check_moves(moves: list[CurveMove]) -> None:
    for move in moves:
        values = [*move_ends(move)]
        values += [move.center_mm] if isinstance(move, ArcMove) else []
        values += [move.control_points_mm] if isinstance(move, NurbsMove) else []
        values += [move.points_mm] if isinstance(move, LineMoves) else []
        if not all(np.all(np.abs(value) <= LARGEST_COORDINATE_MM) for value in values):
            raise ToolpathError(f"reaches further than {LARGEST_COORDINATE_MM:g} mm from the origin")


def _line_of(move: CurveMove) -> int:
    return int(move.lines[0]) if isinstance(move, LineMoves) else move.line


def _straight(points_mm: FloatArray, number: int, feed_mm_s: float) -> list[CurveMove]:
    """Straight moves through points, shape (n, 3); repeated points are left out."""
    steps = np.linalg.norm(np.diff(points_mm, axis=0), axis=1)
    points_mm = points_mm[np.append(True, ~(steps <= _LEAST_SIZE_MM))]
    count = len(points_mm) - 1
    if not count:
        return []
    return [LineMoves(points_mm[0], points_mm[1:], np.full(count, number), np.full(count, feed_mm_s))]


def _line(entity: Any, scale_mm: float, number: int, feed_mm_s: float) -> list[CurveMove]:
    return _straight(scale_mm * np.array([entity.dxf.start.xyz, entity.dxf.end.xyz]), number, feed_mm_s)


def _arc(entity: Any, scale_mm: float, number: int, feed_mm_s: float) -> list[CurveMove]:
    """ARC or CIRCLE, anticlockwise about its extrusion."""
    axes = entity.ocs()
    radius_mm = scale_mm * float(entity.dxf.radius)
    if not radius_mm > _LEAST_SIZE_MM:
        raise ToolpathError(f"has a radius of {radius_mm:g} mm")
    center_mm = scale_mm * np.array(axes.to_wcs(entity.dxf.center).xyz)
    x, y, normal = (np.array(axes.to_wcs(unit).xyz) for unit in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    whole = entity.dxftype() == "CIRCLE"
    first, last = (0.0, 0.0) if whole else (math.radians(entity.dxf.start_angle), math.radians(entity.dxf.end_angle))
    sweep_rad = (last - first) % (2.0 * math.pi) or 2.0 * math.pi
    if radius_mm * sweep_rad <= _LEAST_SIZE_MM:
        return []
    start_mm, end_mm = (
        center_mm + radius_mm * (math.cos(angle) * x + math.sin(angle) * y) for angle in (first, first + sweep_rad)
    )
    end_mm = start_mm if whole else end_mm
    return [ArcMove(start_mm, end_mm, center_mm, normal, sweep_rad, 0.0, number, feed_mm_s)]


def _polyline(entity: Any, scale_mm: float, number: int, feed_mm_s: float) -> list[CurveMove]:
    """LWPOLYLINE or POLYLINE, 2-D with bulges or 3-D, in the direction of its vertices."""
    if entity.dxftype() == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline):
        raise ToolpathError("is a mesh, not a path; convert it to curves")
    if entity.dxftype() == "POLYLINE" and entity.dxf.flags & _FITTED:
        raise ToolpathError("is a fitted polyline; convert it to a spline or to lines")
    moves: list[CurveMove] = []
    vertices = entity.vertices_in_wcs() if entity.dxftype() == "LWPOLYLINE" else entity.points_in_wcs()
    if (first := next(iter(vertices), None)) is None:
        return []
    here_mm = scale_mm * np.array(first.xyz)
    for part in entity.virtual_entities():
        converted = _CONVERTERS[part.dxftype()](part, scale_mm, number, feed_mm_s)
        if converted:
            # Arcs of drawings turn anticlockwise, whichever way the polyline goes.
            contour = Contour(tuple(converted))
            backwards = np.linalg.norm(contour.end_mm - here_mm) < np.linalg.norm(contour.start_mm - here_mm)
            moves += (reversed_contour(contour) if backwards else contour).moves
            here_mm = move_ends(moves[-1])[1]
    return list(concatenated([Contour((move,)) for move in moves], _LEAST_SIZE_MM).moves) if moves else []


def _ellipse(entity: Any, scale_mm: float, number: int, feed_mm_s: float) -> list[CurveMove]:
    """Exact rational quadratic B-spline."""
    ellipse = entity.construction_tool()
    if not scale_mm * ellipse.minor_axis.magnitude > _LEAST_SIZE_MM:
        raise ToolpathError("has an axis without length")
    return _nurbs(rational_bspline_from_ellipse(ellipse, segments=4), scale_mm, number, feed_mm_s)


def _spline(entity: Any, scale_mm: float, number: int, feed_mm_s: float) -> list[CurveMove]:
    if entity.dxf.degree > HIGHEST_DEGREE:
        raise ToolpathError(f"is of degree {entity.dxf.degree}; {HIGHEST_DEGREE} is the highest that is read")
    return _nurbs(entity.construction_tool(), scale_mm, number, feed_mm_s)


def _nurbs(spline: BSpline, scale_mm: float, number: int, feed_mm_s: float) -> list[CurveMove]:
    control_mm = scale_mm * np.array([point.xyz for point in spline.control_points])
    weights = np.array(spline.weights(), dtype=float) if spline.is_rational else np.ones(len(control_mm))
    check_weights(weights)
    knots, control_mm, weights = clamp_knots(spline.degree, np.array(spline.knots()), control_mm, weights)
    check_knots(knots, spline.degree)
    if spline.degree == 1:
        return _straight(control_mm, number, feed_mm_s)
    if np.all(np.ptp(control_mm, axis=0) <= _LEAST_SIZE_MM):
        raise ToolpathError("has no length")
    return [NurbsMove(spline.degree, knots, control_mm, weights, number, feed_mm_s)]


_CONVERTERS: dict[str, Callable[[Any, float, int, float], list[CurveMove]]] = {
    "LINE": _line,
    "ARC": _arc,
    "CIRCLE": _arc,
    "LWPOLYLINE": _polyline,
    "POLYLINE": _polyline,
    "ELLIPSE": _ellipse,
    "SPLINE": _spline,
}
