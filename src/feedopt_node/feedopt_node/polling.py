"""A thread of a node that calls a function at a constant rate, for example to read its subscriptions."""

from __future__ import annotations

import threading
from collections.abc import Callable

import rclpy

from feedopt_node.private_rclpy import RCLError


class PollingThread:
    """Calls a function at a constant rate until it is closed.

    Args:
        name: name of the thread.
        period_s: time between calls.
        poll: called from the thread.
        failed: called with an exception that ``poll`` raised; the thread then ends.
    """

    def __init__(
        self, name: str, period_s: float, poll: Callable[[], None], failed: Callable[[Exception], None]
    ) -> None:
        self._period_s = period_s
        self._poll = poll
        self._failed = failed
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Start polling."""
        self._thread.start()

    def close(self) -> None:
        """End the thread after its current call."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        try:
            while not self._stop.wait(self._period_s):
                self._poll()
        except Exception as error:  # noqa: BLE001 (passed to the node)
            # A signal can shut ROS down at any moment; calls of ROS then raise RCLError.
            if rclpy.ok() or not isinstance(error, RCLError):
                self._failed(error)
