"""Golden bags replay as they were recorded, and a formula that is changed by one character does not pass."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

pytest.importorskip("feedopt_msgs.msg")

from feedopt_tools.command.main import main
from feedopt_tools.replay.golden import (
    MOST_BYTES,
    bag_hash,
    checked_tolerances,
    chosen_bags,
    load_manifest,
    replace_bag,
    write_manifest,
)

BAGS = Path(__file__).resolve().parents[1] / "bags"
NAMES = sorted(load_manifest(BAGS))
# The bag, the module, what stands there, what is put in its place, and the stage that must be named first.
MUTATIONS = [
    ("dome", "feedopt_core.smoothing.cubic_spline", "(p + q + r) / 3.0", "(p - q + r) / 3.0", "toolpath"),
    (
        "corners",
        "feedopt_core.smoothing.corners.euler_pair",
        "np.cos(half) * before + np.sin(half)",
        "np.cos(half) * before - np.sin(half)",
        "toolpath",
    ),
    (
        "corners",
        "feedopt_core.planner.stream_planner",
        "t_commit_s=self._committed.t_s + float(",
        "t_commit_s=self._committed.t_s - float(",
        "planner",
    ),
    ("corners", "feedopt_core.constraints.limit_rows", "1.5 * on_j * d2", "1.6 * on_j * d2", "planner"),
    (
        "plate",
        "feedopt_core.motion.profile",
        "0.5 * jerk * from_standstill",
        "0.6 * jerk * from_standstill",
        "interpolator",
    ),
    ("corners", "feedopt_core.motion.setpoints", "(v**2)[:, None]", "(v**3)[:, None]", "interpolator"),
    ("corners", "router_sim.plant", "_resolution_mm + 0.5)", "_resolution_mm + 0.4)", "router_sim"),
]


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["replay", *map(str, arguments)])


@pytest.mark.parametrize("name", NAMES)
def test_replay_agrees(name: str) -> None:
    result = call(BAGS / name)
    assert result.exit_code == 0, result.output


def test_bags_are_small_and_those_of_the_manifest() -> None:
    assert {path.parent.name for path in BAGS.glob("*/*.mcap")} == set(NAMES)
    for name, entry in load_manifest(BAGS).items():
        assert bag_hash(BAGS / name) == entry.sha256
        assert next((BAGS / name).glob("*.mcap")).stat().st_size < MOST_BYTES
        assert (BAGS / entry.program).is_file() and entry.what and entry.why


@pytest.mark.parametrize(("bag", "module", "old", "new", "stage"), MUTATIONS, ids=[row[1] for row in MUTATIONS])
def test_changed_formula_fails_and_is_located(
    tmp_path: Path, bag: str, module: str, old: str, new: str, stage: str
) -> None:
    spec = importlib.util.find_spec(module)
    assert spec is not None and spec.origin is not None
    text = Path(spec.origin).read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{module}: the formula to change is gone; choose another"
    changed = tmp_path / Path(spec.origin).name
    changed.write_text(text.replace(old, new), encoding="utf-8")
    script = Path(__file__).with_name("mutated_replay.py")
    command = [sys.executable, str(script), str(BAGS / bag), module, str(changed)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 1, result.stdout + result.stderr
    assert f"DIFFERS, first in stage {stage}\n" in result.stdout


def test_unchanged_formula_passes_the_same_way(tmp_path: Path) -> None:
    module = "feedopt_core.motion.setpoints"
    spec = importlib.util.find_spec(module)
    assert spec is not None and spec.origin is not None
    copied = shutil.copy(spec.origin, tmp_path)
    script = Path(__file__).with_name("mutated_replay.py")
    command = [sys.executable, str(script), str(BAGS / "corners"), module, str(copied)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """One golden bag in a folder of its own."""
    copied = tmp_path / "golden"
    shutil.copytree(BAGS / "corners", copied / "corners")
    write_manifest(copied, {"corners": load_manifest(BAGS)["corners"]})
    return copied


def test_bag_that_is_not_the_one_of_the_manifest_is_refused(folder: Path) -> None:
    path = next((folder / "corners").glob("*.mcap"))
    with path.open("ab") as stream:
        stream.write(b"\0")
    result = call(folder / "corners")
    assert result.exit_code == 2 and "--update" in result.output


def test_large_bag_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from feedopt_tools.replay import golden

    monkeypatch.setattr(golden, "MOST_BYTES", 1000)
    with pytest.raises(golden.GoldenBagError, match="at most 1000"):
        checked_tolerances(folder / "corners")
    with pytest.raises(golden.GoldenBagError, match="at most 1000"):
        replace_bag(folder / "corners", BAGS / "corners")
    assert (folder / "corners").is_dir()


def test_new_recording_takes_the_place_of_the_old_one(folder: Path) -> None:
    shutil.rmtree(folder / "corners")
    replace_bag(folder / "corners", BAGS / "corners")
    assert load_manifest(folder)["corners"].sha256 == bag_hash(BAGS / "corners")
    checked_tolerances(folder / "corners")
    with pytest.raises(Exception, match="has no entry other"):
        replace_bag(folder / "other", BAGS / "corners")


def test_what_stands_beside_bags_is_left_out(folder: Path) -> None:
    (folder / "README.md").write_text("")
    (folder / "programs").mkdir()
    assert chosen_bags(sorted(folder.iterdir())) == [folder / "corners"]
    assert chosen_bags([folder]) == [folder / "corners"]


@pytest.mark.parametrize("text", ["", "bags: [1]\n", "bags: {a: {what: x, unknown: y}}\n", "{\n"])
def test_manifest_that_is_none_is_named(folder: Path, text: str) -> None:
    (folder / "manifest.yaml").write_text(text)
    result = call(folder / "corners")
    assert result.exit_code == 2 and "manifest" in result.output and "Traceback" not in result.output


def test_update_of_what_is_no_golden_bag_is_refused(tmp_path: Path) -> None:
    shutil.copytree(BAGS / "corners", tmp_path / "corners")
    result = call("--update", tmp_path / "corners")
    assert result.exit_code == 2 and "is not a golden bag" in result.output


def test_long_diff_goes_to_a_file(tmp_path: Path) -> None:
    path = tmp_path / "diff.txt"
    assert call(BAGS / "corners", "--diff", path).exit_code == 0
    assert "/axis_state" in path.read_text() and "recorded" in path.read_text()
