"""Draws a running graph from batches of set points, states, chunks and status reports. Free of ROS."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from feedopt_core.arrays import FloatArray
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.chunk import Chunk
from feedopt_recorder.bags.run_data import SetpointArrays, StateArrays, StatusRow
from feedopt_tools.views.colours import FEED, axis_colour, feed_colours
from feedopt_tools.views.rerun.curves import TIME, Curves, Times, along_time, entity
from feedopt_tools.views.rerun.layout import GROUND
from feedopt_tools.views.signals.signals import speed_pieces, tool_from_axes

_PATH_PIECES = 2000
_PATH_EVERY_TICKS = 8


class LiveDrawing:
    """Draws one graph into a recording. Batches of one stream must come in order.

    Args:
        recording: where to.
        machine: its limits and axes.
    """

    def __init__(self, recording: rr.RecordingStream, machine: Machine) -> None:
        self.recording = recording
        self.machine = machine
        self._curves = Curves(recording)
        self._program_id = 0
        self._path = list[FloatArray]()
        self._last_state = dict[str, tuple[int, int, str]]()
        self._now_s = 0.0
        recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._style("feed/feedrate", "feedrate", FEED)
        self._style("interpolator/lateness", "lateness, ms", FEED)
        self._style("planner/solve", "solve, ms", axis_colour(2))
        self._style("planner/audit", "audit, ms", axis_colour(5))
        for axis, name in enumerate(machine.axis_names):
            for key in ("tracking_error", "control_signal"):
                self._style(entity(key, name), name, axis_colour(axis))

    def add_setpoints(self, setpoints: SetpointArrays) -> None:
        """Draw feed, lateness, tool and path of a batch. A new program starts a new path."""
        if not len(setpoints):
            return
        program_id = int(setpoints.program_id[-1])
        if program_id != self._program_id:
            self._program_id, self._path = program_id, []
        mine = setpoints.of_program(program_id)
        at = [along_time(mine.t_s)]
        self._send("feed/feedrate", at, mine.feedrate_mm_s)
        self._send("interpolator/lateness", at, 1e3 * mine.lateness_s)
        self._curves.limits("feed/limit", _ends(mine.t_s), [self.machine.feed_limit_mm_s])
        tool_mm = tool_from_axes(self.machine, mine.position_mm)
        self._path.append(np.column_stack([tool_mm, mine.s_mm, mine.feedrate_mm_s])[::_PATH_EVERY_TICKS])
        self._now_s = float(mine.t_s[-1])
        self.recording.set_time(TIME, duration=self._now_s)
        tool = rr.Points3D(tool_mm[-1:], colors=[(255, 255, 255)], radii=rr.Radius.ui_points(6.0))
        self.recording.log("tool", tool)

    def add_states(self, states: StateArrays) -> None:
        """Draw tracking error and control signal of a batch."""
        if not len(states):
            return
        mine = states.of_program(int(states.program_id[-1]))
        at, machine = [along_time(mine.t_s)], self.machine
        for axis, name in enumerate(machine.axis_names):
            self._send(entity("tracking_error", name), at, 1e3 * mine.tracking_error_mm[:, axis])
            self._send(entity("control_signal", name), at, mine.control_signal_volts[:, axis])
            if machine.tracking_error_limit_mm is not None:
                limit_um = 1e3 * machine.tracking_error_limit_mm[axis]
                self._curves.limits(entity("tracking_error", name, "limit"), _ends(mine.t_s), (limit_um, -limit_um))
            if machine.control_limit_volts is not None:
                limit = machine.control_limit_volts[axis]
                self._curves.limits(entity("control_signal", name, "limit"), _ends(mine.t_s), (limit, -limit))

    def add_chunk(self, chunk: Chunk) -> None:
        """Draw the computing time of a window at its start."""
        at = [along_time(np.array([chunk.t_start_s]))]
        self._send("planner/solve", at, np.array([1e3 * chunk.figures.solve_time_s]))
        self._send("planner/audit", at, np.array([1e3 * chunk.figures.audit_time_s]))

    def add_status(self, status: StatusRow) -> None:
        """List a change of state at the current motion time."""
        now = (status.program_id, status.state, status.said)
        if self._last_state.get(status.node) == now:
            return
        self._last_state[status.node] = now
        self.recording.set_time(TIME, duration=self._now_s)
        level = "INFO" if status.failure is None else "ERROR"
        text = ": ".join(filter(None, (status.node, status.state_name, status.said)))
        self.recording.log("events", rr.TextLog(text, level=level))

    def draw_path(self) -> None:
        """Draw the path so far, coloured by feed. The whole path is sent each time: call about once a second."""
        if not self._path:
            return
        rows = np.vstack(self._path)
        if len(rows) < 2:
            return
        pieces = speed_pieces(rows[:, 3], _PATH_PIECES)
        strips = [rows[first : last + 1, :3] for first, last in pieces]
        fastest = np.array([np.max(rows[first : last + 1, 4]) for first, last in pieces])
        top = max(1.0, float(np.max(rows[:, 4])))
        lines = rr.LineStrips3D(strips, colors=feed_colours(fastest, top), radii=rr.Radius.ui_points(1.6))
        self.recording.log("path", lines, static=True)

    def layout(self) -> rrb.Blueprint:
        """The path on the left; feed, tracking error, control signal, lateness and events on the right."""
        silent = rrb.PlotLegend(visible=False)
        names = self.machine.axis_names

        def row(key: str, title: str) -> rrb.Horizontal:
            return rrb.Horizontal(
                *(
                    rrb.TimeSeriesView(origin=entity(key, name), name=f"{name}: {title}", plot_legend=silent)
                    for name in names
                )
            )

        right = rrb.Vertical(
            rrb.TimeSeriesView(origin="feed", name="Feedrate, mm/s", plot_legend=silent),
            row("tracking_error", "tracking error, µm"),
            row("control_signal", "control signal, V"),
            rrb.Horizontal(
                rrb.TimeSeriesView(origin="interpolator", name="Lateness of the set points, ms", plot_legend=silent),
                rrb.TimeSeriesView(origin="planner", name="Computing of each window, ms"),
            ),
        )
        path = rrb.Spatial3DView(
            origin="/", contents=["path", "tool"], name="Path by feed", background=GROUND, line_grid=False
        )
        left = rrb.Vertical(path, rrb.TextLogView(origin="events", name="Events"), row_shares=[3, 1])
        return rrb.Blueprint(
            rrb.Horizontal(left, right, column_shares=[2, 3]),
            rrb.BlueprintPanel(state="collapsed"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.TimePanel(state="collapsed", timeline=TIME, play_state="following"),
            auto_layout=False,
            auto_views=False,
        )

    def _style(self, path: str, name: str, colour: tuple[int, int, int]) -> None:
        # Zoomed out, a view must show peaks, not averages.
        extremes = rr.components.AggregationPolicy.MinMax
        style = rr.SeriesLines(colors=colour, names=name, widths=1.2, aggregation_policy=extremes)
        self.recording.log(path, style, static=True)

    def _send(self, path: str, at: list[rr.TimeColumn], values: FloatArray) -> None:
        self.recording.send_columns(path, indexes=at, columns=rr.Scalars.columns(scalars=values))


def _ends(t_s: FloatArray) -> Times:
    """First and last instant of a batch, for the limit lines."""
    return [along_time(t_s[[0, -1]])]
