"""After the set-up no program waits for a compiler."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

# Programs of every kind and on 2 to 4 axes, then every kernel that was compiled for them in this process.
PLANS = """
import json, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from feedopt_core.config_files import find_config
from feedopt_core.machine.machine_file import load_machine
from feedopt_core.pipeline import warm_up
from feedopt_core.pipeline.plan_program import plan_program
from feedopt_core.pipeline.survey import survey_program
from feedopt_core.planner.stream_planner import PlannerParameters

def kernels():
    return {
        f"{name}.{key}": value
        for name, module in list(sys.modules.items()) if name.startswith("feedopt_core.")
        for key, value in vars(module).items()
        if isinstance(value, Dispatcher) and value.py_func.__module__ == name
    }

warm_up.warm_up()
warm = {name: set(kernel.stats.cache_misses) for name, kernel in kernels().items()}
for path in sorted(Path(sys.argv[1]).iterdir()):
    for machine in ("case_a", "router_simulation", "router_heng", "hbot"):
        plan_program(path, load_machine(machine), PlannerParameters())
    survey_program(path)
for method in ("lp", "oneshot"):
    plan_program(Path(sys.argv[1]) / "part.ngc", load_machine("case_a"), PlannerParameters(method=method))
found = kernels()
print(json.dumps({
    "kernels": len(found),
    "without code": [name for name, kernel in found.items() if not kernel._cache._cache_file._load_index()],
    "compiled": [
        f"{name}{signature}" for name, kernel in found.items()
        for signature in set(kernel.stats.cache_misses) - warm.get(name, set())
    ],
}))
"""
PART = """G21 G90 G64 P0.02 F1800
G1 X10 Y5
G1 X20
G3 X20 Y15 J5
G5.2 X22 Y16 P1 L3
X25 Y14 P1
X28 Y15 P1
G5.3
M2
"""
CURVE = """{"curves": [{"degree": 2, "knots": [0, 0, 0, 1, 1, 1], "weights": [1, 1, 1],
 "control_points_mm": [[0, 0], [5, 5], [10, 0]]}]}"""
DXF = "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n"
DXF += "0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n10\n0.0\n20\n0.0\n11\n10.0\n21\n0.0\n0\nENDSEC\n0\nEOF\n"


def test_no_kernel_is_compiled_after_the_warm_up(tmp_path: Path) -> None:
    short = "".join(f"X{0.1 * k:.3f} Y{0.004 * k * (k % 40):.3f}\n" for k in range(1, 120))
    programs = {
        "part.ngc": PART,
        "short.ngc": f"G21 G90 F1800\nG1\n{short}M2\n",
        "curve.json": CURVE,
        "line.dxf": DXF,
        "points.csv": "0,0\n5,1\n9,4\n",
    }
    for name, text in programs.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    run = subprocess.run([sys.executable, "-c", PLANS, str(tmp_path)], check=True, capture_output=True, text=True)
    found = json.loads(run.stdout)
    assert found["kernels"] > 50
    assert found["without code"] == []
    assert found["compiled"] == []
