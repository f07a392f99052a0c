"""What a plan promises by the quasi-static models holds on the simulated servos, which know nothing of those models."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from feedopt_core.machine.machine_file import load_machine


@pytest.fixture
def servo(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1]))
    return importlib.import_module("benchmark.servo")


@pytest.mark.parametrize("method", ["lp", "lp_nlp"])
@pytest.mark.parametrize("name", ["router_simulation", "router_experiment"])
def test_fan_contour_stays_within_the_tracking_error_limit_without_saturation(
    servo: Any, name: str, method: str
) -> None:
    machine = load_machine(name)
    motion = servo.followed(machine, name, method)
    assert machine.tracking_error_limit_mm is not None
    assert np.all(np.array(motion.error_mm) <= machine.tracking_error_limit_mm), motion.error_mm
    assert motion.saturated_ticks == 0
    # It is tight: a plan that wasted the limit would pass as well.
    assert np.max(np.array(motion.error_mm) / machine.tracking_error_limit_mm) > 0.75
