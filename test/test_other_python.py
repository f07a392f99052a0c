"""The other Python that is supported, 3.11 or 3.12, where it is present: set-up, unit tests of the core, one program.

It proves that the locked packages exist for it, that the messages build, that every kernel compiles and the core
computes the same, and that the nodes start. Style, types and the rest of the tests are left to the Python in use.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

WORKSPACE = Path(__file__).resolve().parents[1]
OTHER = "3.12" if sys.version_info[:2] == (3, 11) else "3.11"
PROGRAM = "x_mm,y_mm\n0,0\n4,1\n8,0\n10,3\n"

pytestmark = pytest.mark.graph


def other_python() -> Path | None:
    """The other Python, in PATH or among the versions that pyenv holds; None where it is not there."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    in_path = shutil.which(f"python{OTHER}")
    candidates = [Path(in_path)] if in_path else []
    candidates += sorted(pyenv.glob(f"versions/{OTHER}.*/bin/python{OTHER}"))
    for candidate in candidates:
        # A command of pyenv may stand in PATH without the Python that it is named after.
        asked = [str(candidate), "-c", "import ensurepip, sys, venv; print('%d.%d' % sys.version_info[:2])"]
        if subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip() == OTHER:
            return candidate
    return None


def environment(python: Path) -> dict[str, str]:
    """The environment of a shell that knows nothing of this workspace."""
    ours = (
        "FEEDOPT_",
        "AMENT_",
        "CMAKE_PREFIX_PATH",
        "COLCON_",
        "LD_LIBRARY_PATH",
        "PYTHON",
        "RMW_",
        "_ROS_",
        "ROS_LOG",
    )
    bare = {key: value for key, value in os.environ.items() if not key.startswith(ours)}
    folders = bare["PATH"].split(os.pathsep)
    bare["PATH"] = os.pathsep.join(folder for folder in folders if folder != str(Path(sys.prefix) / "bin"))
    return bare | {"FEEDOPT_PYTHON": str(python), "FEEDOPT_EXTRAS": "test"}


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("other_python")
    for name in ("feedopt", "pyproject.toml"):
        shutil.copy2(WORKSPACE / name, folder / name)
    for name in ("setup", "requirements", "config", "src"):
        shutil.copytree(WORKSPACE / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "tiny.csv").write_text(PROGRAM, encoding="utf-8")
    yield folder
    # A gigabyte, which pytest would keep for three runs.
    shutil.rmtree(folder)


def test_workspace_is_set_up_and_computes_with_the_other_python(workspace):
    if not (Path(sys.prefix) / "share/ament_index").is_dir():
        pytest.skip("a sourced ROS 2 is made for one Python")
    python = other_python()
    if python is None:
        pytest.skip(f"Python {OTHER} is not here")

    def feedopt(*arguments: str) -> str:
        done = subprocess.run(
            ["./feedopt", *arguments],
            cwd=workspace,
            env=environment(python),
            capture_output=True,
            text=True,
            check=False,
            timeout=900,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    assert feedopt("env", "python", "-c", "import sys; print(sys.version)").startswith(f"{OTHER}.")
    assert " passed" in feedopt("env", "pytest", "-q", "src/feedopt_core/test")
    assert "result       done" in feedopt("run", "tiny.csv", "--out", "run")
