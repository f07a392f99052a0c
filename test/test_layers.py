"""The layers contract of the core: it holds, and it breaks when one arrow is turned round."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

WORKSPACE = Path(__file__).resolve().parents[1]


def layers_contract() -> dict[str, Any]:
    settings = tomllib.loads((WORKSPACE / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    (contract,) = (one for one in settings["contracts"] if one["type"] == "layers")
    return dict(contract)


@pytest.fixture
def core(tmp_path: Path) -> Path:
    """A copy of the core beside a configuration that holds the layers contract alone."""
    shutil.copytree(
        WORKSPACE / "src/feedopt_core/feedopt_core",
        tmp_path / "feedopt_core",
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    lines = [f"{key} = {json.dumps(value)}" for key, value in layers_contract().items()]
    settings = ["[tool.importlinter]", 'root_packages = ["feedopt_core"]', "[[tool.importlinter.contracts]]", *lines]
    (tmp_path / "layers.toml").write_text("\n".join(settings) + "\n", encoding="utf-8")
    return tmp_path / "feedopt_core"


def lint(core: Path) -> tuple[int, str]:
    """Exit code and report of import-linter on a copy of the core."""
    command = ["lint-imports", "--config", "layers.toml", "--no-cache"]
    environment = os.environ | {"PYTHONPATH": str(core.parent)}
    done = subprocess.run(command, cwd=core.parent, env=environment, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def test_contract_holds(core):
    code, report = lint(core)
    assert code == 0, report
    assert "1 kept, 0 broken" in report


@pytest.mark.parametrize(
    ("importer", "imported"),
    [
        ("geometry.toolpath", "planner.stream_planner"),
        ("errors", "machine.machine_file"),
        ("audit.setpoints", "smoothing.cubic_spline"),
    ],
    ids=["lower room imports an upper one", "lowest room imports another", "rooms of one layer"],
)
def test_arrow_that_is_turned_round_is_named(core, importer, imported):
    module = core.joinpath(*importer.split(".")).with_suffix(".py")
    with module.open("a", encoding="utf-8") as file:
        file.write(f"\nimport feedopt_core.{imported}\n")
    code, report = lint(core)
    assert code == 1, report
    assert f"feedopt_core.{importer} -> feedopt_core.{imported}" in report


def test_room_that_no_layer_names_is_refused(core):
    (core / "leftovers").mkdir()
    (core / "leftovers/__init__.py").write_text("", encoding="utf-8")
    code, report = lint(core)
    assert code == 1, report
    assert "leftovers" in report
