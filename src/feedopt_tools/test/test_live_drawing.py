"""What the live view draws of batches as they come from a running graph."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from click.testing import CliRunner
from recorded_run import write_run

from feedopt_core.errors import Failure, FailureKind
from feedopt_msgs.msg import NodeStatus
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.bags.run_data import RunData, SampleArrays, StatusRow
from feedopt_tools.command.main import main
from feedopt_tools.live.live_drawing import LiveDrawing

BATCH = 83


class Captured:
    """Takes what would go to a viewer."""

    def __init__(self) -> None:
        self.columns: dict[str, list[Any]] = {}
        self.logged: dict[str, list[Any]] = {}

    def send_columns(self, entity: str, indexes: Any, columns: Any) -> None:
        self.columns.setdefault(entity, []).append(columns)

    def log(self, entity: str, value: Any, static: bool = False) -> None:
        self.logged.setdefault(entity, []).append(value)

    def set_time(self, timeline: str, *, duration: float) -> None:
        assert timeline == "motion_time"

    def values(self, entity: str) -> np.ndarray:
        """All scalars that were sent to an entity, in order."""
        return np.concatenate(
            [np.array(batch[0].as_arrow_array().flatten()) for batch in map(list, self.columns[entity])]
        )


def rows_of(samples: Any, first: int, last: int) -> Any:
    assert isinstance(samples, SampleArrays)
    return samples.rows(slice(first, last))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    folder = tmp_path_factory.mktemp("live")
    return read_bag(write_run(folder / "run", folder / "share", duration_s=1.0))


def drawn(run: RunData) -> tuple[Captured, LiveDrawing]:
    captured = Captured()
    assert run.machine is not None
    drawing = LiveDrawing(captured, run.machine)  # type: ignore[arg-type]
    for first in range(0, len(run.setpoints), BATCH):
        drawing.add_setpoints(rows_of(run.setpoints, first, first + BATCH))
        drawing.add_states(rows_of(run.states, first, first + BATCH))
    return captured, drawing


def test_every_sample_of_every_batch_is_drawn_once(run: RunData) -> None:
    captured, drawing = drawn(run)
    np.testing.assert_array_equal(captured.values("feed/feedrate"), run.setpoints.feedrate_mm_s)
    np.testing.assert_array_equal(captured.values("interpolator/lateness"), 1e3 * run.setpoints.lateness_s)
    for axis, name in enumerate("XY"):
        error_um = 1e3 * run.states.tracking_error_mm[:, axis]
        np.testing.assert_array_equal(captured.values(f"tracking_error/{name}"), error_um)
        np.testing.assert_array_equal(
            captured.values(f"control_signal/{name}"), run.states.control_signal_volts[:, axis]
        )
    batches = -(-len(run.states) // BATCH)
    np.testing.assert_array_equal(captured.values("tracking_error/X/limit"), np.tile([20.0, -20.0], 2 * batches))
    np.testing.assert_array_equal(captured.values("control_signal/Y/limit"), np.tile([10.0, -10.0], 2 * batches))
    for chunk in run.chunks:
        drawing.add_chunk(chunk)
    solve_ms = [1e3 * chunk.figures.solve_time_s for chunk in run.chunks]
    np.testing.assert_allclose(captured.values("planner/solve"), solve_ms)


def test_empty_batches_draw_nothing(run: RunData) -> None:
    captured, drawing = drawn(run)
    sent = len(captured.columns["feed/feedrate"])
    drawing.add_setpoints(rows_of(run.setpoints, 0, 0))
    drawing.add_states(rows_of(run.states, 0, 0))
    assert len(captured.columns["feed/feedrate"]) == sent


def test_path_begins_anew_with_a_program(run: RunData) -> None:
    captured, drawing = drawn(run)
    drawing.draw_path()
    whole = captured.logged["path"][-1].strips.as_arrow_array().flatten()
    batch = rows_of(run.setpoints, 300, 400)
    batch.program_id[:] = 2
    drawing.add_setpoints(batch)
    drawing.draw_path()
    assert len(captured.logged["path"][-1].strips.as_arrow_array().flatten()) < 0.3 * len(whole)


def test_a_state_is_listed_when_it_changes(run: RunData) -> None:
    captured, drawing = drawn(run)

    failure = Failure(kind=FailureKind.SOLVER, message="no solution")
    for state in (1, 2, 2, 2, 4):
        cause = failure if state == NodeStatus.FAULT else None
        drawing.add_status(StatusRow(0, "planner", state, 1, 0, 0, 0.0, 0.0, 0, 0, "", cause))
    texts = [str(entry.text.as_arrow_array()[0]) for entry in captured.logged["events"]]
    assert texts == ["planner: READY", "planner: RUNNING", "planner: FAULT: no solution"]


def test_layout_fits_the_axes_and_a_recording_takes_everything(run: RunData, tmp_path: Path) -> None:
    assert run.machine is not None
    recording = rr.RecordingStream("feedopt_test")
    recording.save(tmp_path / "live.rrd")
    drawing = LiveDrawing(recording, run.machine)
    recording.send_blueprint(drawing.layout())
    drawing.add_setpoints(run.setpoints)
    drawing.add_states(run.states)
    drawing.draw_path()
    recording.flush()
    recording.disconnect()
    assert (tmp_path / "live.rrd").stat().st_size > 20_000


def test_wishes_that_exclude_each_other_are_refused(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["live", "--web", "--save", str(tmp_path / "x.rrd")])
    assert result.exit_code == 2
    assert "one of --save, --connect and --web" in result.stderr
