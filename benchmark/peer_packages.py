"""Packages for comparison, installed at the first use by a benchmark; requirements/bench.txt pins their versions."""

from __future__ import annotations

import importlib
import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

_REQUIREMENTS = Path(__file__).resolve().parents[1] / "requirements" / "bench.txt"


def install_missing(*modules: str) -> None:
    """Install the extra ``bench`` if one of these modules cannot be imported. Raises CalledProcessError."""
    missing = [module for module in modules if importlib.util.find_spec(module) is None]
    if not missing:
        return
    print(f"{', '.join(missing)} not installed; installing {_REQUIREMENTS.name} ...", file=sys.stderr)
    installer = [sys.executable, "-m", "pip", "install", "--quiet"]
    if uv := shutil.which("uv"):
        installer = [uv, "pip", "install", "--quiet", "--python", sys.executable]
    subprocess.run([*installer, "-r", str(_REQUIREMENTS)], check=True)
    importlib.invalidate_caches()
