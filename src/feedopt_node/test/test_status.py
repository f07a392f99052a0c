"""Which of several instances of a node counts, and when a second graph must give way."""

from __future__ import annotations

import pytest

from feedopt_msgs.msg import NodeStatus
from feedopt_node.errors import SecondGraphError
from feedopt_node.status import SILENCE_BEATS, PeerStatuses


def status(node: str, instance: int, state: int = NodeStatus.READY) -> NodeStatus:
    return NodeStatus(node=node, instance=instance, state=state)


def pass_beats(peers: PeerStatuses, count: int) -> None:
    for _ in range(count):
        peers.beat()


@pytest.fixture
def peers() -> PeerStatuses:
    return PeerStatuses("planner", 100)


def test_the_latest_status_of_a_node_is_kept(peers: PeerStatuses) -> None:
    assert peers.get("toolpath") is None
    assert peers.take(status("toolpath", 5))
    assert peers.take(status("toolpath", 5, NodeStatus.RUNNING))
    assert peers.get("toolpath").state == NodeStatus.RUNNING


def test_the_newer_of_two_instances_of_one_node_gives_way(peers: PeerStatuses) -> None:
    assert not peers.take(status("planner", 100))
    assert not peers.take(status("planner", 101))
    with pytest.raises(SecondGraphError, match="another planner already runs"):
        peers.take(status("planner", 99))


def test_a_newer_instance_of_a_peer_counts_once_the_older_is_silent(peers: PeerStatuses) -> None:
    peers.take(status("toolpath", 5))
    pass_beats(peers, SILENCE_BEATS - 1)
    assert not peers.take(status("toolpath", 6))
    pass_beats(peers, 1)
    assert peers.take(status("toolpath", 6))
    assert peers.get("toolpath").instance == 6


def test_an_older_instance_of_a_peer_counts_at_once(peers: PeerStatuses) -> None:
    peers.take(status("toolpath", 6))
    assert peers.take(status("toolpath", 5))
    assert peers.get("toolpath").instance == 5


def test_silence_differs_from_never_heard(peers: PeerStatuses) -> None:
    names = ("toolpath", "interpolator")
    pass_beats(peers, 10 * SILENCE_BEATS)
    assert peers.silent(names) is None
    peers.take(status("toolpath", 5))
    pass_beats(peers, SILENCE_BEATS)
    assert peers.silent(names) is None
    pass_beats(peers, 1)
    assert peers.silent(names) == "toolpath"
    peers.take(status("toolpath", 5))
    assert peers.silent(names) is None
