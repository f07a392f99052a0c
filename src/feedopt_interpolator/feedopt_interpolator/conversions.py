"""Conversion of set points to messages, fast enough for 1 kHz, and of the interpolator's figures to diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from feedopt_core.motion.setpoints import SetpointBlock
from feedopt_core.units import NS_PER_S
from feedopt_msgs.msg import AxisSetpoint
from feedopt_node.conversions import doubles, time_message


class SetpointRows:
    """One block of set points, converted in advance so that a tick only fills one message."""

    def __init__(self, block: SetpointBlock) -> None:
        self.finished = block.finished
        self._axes = block.position_mm.shape[1]
        self._position_mm = doubles(block.position_mm)
        self._velocity_mm_s = doubles(block.velocity_mm_s)
        self._acceleration_mm_s2 = doubles(block.acceleration_mm_s2)
        self._tick = block.tick.tolist()
        self._chunk_sequence = block.chunk_sequence.tolist()
        self._s_mm = block.s_mm.tolist()
        self._v_mm_s = block.v_mm_s.tolist()

    def __len__(self) -> int:
        return len(self._tick)

    def fill(self, row: int, message: AxisSetpoint) -> None:
        """Write one set point into a message; program, sequence, stamp and lateness are the publisher's."""
        span = slice(row * self._axes, (row + 1) * self._axes)
        message.tick = self._tick[row]
        message.chunk_sequence = self._chunk_sequence[row]
        message.s_mm = self._s_mm[row]
        message.feedrate_mm_s = self._v_mm_s[row]
        message.position_mm = self._position_mm[span]
        message.velocity_mm_s = self._velocity_mm_s[span]
        message.acceleration_mm_s2 = self._acceleration_mm_s2[span]
        message.last = self.finished and row == len(self._tick) - 1


def stamp(message: AxisSetpoint, due_ns: int) -> None:
    """Write the wall-clock deadline of a set point, ns since the epoch, into the existing stamp of the message."""
    message.stamp.sec = due_ns // NS_PER_S
    message.stamp.nanosec = due_ns % NS_PER_S


def diagnostics(figures: dict[str, str], now_ns: int) -> DiagnosticArray:
    """Figures of the interpolator, by name, as diagnostics."""
    status = DiagnosticStatus(
        level=DiagnosticStatus.OK,
        name="interpolator",
        message="ticks",
        values=[KeyValue(key=key, value=value) for key, value in figures.items()],
    )
    array = DiagnosticArray(status=[status])
    array.header.stamp = time_message(now_ns)
    return array
