"""The motion as ``trajectory_msgs/msg/JointTrajectory`` in YAML, in SI units as ROS 2 controllers expect."""

from __future__ import annotations

import io
from collections.abc import Iterable

from feedopt_core.units import NS_PER_S
from feedopt_tools.export.motion import Motion
from feedopt_tools.export.samples import rows_every

_METRES = 1e-3


def joint_trajectory_yaml(motion: Motion, period_s: float) -> str:
    """YAML text of the message, in m, m/s and m/s^2.

    ``ros2 topic pub --once TOPIC trajectory_msgs/msg/JointTrajectory "$(cat FILE)"`` sends it.

    Raises:
        ExportError: the period is not a multiple of the set-point period.
    """
    rows = rows_every(motion, period_s)
    text = io.StringIO()
    text.write("header:\n  stamp: {sec: 0, nanosec: 0}\n  frame_id: ''\n")
    text.write(f"joint_names: [{', '.join(_quoted(name) for name in motion.machine.axis_names)}]\npoints:\n")
    period_ns = round((motion.t_s[1] - motion.t_s[0]) * NS_PER_S / max(int(motion.tick[1] - motion.tick[0]), 1))
    for row in rows.tolist():
        seconds, nanoseconds = divmod(int(motion.tick[row] - motion.tick[0]) * period_ns, NS_PER_S)
        text.write(f"- positions: {_row(motion.position_mm[row])}\n")
        text.write(f"  velocities: {_row(motion.velocity_mm_s[row])}\n")
        text.write(f"  accelerations: {_row(motion.acceleration_mm_s2[row])}\n")
        text.write("  effort: []\n")
        text.write(f"  time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}\n")
    return text.getvalue()


def _row(values_mm: Iterable[float]) -> str:
    return "[" + ", ".join(_number(_METRES * float(value)) for value in values_mm) + "]"


def _number(value: float) -> str:
    """A number as YAML 1.1 reads it: with a decimal point, also before an exponent."""
    text = f"{value + 0.0:.12g}"
    mantissa, mark, exponent = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    if not mark:
        return mantissa
    return f"{mantissa}e{exponent if exponent[0] in '+-' else '+' + exponent}"


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"
