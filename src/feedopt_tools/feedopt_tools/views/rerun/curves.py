"""Curves, limit lines and coloured paths in a Rerun recording, with their style."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from feedopt_core.arrays import FloatArray
from feedopt_tools.views.colours import LIMIT

TIME = "motion_time"
ARC_LENGTH = "arc_length_um"

Colour = tuple[int, int, int]
Times = Sequence[rr.TimeColumn]


def entity(*parts: str) -> str:
    """Path of an entity; its parts can be any text, such as names of axes."""
    return "/".join(rr.escape_entity_path_part(part) for part in parts)


def times(t_s: FloatArray, s_mm: FloatArray) -> list[rr.TimeColumn]:
    """Both time lines of samples: motion time, and arc length in whole micrometres."""
    return [along_time(t_s), along_path(s_mm)]


def along_time(t_s: FloatArray) -> rr.TimeColumn:
    """Motion time of samples."""
    return rr.TimeColumn(TIME, duration=t_s)


def along_path(s_mm: FloatArray) -> rr.TimeColumn:
    """Arc length of samples."""
    return rr.TimeColumn(ARC_LENGTH, sequence=np.round(1e3 * s_mm).astype(np.int64))


class Curves:
    """Writes curves into one recording."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self.recording = recording

    def curve(
        self,
        entity: str,
        at: Times,
        values: FloatArray,
        name: str,
        colour: Colour,
        width: float = 1.4,
        *,
        steps: bool = False,
    ) -> None:
        """A curve on the given time lines; ``steps`` keeps each value until the next sample."""
        # At low zoom a curve shows its extremes, not its average: a peak above a limit must stay visible.
        style = rr.SeriesLines(
            colors=colour,
            names=name,
            widths=width,
            aggregation_policy=rr.components.AggregationPolicy.MinMax,
            interpolation_mode=rr.components.InterpolationMode.StepAfter if steps else None,
        )
        self.recording.log(entity, style, static=True)
        self.recording.send_columns(entity, indexes=at, columns=rr.Scalars.columns(scalars=values))

    def limits(self, entity: str, ends: Times, values: Sequence[float], name: str = "limit") -> None:
        """Straight lines over the whole run; no line for a missing limit (NaN or infinity)."""
        if not len(values) or not np.all(np.isfinite(values)):
            return
        style = rr.SeriesLines(colors=[LIMIT] * len(values), names=[name] * len(values), widths=[1.0] * len(values))
        self.recording.log(entity, style, static=True)
        columns = rr.Scalars.columns(scalars=np.tile(np.asarray(values), 2)).partition([len(values)] * 2)
        self.recording.send_columns(entity, indexes=ends, columns=columns)

    def path(self, entity: str, strips: Sequence[FloatArray], colours: NDArray[np.uint8], width: float = 1.6) -> None:
        """A path in space with one colour per strip, shape (strips, 3), or one colour for all, shape (1, 3)."""
        lines = rr.LineStrips3D(strips, colors=colours, radii=rr.Radius.ui_points(width))
        self.recording.log(entity, lines, static=True)

    def text(self, entity: str, text: str, *, markdown: bool = False) -> None:
        """A text document."""
        media_type = "text/markdown" if markdown else "text/plain"
        self.recording.log(entity, rr.TextDocument(text, media_type=media_type), static=True)
