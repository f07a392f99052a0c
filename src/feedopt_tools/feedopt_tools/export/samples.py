"""Set points and states as tables: CSV, NPZ and Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import TextIO

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_recorder.bags.run_data import RunData
from feedopt_tools.errors import ExportError
from feedopt_tools.export.motion import Motion

Table = dict[str, FloatArray]
_SPACE = ("x", "y", "z")


def rows_every(motion: Motion, period_s: float) -> IntArray:
    """Rows of a motion at a period, the last one always among them.

    Raises:
        ExportError: the period is no multiple of that of the set points.
    """
    own_s = motion.machine.period_s
    step = round(period_s / own_s)
    if step < 1 or abs(step * own_s - period_s) > 1e-9:
        raise ExportError(f"the period is {period_s:g} s, must be a multiple of the set points' {own_s:g} s")
    rows = np.arange(0, len(motion.tick), step)
    last = len(motion.tick) - 1
    return rows if rows[-1] == last else np.append(rows, last)


def setpoint_table(motion: Motion, period_s: float) -> Table:
    """Time, arc length, feedrate, tool and axes at a period. Raises ExportError, see :func:`rows_every`."""
    rows = rows_every(motion, period_s)
    table: Table = {
        "t_s": motion.t_s[rows],
        "s_mm": motion.s_mm[rows],
        "feedrate_mm_s": motion.feedrate_mm_s[rows],
    }
    tool_mm = motion.tool_mm[rows]
    for i in range(motion.machine.dimensions):
        table[f"tool_{_SPACE[i]}_mm"] = tool_mm[:, i]
    for axis, name in enumerate(motion.machine.axis_names):
        table[f"{name}_position_mm"] = motion.position_mm[rows, axis]
        table[f"{name}_velocity_mm_s"] = motion.velocity_mm_s[rows, axis]
        table[f"{name}_acceleration_mm_s2"] = motion.acceleration_mm_s2[rows, axis]
    return table


def state_table(run: RunData) -> Table:
    """States of the axes as they were recorded.

    Raises:
        ExportError: the bag holds none.
    """
    states = run.states
    if not len(states):
        raise ExportError(f"{run.path}: holds no states of program {run.program_id} on /axis_state")
    table: Table = {
        "t_s": states.t_s,
        "tick": states.tick.astype(np.float64),
        "sequence": states.sequence.astype(np.float64),
        "stamp_s": np.asarray(states.stamp_ns * 1e-9, dtype=np.float64),
    }
    for axis, name in enumerate(run.axis_names):
        table[f"{name}_reference_mm"] = states.reference_mm[:, axis]
        table[f"{name}_position_mm"] = states.position_mm[:, axis]
        table[f"{name}_velocity_mm_s"] = states.velocity_mm_s[:, axis]
        table[f"{name}_tracking_error_mm"] = states.tracking_error_mm[:, axis]
        table[f"{name}_control_signal_volts"] = states.control_signal_volts[:, axis]
        table[f"{name}_saturated"] = states.saturated[:, axis].astype(np.float64)
    return table


def write_csv(file: TextIO, table: Table) -> None:
    """Write a table with 15 significant digits. Raises OSError."""
    np.savetxt(
        file, np.column_stack(list(table.values())), fmt="%.15g", delimiter=",", header=",".join(table), comments=""
    )


def write_npz(path: Path, table: Table) -> None:
    """Write a table as arrays by name. Raises OSError."""
    with path.open("wb") as file:
        np.savez_compressed(file, **table)  # type: ignore[arg-type]


def write_parquet(path: Path, table: Table) -> None:
    """Write a table as Parquet. Raises OSError, or ModuleNotFoundError where pyarrow is not installed."""
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(table), path)
