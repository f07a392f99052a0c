"""What feedopt relies on in rclpy outside its documentation: another version that lacks any of it fails here."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from feedopt_msgs.msg import ProgramLines
from feedopt_node.private_rclpy import PolledGroup, RCLError, call_if_due, take_all

SOURCE = Path(__file__).resolve().parents[2]
PATIENCE_S = 30.0


@pytest.fixture
def node() -> Iterator[Node]:
    context = Context()
    rclpy.init(context=context)
    node = Node("private", context=context)
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=context)


def wait_for(condition: Callable[[], bool]) -> None:
    until_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.001)


@pytest.mark.parametrize(
    ("owner", "name"),
    [
        (rclpy_implementation, "RCLError"),
        (rclpy_implementation.Subscription, "take_message"),
        (rclpy_implementation.Subscription, "__enter__"),
        (rclpy_implementation.Timer, "call_timer"),
        (rclpy_implementation.Timer, "__enter__"),
        (Subscription, "handle"),
        (Timer, "handle"),
        (Timer, "is_ready"),
        (CallbackGroup, "can_execute"),
        (CallbackGroup, "beginning_execution"),
        (CallbackGroup, "ending_execution"),
        (Executor, "can_execute"),
    ],
)
def test_rclpy_has(owner: object, name: str) -> None:
    assert hasattr(owner, name)


def test_no_other_file_uses_them() -> None:
    private = ("rclpy.impl", ".take_message", ".call_timer", "rclpy._")
    users = {
        path.relative_to(SOURCE).as_posix()
        for path in SOURCE.glob("*/*/**/*.py")
        if "test" not in path.relative_to(SOURCE).parts
        and any(name in path.read_text(encoding="utf-8") for name in private)
    }
    assert users == {"feedopt_node/feedopt_node/private_rclpy.py"}


def test_messages_are_taken_in_order_with_what_the_middleware_says(node: Node) -> None:
    calls: list[object] = []
    subscriptions = [
        node.create_subscription(ProgramLines, "lines", calls.append, 10, raw=raw, callback_group=PolledGroup())
        for raw in (False, True)
    ]
    publisher = node.create_publisher(ProgramLines, "lines", 10)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    wait_for(lambda: publisher.get_subscription_count() == len(subscriptions))
    sent = [ProgramLines(sequence=number, lines=[f"G1 X{number}"]) for number in (1, 2, 3)]
    for message in sent:
        publisher.publish(message)
    taken: list[list[tuple[object, dict[str, int]]]] = [[], []]

    def all_taken() -> bool:
        executor.spin_once(timeout_sec=0.0)
        for subscription, found in zip(subscriptions, taken, strict=True):
            found.extend(take_all(subscription, raw=subscription.raw))
        return all(len(found) == len(sent) for found in taken)

    wait_for(all_taken)
    assert [message for message, _ in taken[0]] == sent
    assert [payload for payload, _ in taken[1]] == [serialize_message(message) for message in sent]
    for _, info in taken[1]:
        assert 0 < info["source_timestamp"] <= info["received_timestamp"]
    numbers = [info["publication_sequence_number"] for _, info in taken[1]]
    assert numbers == list(range(numbers[0], numbers[0] + len(sent)))
    assert not calls


def test_a_timer_is_called_once_a_period_and_not_after_its_end(node: Node) -> None:
    group = PolledGroup()
    calls: dict[str, int] = {"ended": 0, "going on": 0}

    def count(name: str) -> Callable[[], None]:
        return lambda: calls.update({name: calls[name] + 1})

    timers = [node.create_timer(0.01, count(name), callback_group=group) for name in calls]

    def called(name: str, times: int) -> bool:
        for timer in timers:
            call_if_due(timer)
        return calls[name] >= times

    wait_for(lambda: called("ended", 2))
    timers[0].cancel()
    ended = calls["ended"]
    later = calls["going on"] + 2
    wait_for(lambda: called("going on", later))
    assert calls["ended"] == ended


def test_what_is_published_after_the_end_of_ros_is_an_rcl_error(node: Node) -> None:
    publisher = node.create_publisher(ProgramLines, "ended", 1)
    rclpy.shutdown(context=node.context)
    with pytest.raises(RCLError):
        publisher.publish(ProgramLines())
