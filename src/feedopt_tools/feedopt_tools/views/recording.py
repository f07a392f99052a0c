"""A run as a Rerun recording: every curve on one time line, its layout inside the file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from feedopt_core.arrays import FloatArray
from feedopt_tools.bags.run_data import RunData
from feedopt_tools.views.colours import FEED, LIMIT, PATH, PREDICTED, axis_colour, feed_colours
from feedopt_tools.views.errors import ViewError
from feedopt_tools.views.layout import run_layout
from feedopt_tools.views.signals import Quantity, RunSignals, signals_of, speed_pieces
from feedopt_tools.views.summary import summary_markdown

APPLICATION = "feedopt"
TIME = "motion_time"
ARC_LENGTH = "arc_length_um"
_PIECES = 3000
_TOOL_EVERY = 10
_PROGRAM_TEXT_CHARACTERS = 200_000


def save_recording(run: RunData, path: Path) -> RunSignals:
    """Write a run as an ``.rrd`` file that opens with its layout.

    Args:
        run: what was recorded.
        path: the file to write.

    Returns:
        The curves that were drawn.

    Raises:
        ViewError: there is nothing to draw, or the file cannot be written.
    """
    signals = signals_of(run)
    recording = rr.RecordingStream(APPLICATION, recording_id=f"{run.title} program {run.program_id}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        recording.save(path, default_blueprint=run_layout(signals))
    except (OSError, RuntimeError) as error:
        raise ViewError(f"{path}: cannot be written: {error}") from error
    recording.send_recording_name(run.title)
    _Drawing(recording, signals).draw()
    recording.flush()
    recording.disconnect()
    return signals


class _Drawing:
    """The entities of one recording."""

    def __init__(self, recording: rr.RecordingStream, signals: RunSignals) -> None:
        self.recording = recording
        self.signals = signals
        self.at_setpoints = _times(signals.t_s, signals.s_mm)
        self.at_states = _times(signals.state_t_s, signals.state_s_mm)
        self.at_ends = _times(signals.t_s[[0, -1]], signals.s_mm[[0, -1]])

    def draw(self) -> None:
        signals, run = self.signals, self.signals.run
        self._path()
        self._curve("feed/feedrate", self.at_setpoints, signals.feedrate_mm_s, "feedrate", FEED, 1.4)
        self._limits("feed/limit", [signals.feed_limit_mm_s], "limit")
        if signals.programmed_mm_s is not None:
            programmed = np.minimum(signals.programmed_mm_s, signals.feed_limit_mm_s)
            self._curve("feed/programmed", self.at_setpoints, programmed, "programmed", PREDICTED, 1.0)
        for quantity in signals.quantities.values():
            for axis, name in enumerate(run.axis_names):
                self._quantity(f"{quantity.key}/{name}", quantity, axis)
        self._curve("interpolator/lateness", self.at_setpoints, signals.lateness_ms, "lateness, ms", FEED, 1.0)
        self._planner()
        self.recording.log(
            "summary", rr.TextDocument(summary_markdown(signals), media_type="text/markdown"), static=True
        )
        if text := run.provenance.get("feedopt/program", {}).get("text", ""):
            self.recording.log("program", rr.TextDocument(text[:_PROGRAM_TEXT_CHARACTERS]), static=True)

    def _path(self) -> None:
        signals, recording = self.signals, self.recording
        pieces = speed_pieces(signals.s_mm, _PIECES)
        strips = [signals.tool_mm[first : last + 1] for first, last in pieces]
        fastest = np.array([np.max(signals.feedrate_mm_s[first : last + 1]) for first, last in pieces])
        colours = feed_colours(fastest, signals.top_feed_mm_s)
        recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        path = rr.LineStrips3D(strips, colors=colours, radii=rr.Radius.ui_points(1.6))
        recording.log("toolpath", path, static=True)
        recording.log(
            "start", rr.Points3D(signals.tool_mm[:1], colors=[PATH], radii=rr.Radius.ui_points(4.0)), static=True
        )
        rows = np.arange(0, len(signals.t_s), _TOOL_EVERY)
        style = rr.Points3D.from_fields(colors=[(255, 255, 255)], radii=rr.Radius.ui_points(6.0))
        recording.log("tool", style, static=True)
        times = _times(signals.t_s[rows], signals.s_mm[rows])
        recording.send_columns("tool", indexes=times, columns=rr.Points3D.columns(positions=signals.tool_mm[rows]))

    def _quantity(self, entity: str, quantity: Quantity, axis: int) -> None:
        measured, commanded = quantity.measured, quantity.commanded
        colour = axis_colour(axis)
        if measured is not None:
            # Curves are drawn in the order of their names: the prediction over what it predicts.
            self._curve(f"{entity}/actual", self.at_states, measured[:, axis], "simulated", colour, 1.4)
        if commanded is not None:
            name, own = ("predicted", PREDICTED) if quantity.key in _MODELLED else ("commanded", colour)
            self._curve(f"{entity}/{name}", self.at_setpoints, commanded[:, axis], name, own, 1.0)
        if quantity.limit is not None:
            self._limits(f"{entity}/limit", [quantity.limit[axis], -quantity.limit[axis]], "limit")

    def _planner(self) -> None:
        chunks = self.signals.run.chunks
        if not chunks:
            return
        # Each chunk holds from where it takes over; the last one to the end of its committed part.
        held = [*chunks, chunks[-1]]
        t_s = np.array([*(chunk.t_start_s for chunk in chunks), chunks[-1].t_commit_s])
        s_mm = np.array([*(chunk.s_start_mm for chunk in chunks), chunks[-1].s_commit_mm])
        rows = (
            ("planner/solve", "solve, ms", [1e3 * chunk.figures.solve_time_s for chunk in held], 2),
            ("planner/audit", "audit, ms", [1e3 * chunk.figures.audit_time_s for chunk in held], 5),
            ("certificate/ratio", "closest limit, %", [100.0 * chunk.certificate.worst_ratio for chunk in held], 3),
        )
        for entity, name, values, colour in rows:
            self._curve(entity, _times(t_s, s_mm), np.array(values), name, axis_colour(colour), 1.6, steps=True)
        self._limits("certificate/limit", [100.0], "limit")

    def _curve(
        self,
        entity: str,
        times: Sequence[rr.TimeColumn],
        values: FloatArray,
        name: str,
        colour: tuple[int, int, int],
        width: float,
        *,
        steps: bool = False,
    ) -> None:
        # Seen from afar a curve shows its extremes, not its average: a peak over a limit must not vanish.
        style = rr.SeriesLines(
            colors=colour,
            names=name,
            widths=width,
            aggregation_policy=rr.components.AggregationPolicy.MinMax,
            interpolation_mode=rr.components.InterpolationMode.StepAfter if steps else None,
        )
        self.recording.log(entity, style, static=True)
        self.recording.send_columns(entity, indexes=times, columns=rr.Scalars.columns(scalars=values))

    def _limits(self, entity: str, values: list[float], name: str) -> None:
        if not np.all(np.isfinite(values)):
            return
        style = rr.SeriesLines(colors=[LIMIT] * len(values), names=[name] * len(values), widths=[1.0] * len(values))
        self.recording.log(entity, style, static=True)
        columns = rr.Scalars.columns(scalars=np.tile(values, 2)).partition([len(values)] * 2)
        self.recording.send_columns(entity, indexes=self.at_ends, columns=columns)


_MODELLED = ("control_signal", "tracking_error")


def _times(t_s: FloatArray, s_mm: FloatArray) -> list[rr.TimeColumn]:
    return [
        rr.TimeColumn(TIME, duration=t_s),
        rr.TimeColumn(ARC_LENGTH, sequence=np.round(1e3 * s_mm).astype(np.int64)),
    ]
