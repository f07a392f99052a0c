"""The thread that publishes one set point per period, at absolute deadlines."""

from __future__ import annotations

import gc
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from rclpy.duration import Duration
from rclpy.publisher import Publisher

from feedopt_core.units import NS_PER_S
from feedopt_interpolator.conversions import SetpointRows, stamp
from feedopt_interpolator.program_motion import ProgramMotion
from feedopt_interpolator.real_time import request_real_time_priority, sleep_until
from feedopt_interpolator.setpoint_buffer import SetpointBuffer
from feedopt_msgs.msg import AxisSetpoint

# Longest time for which another thread holds the interpreter lock while ticks are published.
SWITCH_INTERVAL_S = 5e-5
START_DELAY_NS = 5_000_000
DELIVERY_PATIENCE_S = 2.0


@dataclass
class Lateness:
    """Lateness of the ticks of one program, s, and the number of ticks that were late by a whole period or more."""

    values_s: list[float] = field(default_factory=list)
    missed_ticks: int = 0

    def figures(self) -> dict[str, str]:
        """Count, percentiles and misses by name."""
        if not self.values_s:
            return {"ticks": "0", "missed_ticks": "0"}
        p50, p99, largest = np.percentile(self.values_s, [50, 99, 100])
        return {
            "ticks": str(len(self.values_s)),
            "missed_ticks": str(self.missed_ticks),
            "lateness_p50_s": f"{p50:.6f}",
            "lateness_p99_s": f"{p99:.6f}",
            "lateness_max_s": f"{largest:.6f}",
        }


@dataclass(frozen=True)
class TickEvents:
    """Callbacks of the tick threads.

    Attributes:
        ended: the last set point of a program was delivered, or the program had no set point.
        failed: its set points cannot be computed or sent.
        starved: it stops because the next chunk did not arrive in time.
    """

    ended: Callable[[ProgramMotion, Lateness], None]
    failed: Callable[[ProgramMotion, Exception], None]
    starved: Callable[[ProgramMotion], None]


class TickThread:
    """Publishes the set points of one program after the other.

    Every tick is published; a late one at once. Positions depend on the tick index, never on the clock.

    Attributes:
        sequence: sequence of the last set point published.
        s_mm: arc length of that set point.
        missed_ticks: ticks of the program that were late by a whole period or more.
        priority_remark: cause of a refused real-time priority; empty: it was granted.
    """

    def __init__(self, publisher: Publisher, period_s: float, priority: int, events: TickEvents) -> None:
        self.sequence = 0
        self.s_mm = 0.0
        self.missed_ticks = 0
        self.priority_remark = ""
        self._publisher = publisher
        self._period_ns = round(period_s * NS_PER_S)
        self._priority = priority
        self._events = events
        self._motion: ProgramMotion | None = None
        self._changed = threading.Condition()
        self._closing = False
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ticks", daemon=True)

    def start(self) -> None:
        """Start the thread; returns when it runs and its priority is set."""
        self._thread.start()
        self._started.wait()

    def play(self, motion: ProgramMotion) -> None:
        """Publish the set points of this program next."""
        with self._changed:
            self._motion = motion
            self._changed.notify_all()

    def close(self) -> None:
        """End the thread; a program in motion is interrupted."""
        with self._changed:
            self._closing = True
            if self._motion is not None:
                self._motion.abandon()
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        self.priority_remark = request_real_time_priority(self._priority)
        self._started.set()
        while (motion := self._next_motion()) is not None:
            lateness = Lateness()
            try:
                self._play(motion, lateness)
                # DONE means that every set point has been delivered, not only sent.
                self._publisher.wait_for_all_acked(Duration(seconds=DELIVERY_PATIENCE_S))
            # Any error with the set points is a FAULT of the program and must not end the node.
            except Exception as error:  # noqa: BLE001
                self._events.failed(motion, error)
            else:
                self._events.ended(motion, lateness)

    def _next_motion(self) -> ProgramMotion | None:
        with self._changed:
            self._changed.wait_for(lambda: self._motion is not None or self._closing)
            motion, self._motion = self._motion, None
            return None if self._closing else motion

    def _play(self, motion: ProgramMotion, lateness: Lateness) -> None:
        self.sequence, self.s_mm, self.missed_ticks = 0, 0.0, 0
        buffer = SetpointBuffer(motion, self._priority - 1, self._events.starved)
        buffer.start()
        switch_interval_s = sys.getswitchinterval()
        try:
            rows = buffer.take()
            gc.collect()
            gc.freeze()
            gc.disable()
            sys.setswitchinterval(SWITCH_INTERVAL_S)
            if rows is not None:
                self._tick(motion.program_id, buffer, rows, lateness)
        finally:
            sys.setswitchinterval(switch_interval_s)
            gc.enable()
            gc.unfreeze()
            buffer.close()

    def _tick(self, program_id: int, buffer: SetpointBuffer, rows: SetpointRows, lateness: Lateness) -> None:
        message = AxisSetpoint(program_id=program_id)
        first_ns = time.monotonic_ns() + START_DELAY_NS
        wall_offset_ns = time.time_ns() - time.monotonic_ns()
        current: SetpointRows | None = rows
        while current is not None and not self._closing:
            for row in range(len(current)):
                deadline_ns = first_ns + self.sequence * self._period_ns
                sleep_until(deadline_ns)
                late_ns = time.monotonic_ns() - deadline_ns
                current.fill(row, message)
                stamp(message, deadline_ns + wall_offset_ns)
                message.sequence = self.sequence + 1
                message.lateness_s = late_ns / NS_PER_S
                self._publisher.publish(message)
                self.sequence += 1
                self.s_mm = message.s_mm
                lateness.values_s.append(late_ns / NS_PER_S)
                if late_ns >= self._period_ns:
                    self.missed_ticks += 1
                    lateness.missed_ticks += 1
            current = buffer.take()
