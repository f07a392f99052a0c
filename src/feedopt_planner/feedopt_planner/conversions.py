"""Paths for display in metres, and the planner's figures as diagnostics."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseStamped
from nav_msgs.msg import Path

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.segments import Segment
from feedopt_core.motion.chunk import Chunk
from feedopt_node.conversions import time_message

DISPLAY_FRAME = "machine"
MAX_DISPLAY_POINTS = 20_000
_M_PER_MM = 1e-3


@dataclass
class DisplayPath:
    """Points of the streamed path every ``spacing_mm``; the spacing doubles if there are too many points."""

    spacing_mm: float
    _points_mm: list[FloatArray] = field(default_factory=list)
    _count: int = 0

    def add(self, segment: Segment) -> None:
        """Add the points of the next segment."""
        steps = max(1, int(np.ceil(segment.length_mm / self.spacing_mm)))
        s_mm = np.linspace(0.0, segment.length_mm, steps + 1)
        points_mm = segment.evaluate(s_mm if not self._points_mm else s_mm[1:]).r_mm
        self._points_mm.append(points_mm)
        self._count += len(points_mm)
        if self._count > MAX_DISPLAY_POINTS:
            every = np.concatenate(self._points_mm)
            thinned = np.concatenate([every[:-1:2], every[-1:]])
            self._points_mm, self._count, self.spacing_mm = [thinned], len(thinned), 2.0 * self.spacing_mm

    def to_message(self, now_ns: int) -> Path:
        """The path in metres; z is 0 on plane machines."""
        message = Path()
        message.header.stamp = time_message(now_ns)
        message.header.frame_id = DISPLAY_FRAME
        points_m = np.concatenate(self._points_mm) * _M_PER_MM if self._points_mm else np.zeros((0, 3))
        points_m = np.pad(points_m, ((0, 0), (0, 3 - points_m.shape[1])))
        message.poses = [
            PoseStamped(header=message.header, pose=Pose(position=Point(x=x, y=y, z=z)))
            for x, y, z in points_m.tolist()
        ]
        return message


def chunk_diagnostics(chunk: Chunk, now_ns: int) -> DiagnosticArray:
    """Solver figures and certificate of one chunk as diagnostics; WARN if it is a fallback."""
    figures, certificate = chunk.figures, chunk.certificate
    values = {
        "chunk": str(chunk.sequence),
        "method": figures.method,
        "variables": str(figures.variables),
        "rows": str(figures.rows),
        "iterations": str(figures.iterations),
        "solve_time_s": f"{figures.solve_time_s:.6f}",
        "audit_time_s": f"{figures.audit_time_s:.6f}",
        "worst_ratio": f"{certificate.worst_ratio:.6f}",
        "worst_quantity": certificate.worst_quantity,
        "worst_axis": certificate.worst_axis,
        "worst_s_mm": f"{certificate.worst_s_mm:.6f}",
    }
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN if figures.fallback else DiagnosticStatus.OK,
        name="planner",
        message="the window could not be planned: the chunk ends in a stop" if figures.fallback else "planned",
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    array = DiagnosticArray(status=[status])
    array.header.stamp = time_message(now_ns)
    return array
