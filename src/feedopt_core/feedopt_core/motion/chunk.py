"""A chunk of the feed profile: committed part, stop in reserve, certificate and solver figures."""

from __future__ import annotations

from dataclasses import dataclass

from feedopt_core.motion.certificate import Certificate
from feedopt_core.motion.profile import FeedProfile


@dataclass(frozen=True)
class SolverFigures:
    """Size and effort of one window's plan; ``solver`` names the solver that found it.

    ``fallback``: no plan was found for the whole window, so the chunk ends in a stop that the path does not need. It is
    the stop in reserve of the chunk before or, from standstill, the end of a shorter window.
    """

    method: str
    solver: str
    variables: int
    rows: int
    iterations: int
    solve_time_s: float
    audit_time_s: float
    fallback: bool


@dataclass(frozen=True)
class Chunk:
    """Committed part and stop of one window; the fields are those of the message.

    ``profile`` runs from ``s_start_mm`` to ``s_stop_mm``; ``s_commit_mm`` is the end of one of its elements.
    ``dwell_s`` is the time to wait at standstill at ``s_commit_mm`` before the next chunk starts.
    """

    sequence: int
    last_segment_sequence: int
    last: bool
    s_start_mm: float
    s_commit_mm: float
    s_stop_mm: float
    t_start_s: float
    t_commit_s: float
    dwell_s: float
    profile: FeedProfile
    certificate: Certificate
    figures: SolverFigures
