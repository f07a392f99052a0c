"""A published piece of the feed profile: what is committed, the stop behind it, its certificate and its cost."""

from __future__ import annotations

from dataclasses import dataclass

from feedopt_core.motion.certificate import Certificate
from feedopt_core.motion.profile import FeedProfile


@dataclass(frozen=True)
class SolverFigures:
    """What the plan of one window took; ``solver`` is the one that found it.

    ``fallback``: the window had no plan, so the chunk ends in a stop that the path does not ask for: the stop of the
    chunk before, or from rest the end of a shorter window.
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

    ``profile`` runs from ``s_start_mm`` to ``s_stop_mm``, ``s_commit_mm`` is one of its element ends.
    ``dwell_s`` is the time to wait there, at rest, before the next chunk starts.
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
