"""Interface of the planning methods: a window of the path as input, its plan as output."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.motion.profile import FeedProfile


@dataclass(frozen=True)
class StartState:
    """State in which a window starts in motion.

    Attributes:
        q_mm2_s2: feedrate squared, above zero.
        dq_ds_mm_s2: twice the path acceleration.
    """

    q_mm2_s2: float
    dq_ds_mm_s2: float


@dataclass(frozen=True)
class Window:
    """A part of the path that ends at standstill.

    Attributes:
        start_mm, end_mm: arc lengths of its ends.
        start: state at its start; None for standstill.
        spare_end: whether the stop at the end is only held in reserve: the next window replaces it unless that fails.
        guess: a profile that starts in the same state and may cover only a part of the window: the stop that the last
            chunk holds in reserve.
    """

    start_mm: float
    end_mm: float
    start: StartState | None = None
    guess: FeedProfile | None = None
    spare_end: bool = False


@dataclass(frozen=True)
class WindowPlan:
    """Feed profile from the start of the window to standstill at its end, with the figures of its solver."""

    profile: FeedProfile
    solver: str
    variables: int
    rows: int
    iterations: int


class PlanningMethod(Protocol):
    """A method of planning one window. Implementations hold limits and settings, but no state between windows."""

    @property
    def name(self) -> str:
        """Name on the command line and in every chunk."""

    @property
    def stopping_mm(self) -> float:
        """Distance in which the machine stops from its largest feedrate, mm; window lengths follow from it."""

    @property
    def whole_path(self) -> bool:
        """Whether a window must reach the end of the program or the next exact stop, however far that is."""

    def plan(self, toolpath: Toolpath, window: Window) -> WindowPlan:
        """Plan one window.

        Raises:
            InfeasibleLimitsError: no motion within the limits exists.
            SolverError: the optimiser found no motion within the limits.
        """
