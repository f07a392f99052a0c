"""Writes the entities of a run into a Rerun recording."""

from __future__ import annotations

import numpy as np
import rerun as rr

from feedopt_core.arrays import FloatArray
from feedopt_tools.views.colours import FEED, FREE, PREDICTED, axis_colour, limit_colour
from feedopt_tools.views.rerun.curves import Curves, entity, times
from feedopt_tools.views.rerun.paths import draw_paths
from feedopt_tools.views.signals.limit_use import NONE
from feedopt_tools.views.signals.run_events import program_lines
from feedopt_tools.views.signals.scene import RunScene
from feedopt_tools.views.signals.signals import Quantity
from feedopt_tools.views.signals.summary import summary_markdown

_PROGRAM_TEXT_CHARACTERS = 200_000
_MODELLED = ("control_signal", "tracking_error")
_STATE_COLOURS = {
    "STARTING": (150, 150, 158),
    "READY": (96, 148, 212),
    "RUNNING": (72, 168, 96),
    "DONE": (112, 112, 124),
    "FAULT": (220, 64, 56),
}


def draw_run(recording: rr.RecordingStream, scene: RunScene) -> None:
    """Write all entities of a run into a recording."""
    _Drawing(recording, scene).draw()


class _Drawing:
    def __init__(self, recording: rr.RecordingStream, scene: RunScene) -> None:
        self.curves = Curves(recording)
        self.scene = scene
        self.signals = signals = scene.signals
        self.at_setpoints = times(signals.t_s, signals.s_mm)
        self.at_states = times(signals.state_t_s, signals.state_s_mm)
        self.at_ends = times(signals.t_s[[0, -1]], signals.s_mm[[0, -1]])

    def draw(self) -> None:
        signals, run, curves = self.signals, self.signals.run, self.curves
        draw_paths(curves, self.scene)
        curves.curve("feed/feedrate", self.at_setpoints, signals.feedrate_mm_s, "feedrate", FEED)
        curves.limits("feed/limit", self.at_ends, [signals.feed_limit_mm_s])
        if signals.programmed_mm_s is not None:
            limit = signals.feed_limit_mm_s
            programmed = np.minimum(signals.programmed_mm_s, limit if np.isfinite(limit) else np.inf)
            shown = np.where(np.isfinite(programmed), programmed, np.nan)
            curves.curve("feed/programmed", self.at_setpoints, shown, "programmed", PREDICTED, 1.0)
        for quantity in signals.quantities.values():
            for axis, name in enumerate(run.axis_names):
                self._quantity(entity(quantity.key, name), quantity, axis)
        self._limit_use()
        self._contour()
        curves.curve("interpolator/lateness", self.at_setpoints, signals.lateness_ms, "lateness, ms", FEED, 1.0)
        self._planner()
        self._events()
        curves.text("summary", summary_markdown(self.scene), markdown=True)
        if text := run.provenance.get("feedopt/program", {}).get("text", ""):
            curves.text("program", text[:_PROGRAM_TEXT_CHARACTERS])

    def _quantity(self, path: str, quantity: Quantity, axis: int) -> None:
        measured, commanded = quantity.measured, quantity.commanded
        colour = axis_colour(axis)
        if measured is not None:
            # Rerun draws curves in the order of their names; the prediction must be drawn last.
            self.curves.curve(f"{path}/actual", self.at_states, measured[:, axis], "simulated", colour)
        if commanded is not None:
            name, own = ("predicted", PREDICTED) if quantity.key in _MODELLED else ("commanded", colour)
            self.curves.curve(f"{path}/{name}", self.at_setpoints, commanded[:, axis], name, own, 1.0)
        limit = quantity.limit_of(axis)
        self.curves.limits(f"{path}/limit", self.at_ends, [limit, -limit])

    def _limit_use(self) -> None:
        """Utilisation of every limit in per cent, and the binding limit as states."""
        use, signals = self.scene.limit_use, self.signals
        if not use.limits:
            return
        for k, limit in enumerate(use.limits):
            place = "path" if limit.axis is None else signals.run.axis_names[limit.axis]
            colour = limit_colour(limit.key, limit.axis)
            self.curves.curve(
                entity("use", place, limit.key), self.at_setpoints, 100.0 * use.ratio[:, k], limit.label, colour, 1.2
            )
        self.curves.limits("use/limit", self.at_ends, [100.0])
        names = [limit.label for limit in use.limits]
        colours = [limit_colour(limit.key, limit.axis) for limit in use.limits]
        style = rr.StateConfiguration(values=[*names, "none"], labels=[*names, "none"], colors=[*colours, FREE])
        recording = self.curves.recording
        recording.log("active/limit", style, static=True)
        stretches = use.stretches()
        rows = np.array([first for first, _, _ in stretches])
        states = ["none" if k == NONE else names[k] for _, _, k in stretches]
        at = times(signals.t_s[rows], signals.s_mm[rows])
        recording.send_columns("active/limit", indexes=at, columns=rr.StateChange.columns(state=states))

    def _contour(self) -> None:
        contour = self.scene.contour
        if contour is None:
            return
        at = times(contour.t_s, contour.s_mm)
        self.curves.curve("contour_error/error", at, contour.error_um, "contour error, µm", FEED, 1.0)
        self.curves.curve("lag/lag", at, contour.lag_um, "lag, µm", axis_colour(5), 1.0)

    def _planner(self) -> None:
        chunks = self.signals.run.chunks
        if not chunks:
            return
        # Each chunk is valid until the next one takes over, the last one until the end of its committed part.
        held = [*chunks, chunks[-1]]
        t_s = np.array([*(chunk.t_start_s for chunk in chunks), chunks[-1].t_commit_s])
        s_mm = np.array([*(chunk.s_start_mm for chunk in chunks), chunks[-1].s_commit_mm])
        committed_s = [max(chunk.t_commit_s - chunk.t_start_s, 1e-9) for chunk in held]
        spent_s = [chunk.figures.solve_time_s + chunk.figures.audit_time_s for chunk in held]
        shares = [100.0 * spent / committed for spent, committed in zip(spent_s, committed_s, strict=True)]
        rows = (
            ("planner/solve", "solve, ms", [1e3 * chunk.figures.solve_time_s for chunk in held], axis_colour(2)),
            ("planner/audit", "audit, ms", [1e3 * chunk.figures.audit_time_s for chunk in held], axis_colour(5)),
            ("planner_share/share", "computing time / motion time, %", shares, axis_colour(4)),
            ("certificate/ratio", "closest limit, %", [100 * c.certificate.worst_ratio for c in held], axis_colour(3)),
            ("windows/commit", "committed to, mm", [chunk.s_commit_mm for chunk in held], axis_colour(1)),
            ("windows/stop", "stop at, mm", [chunk.s_stop_mm for chunk in held], axis_colour(0)),
        )
        at = times(t_s, s_mm)
        for path, name, values, colour in rows:
            self.curves.curve(path, at, np.array(values, dtype=np.float64), name, colour, 1.6, steps=True)
        signals = self.signals
        self.curves.curve("windows/motion", self.at_setpoints, signals.s_mm, "motion, mm", PREDICTED, 1.0)
        self.curves.limits("certificate/limit", self.at_ends, [100.0])
        reserve = self.scene.reserve
        if reserve is not None:
            ahead: FloatArray = reserve.ahead_s
            self.curves.curve("reserve/ahead", times(reserve.t_s, reserve.s_mm), ahead, "ahead, s", FEED)

    def _events(self) -> None:
        recording, signals = self.curves.recording, self.signals
        lines = program_lines(signals)
        if lines is not None:
            self.curves.curve("program_line/line", self.at_setpoints, lines, "line", PREDICTED, 1.2, steps=True)
        events = self.scene.events
        if events:
            at = times(np.array([event.t_s for event in events]), np.array([event.s_mm for event in events]))
            texts = [f"{event.source}: {event.text}" for event in events]
            levels = [event.level for event in events]
            recording.send_columns("events", indexes=at, columns=rr.TextLog.columns(text=texts, level=levels))
        for node in dict.fromkeys(state.node for state in self.scene.states):
            mine = [state for state in self.scene.states if state.node == node]
            names = list(_STATE_COLOURS)
            style = rr.StateConfiguration(values=names, labels=names, colors=list(_STATE_COLOURS.values()))
            recording.log(entity("nodes", node), style, static=True)
            at_s = np.array([state.t_s for state in mine])
            at = times(at_s, np.interp(at_s, signals.t_s, signals.s_mm))
            columns = rr.StateChange.columns(state=[state.state for state in mine])
            recording.send_columns(entity("nodes", node), indexes=at, columns=columns)
