"""The motion returned by every planner of the comparison, and its 1 kHz set points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray

PERIOD_S = 0.001


class PeerError(Exception):
    """A planner found no motion; the message is that of the planner."""


@dataclass(frozen=True)
class PeerMotion:
    """A planned motion from standstill to standstill over the whole path.

    Attributes:
        motion_time_s: its duration.
        compute_time_s: time that the planner needed.
        s_mm: arc length at every tick of 1 ms, shape (n,): from 0 at t = 0 to the end of the path at the first tick at
            or after the end of the motion.
    """

    motion_time_s: float
    compute_time_s: float
    s_mm: FloatArray


def sample_at_ticks(s_at: Callable[[FloatArray], FloatArray], motion_time_s: float, end_mm: float) -> FloatArray:
    """Arc length at the ticks of a motion, shape (n,).

    Args:
        s_at: arc length at times inside (0, motion_time_s), shape (m,) to (m,), mm.
        motion_time_s: duration.
        end_mm: length of the path.
    """
    last = int(np.ceil(motion_time_s / PERIOD_S - 1e-9))
    inside = s_at(np.arange(1, last, dtype=np.float64) * PERIOD_S)
    return np.concatenate([[0.0], np.clip(inside, 0.0, end_mm), [end_mm]])
