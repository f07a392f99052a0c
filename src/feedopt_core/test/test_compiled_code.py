"""Machine code on disk follows every source it was made from.

This relies on what numba keeps private: a dispatcher's ``_cache``, the classes behind it (``FunctionCache``,
``CompileResultCacheImpl`` and its ``_locator_classes``) and the names of the files they write (``.nbi``, ``.nbc``).
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import feedopt_core
from feedopt_core.compiled import source_files

CORE = Path(feedopt_core.__file__).parent
KERNEL_MODULES = sorted(path for path in CORE.rglob("*.py") if "\n@compiled\n" in path.read_text(encoding="utf-8"))
# A kernel that reaches a constant through a compiled function of another module.
SCALE = "SCALE = {}\n"
SCALING = """
from feedopt_core.compiled import compiled
from feedopt_core.geometry.probe_scale import SCALE

@compiled
def scaled(value):
    return SCALE * value
"""
PROBE = """
from feedopt_core.compiled import compiled
from feedopt_core.geometry import probe_scaling

scaled = probe_scaling.scaled

@compiled
def probe(value):
    return scaled(value) + 1.0
"""
CALL = """
import json
from feedopt_core.geometry.probe import probe
print(json.dumps({"value": probe(10.0), "compiled": sum(probe.stats.cache_misses.values())}))
"""
# Each in a process of its own, with numba loaded in all of them.
LOADED_MODULES = """
import json, os, sys
import importlib
import numba.core.caching
for name in sys.argv[1:]:
    if os.fork() == 0:
        importlib.import_module(name)
        ours = [module for module in sys.modules.values() if module.__name__.split(".")[0] == "feedopt_core"]
        print(json.dumps({name: [module.__file__ for module in ours]}), flush=True)
        os._exit(0)
    os.wait()
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Package of the core with a kernel of our own in it."""
    core = shutil.copytree(CORE, tmp_path / CORE.name, ignore=shutil.ignore_patterns("__pycache__"))
    (core / "geometry/probe_scale.py").write_text(SCALE.format(2.0))
    (core / "geometry/probe_scaling.py").write_text(SCALING)
    (core / "geometry/probe.py").write_text(PROBE)
    return core


def call(folder: Path, **environment: str) -> Any:
    paths = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    return json.loads(
        subprocess.run(
            [sys.executable, "-P", "-c", CALL],
            env=os.environ | {"PYTHONPATH": paths} | environment,
            check=True,
            capture_output=True,
            text=True,
        ).stdout
    )


def kept_code(folder: Path) -> set[str]:
    return {path.name for path in folder.rglob("probe.probe-*.nb[ci]")}


def test_an_edited_constant_behind_other_modules_counts_at_once(copy: Path) -> None:
    assert call(copy.parent) == {"value": 21.0, "compiled": 1}
    # Another size: Python's own byte code is stamped with size and time.
    (copy / "geometry/probe_scale.py").write_text(SCALE.format(30.0))
    assert call(copy.parent) == {"value": 301.0, "compiled": 1}


def test_code_is_kept_until_one_of_its_sources_changes(copy: Path) -> None:
    call(copy.parent)
    kept = kept_code(copy / "geometry/__pycache__")
    assert len(kept) == 2
    # What the kernel does not import, and times.
    (copy / "machine/limits.py").write_text("LIMIT = 1\n")
    os.utime(copy / "geometry/probe_scale.py")
    assert call(copy.parent) == {"value": 21.0, "compiled": 0}
    (copy / "geometry/probe_scale.py").write_text(SCALE.format(30.0))
    call(copy.parent)
    # The old code is gone, and not under another name.
    assert len(kept_code(copy / "geometry/__pycache__")) == 2
    assert not kept & kept_code(copy / "geometry/__pycache__")


def test_code_is_kept_in_the_folder_that_is_asked_for(copy: Path, tmp_path: Path) -> None:
    chosen = tmp_path / "chosen"
    assert call(copy.parent, NUMBA_CACHE_DIR=str(chosen))["compiled"] == 1
    assert len(kept_code(chosen)) == 2
    assert not kept_code(copy)
    assert call(copy.parent, NUMBA_CACHE_DIR=str(chosen))["compiled"] == 0


def test_the_stamp_covers_every_module_that_an_import_loads() -> None:
    names = {".".join(path.relative_to(CORE.parent).with_suffix("").parts): path for path in KERNEL_MODULES}
    output = subprocess.run(
        [sys.executable, "-c", LOADED_MODULES, *names], check=True, capture_output=True, text=True
    ).stdout
    loaded: dict[str, list[str]] = {}
    for line in output.splitlines():
        loaded |= json.loads(line)
    assert loaded.keys() == names.keys()
    for name, path in names.items():
        files = {Path(file) for file in loaded[name]}
        assert path in files
        assert files <= source_files(path), name
