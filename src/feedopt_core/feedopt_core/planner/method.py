"""What a planning method is asked for and what it answers: one window of the path, from a state to rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.motion.profile import FeedProfile


@dataclass(frozen=True)
class StartState:
    """State the window continues from.

    Attributes:
        q_mm2_s2: feedrate squared, above zero.
        dq_ds_mm_s2: twice the path acceleration.
    """

    q_mm2_s2: float
    dq_ds_mm_s2: float


@dataclass(frozen=True)
class Window:
    """A part of the path that ends at rest.

    Attributes:
        start_mm, end_mm: arc lengths of its ends.
        start: state at its start; None is rest.
        spare_end: whether the stop at the end is only held in reserve: the next window replaces it unless it fails.
        guess: a profile that starts in the same state and may cover a part of the window (the stop committed before).
    """

    start_mm: float
    end_mm: float
    start: StartState | None = None
    guess: FeedProfile | None = None
    spare_end: bool = False


@dataclass(frozen=True)
class WindowPlan:
    """Profile from the window's start to rest at its end, with the figures of the solver that found it."""

    profile: FeedProfile
    solver: str
    variables: int
    rows: int
    iterations: int


class PlanningMethod(Protocol):
    """A way of planning one window. Implementations hold their limits and settings, never state between windows."""

    @property
    def name(self) -> str:
        """Name on the command line and in every chunk."""

    @property
    def stopping_mm(self) -> float:
        """Distance within which the machine stops from its largest feedrate; window sizes follow from it."""

    @property
    def whole_path(self) -> bool:
        """Whether a window must reach the end of the program or the next exact stop, however far that is."""

    def plan(self, toolpath: Toolpath, window: Window) -> WindowPlan:
        """Plan one window.

        Raises:
            InfeasibleLimitsError: no motion within the limits exists.
            SolverError: the optimiser found none.
        """
