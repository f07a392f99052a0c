"""The modal state of a program."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.programs.gcode.codes import GCode
from feedopt_core.programs.gcode.expressions import Parameters
from feedopt_core.programs.moves import PathMode

MM_PER_INCH = 25.4


class Plane(Enum):
    """Plane of arcs: index of its first axis, second axis and normal, right-handed in this order."""

    XY = (0, 1, 2)
    ZX = (2, 0, 1)
    YZ = (1, 2, 0)


@dataclass
class ModalState:
    """State of the interpreter, as it is at the start of a program.

    Attributes:
        position_mm: current position in machine coordinates, shape (3,).
        offset_mm: added to programmed coordinates (G92), shape (3,).
        stored_offset_mm: what G92.3 brings back, shape (3,).
        motion: G code of the motion; None after G80.
        unit_mm: mm of a unit of the program.
        plane: plane of arcs.
        absolute: G90, else G91.
        absolute_centres: G90.1, else G91.1.
        inverse_time: G93, else G94.
        feed_mm_s: feed, NaN before the first F.
        mode: path mode.
        spline_lead_mm: start direction of a G5 without I and J: the end direction of the G5 before it, shape (2,).
        parameters: numbered and named parameters.
    """

    position_mm: FloatArray = field(default_factory=lambda: np.zeros(3))
    offset_mm: FloatArray = field(default_factory=lambda: np.zeros(3))
    stored_offset_mm: FloatArray = field(default_factory=lambda: np.zeros(3))
    motion: GCode | None = None
    unit_mm: float = 1.0
    plane: Plane = Plane.XY
    absolute: bool = True
    absolute_centres: bool = False
    inverse_time: bool = False
    feed_mm_s: float = math.nan
    mode: PathMode = field(default_factory=PathMode)
    spline_lead_mm: FloatArray = field(default_factory=lambda: np.zeros(2))
    parameters: Parameters = field(default_factory=Parameters)
