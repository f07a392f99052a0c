"""Each thing that can be missing is found, and a whole bag has no finding."""

from __future__ import annotations

from pathlib import Path

import pytest
from recorded_run import write_run

from feedopt_recorder.bags.check_bag import check_bag

DURATION_S = 0.3
SAMPLES = 401


def kinds(path: Path) -> set[str]:
    return {finding.kind for finding in check_bag(path)}


def test_whole_bag_has_no_finding(tmp_path: Path) -> None:
    assert check_bag(write_run(tmp_path / "run", tmp_path / "share", duration_s=DURATION_S)) == ()


@pytest.mark.parametrize(
    ("topic", "index", "expected"),
    [
        ("/axis_setpoint", 200, {"gap", "no_setpoint"}),
        ("/axis_setpoint", 0, {"first_missing", "no_setpoint"}),
        ("/axis_setpoint", SAMPLES - 1, {"end_missing", "no_setpoint"}),
        ("/axis_state", 200, {"gap", "no_state"}),
        ("/axis_state", 0, {"first_missing", "no_state"}),
        ("/axis_state", SAMPLES - 1, {"end_missing", "no_state"}),
        ("/feed_profile", 2, {"gap", "chunk"}),
        ("/feed_profile", 0, {"first_missing", "chunk"}),
        ("/feed_profile", 5, {"end_missing", "chunk"}),
        ("/toolpath", 7, {"gap"}),
        ("/toolpath", 0, {"first_missing"}),
    ],
)
def test_one_message_removed_is_found(tmp_path: Path, topic: str, index: int, expected: set[str]) -> None:
    run = write_run(tmp_path / "run", tmp_path / "share", duration_s=DURATION_S, drop=frozenset({(topic, index)}))
    assert kinds(run) == expected
    assert any(topic in finding.place for finding in check_bag(run))


def test_finding_names_what_is_missing(tmp_path: Path) -> None:
    drop = frozenset(("/axis_state", index) for index in (99, 100, 250))
    run = write_run(tmp_path / "run", tmp_path / "share", duration_s=DURATION_S, drop=drop)
    texts = {finding.kind: finding.text for finding in check_bag(run)}
    assert texts["gap"] == "3 messages are missing: 100 to 101, 251"
    assert texts["no_state"] == "3 set points have no state, first 100"


def test_cut_off_file_is_a_finding(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", tmp_path / "share", duration_s=2.0)
    path = run / "run_0.mcap"
    path.write_bytes(path.read_bytes()[: int(0.8 * path.stat().st_size)])
    assert {"cut_off", "end_missing"} <= kinds(run)
