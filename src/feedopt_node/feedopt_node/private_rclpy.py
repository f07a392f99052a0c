"""The one file that uses parts of rclpy outside its documentation. What it relies on stands in its test, by name.

- ``RCLError`` is what every call of rclpy raises once a signal has shut ROS down. It has no public name.
- ``handle.take_message`` takes a message without an executor. Waking one costs 250 us a message, taking one 40 us: at
  1 kHz that decides whether a node keeps up. With ``raw`` it gives the CDR bytes, and the stamps of the middleware.
- ``handle.call_timer`` starts the next period of a timer that no executor calls.
- An executor asks the callback group of an entity before it waits for it; a group that refuses keeps it asleep.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription
from rclpy.timer import Timer

RCLError: type[Exception] = rclpy_implementation.RCLError


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


def take_all(subscription: Subscription, *, raw: bool = False) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Messages that have arrived, in order, each with what the middleware says of it.

    Args:
        subscription: of a :class:`PolledGroup`.
        raw: the CDR bytes in place of the message.
    """
    while True:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, raw)
        if taken is None:
            return
        yield taken


def call_if_due(timer: Timer) -> None:
    """Call a timer of a :class:`PolledGroup` whose period has passed."""
    if not timer.is_canceled() and timer.is_ready():
        with timer.handle:
            timer.handle.call_timer()
        timer.callback()
