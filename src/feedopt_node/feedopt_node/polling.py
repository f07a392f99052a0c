"""A thread of a node that calls a function at a steady rate, such as one that empties its subscriptions."""

from __future__ import annotations

import threading
from collections.abc import Callable

import rclpy

from feedopt_node.private_rclpy import RCLError


class PollingThread:
    """Calls a function at a steady rate until it is closed.

    Args:
        name: name of the thread.
        period_s: time between calls.
        poll: called from the thread.
        failed: called with an exception that ``poll`` raised; the thread ends then.
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
        """End the thread after the call it is in."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        try:
            while not self._stop.wait(self._period_s):
                self._poll()
        except Exception as error:  # noqa: BLE001 (handed on to the node)
            # A signal shuts ROS down at any moment; what the call was about to do with it then fails.
            if rclpy.ok() or not isinstance(error, RCLError):
                self._failed(error)
