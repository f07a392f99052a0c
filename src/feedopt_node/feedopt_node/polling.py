"""Subscriptions that a thread of the node empties itself.

Waking an executor for a message costs 250 us, taking one 40 us: at 1 kHz that decides whether a node keeps up.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import rclpy
from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription


class PolledGroup(CallbackGroup):
    """Entities that no executor waits for."""

    def can_execute(self, entity: Any) -> bool:
        """Never: the node takes the messages itself."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never begins."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Never called: nothing here is executed."""


def take_all(subscription: Subscription) -> Iterator[Any]:
    """Messages that have arrived, in order."""
    while True:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, False)
        if taken is None:
            return
        yield taken[0]


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
            if rclpy.ok() or not isinstance(error, rclpy_implementation.RCLError):
                self._failed(error)
