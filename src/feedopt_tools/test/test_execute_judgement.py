"""A recorded run judged from its bag alone, against what is known of the made-up run."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_run import motion, write_run

from feedopt_core.errors import ConfigError
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.bags.run_data import RunData
from feedopt_tools.execute.judgement import TrackingRow, judge_run

SUMMARY = {"topics": {"/a": {"messages": 40}, "/b": {"messages": 2}}, "cpu_share_ratio": 0.125}


def recorded(tmp_path: Path, duration_s: float = 6.0, drop: frozenset[tuple[str, int]] = frozenset()) -> RunData:
    bag = write_run(tmp_path / "bag", tmp_path / "share", duration_s=duration_s, drop=drop)
    (bag / "recorder_summary.json").write_text(json.dumps(SUMMARY), encoding="utf-8")
    return read_bag(bag)


def test_a_run_within_its_limits_holds(tmp_path: Path) -> None:
    run = recorded(tmp_path, 12.0)
    judgement = judge_run(run)
    known = motion(12.0)
    assert judgement.holds, (judgement.audit.worst, judgement.findings)
    ratios = {(row.quantity, row.axis): row.ratio for row in judgement.audit.rows}
    assert ratios["velocity", "X"] == pytest.approx(np.max(np.abs(known.velocity_mm_s[:, 0])) / 150.0, rel=1e-3)
    largest_mm_s2 = np.max(np.abs(known.acceleration_mm_s2[:, 1]))
    assert ratios["acceleration", "Y"] == pytest.approx(largest_mm_s2 / 3340.0, rel=1e-2)
    assert judgement.punctuality.ticks == len(known.tick)
    assert (judgement.recorded_messages, judgement.recorder_cpu_ratio) == (42, 0.125)


def test_tracking_compares_prediction_with_simulation(tmp_path: Path) -> None:
    judgement = judge_run(recorded(tmp_path, 12.0))
    error_um = 1e3 * motion(12.0).tracking_error_mm
    for axis, row in enumerate(judgement.tracking):
        assert row.simulated_max_um == pytest.approx(np.max(np.abs(error_um[:, axis])), rel=1e-6)
        assert row.simulated_rms_um == pytest.approx(np.sqrt(np.mean(error_um[:, axis] ** 2)), rel=1e-6)
        # The made-up error is the model's, with noise of 0.2 um.
        assert row.predicted_rms_um == pytest.approx(row.simulated_rms_um, abs=0.1)


def test_drive_beyond_its_limit_is_named(tmp_path: Path) -> None:
    assert [row.limit_um for row in judge_run(recorded(tmp_path, 12.0)).tracking] == [20.0, 20.0]
    assert TrackingRow("X", 20.0, 16.0, 12.0, 20.01, 12.1).over
    assert not TrackingRow("X", 20.0, 16.0, 12.0, 19.99, 12.1).over


def test_a_broken_limit_does_not_hold(tmp_path: Path) -> None:
    judgement = judge_run(recorded(tmp_path, 2.0))
    assert not judgement.findings
    assert not judgement.holds
    assert judgement.audit.worst.ratio > 1.1


def test_a_missing_tick_does_not_hold(tmp_path: Path) -> None:
    judgement = judge_run(recorded(tmp_path, 12.0, frozenset({("/axis_setpoint", 500)})))
    assert judgement.punctuality.missing_ticks == 1
    assert not judgement.holds


def test_late_ticks_are_counted_by_the_period(tmp_path: Path) -> None:
    run = recorded(tmp_path, 12.0)
    lateness = np.zeros(len(run.setpoints))
    lateness[[10, 20, 30]] = [0.00099, 0.001, 0.005]
    punctuality = judge_run(replace(run, setpoints=replace(run.setpoints, lateness_s=lateness))).punctuality
    assert punctuality.late_ticks == 2
    assert (punctuality.p50_s, punctuality.missing_ticks) == (0.0, 0)


def test_without_a_machine_there_is_nothing_to_judge_by(tmp_path: Path) -> None:
    run = replace(recorded(tmp_path), machine=None)
    with pytest.raises(ConfigError, match="holds no /machine"):
        judge_run(run)


def test_without_the_recorders_summary_the_run_is_not_judged(tmp_path: Path) -> None:
    run = recorded(tmp_path)
    (run.path / "recorder_summary.json").unlink()
    with pytest.raises(ConfigError, match=r"recorder_summary\.json"):
        judge_run(run)
