"""The only file that uses undocumented parts of rclpy. Its test checks each of them by name.

- ``RCLError`` is raised by every call of rclpy after a signal has shut ROS down. It has no public name.
- ``handle.take_message`` takes a message without an executor. Waking the executor needs 250 us per message, taking a
  message 40 us. At 1 kHz this decides whether a node keeps up. With ``raw`` it returns the CDR bytes. It also returns
  the time stamps of the middleware.
- ``handle.call_timer`` starts the next period of a timer that no executor calls.
- An executor asks the callback group of an entity before it waits for the entity. If the group refuses, the executor
  does not wake up for it.
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
        """Always False: the node takes the messages itself."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Always False: no execution begins."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Not called, because nothing is executed."""


def take_all(subscription: Subscription, *, raw: bool = False) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Messages that have arrived, in order, each with the information of the middleware about it.

    Args:
        subscription: a subscription in a :class:`PolledGroup`.
        raw: return the CDR bytes instead of the message.
    """
    while True:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, raw)
        if taken is None:
            return
        yield taken


def call_if_due(timer: Timer) -> None:
    """Call a timer of a :class:`PolledGroup` if its period has passed."""
    if not timer.is_canceled() and timer.is_ready():
        with timer.handle:
            timer.handle.call_timer()
        timer.callback()
