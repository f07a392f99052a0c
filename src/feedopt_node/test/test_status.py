"""Which of several instances of a node counts, and when a second graph must give way."""

from __future__ import annotations

import pytest

from feedopt_msgs.msg import NodeStatus
from feedopt_node.errors import SecondGraphError
from feedopt_node.status import SILENCE_S, PeerStatuses


def status(node: str, instance: int, state: int = NodeStatus.READY) -> NodeStatus:
    return NodeStatus(node=node, instance=instance, state=state)


@pytest.fixture
def peers() -> PeerStatuses:
    return PeerStatuses("planner", 100)


def test_the_latest_status_of_a_node_is_kept(peers: PeerStatuses) -> None:
    assert peers.get("toolpath") is None
    assert peers.take(status("toolpath", 5), 0.0)
    assert peers.take(status("toolpath", 5, NodeStatus.RUNNING), 0.1)
    assert peers.get("toolpath").state == NodeStatus.RUNNING


def test_the_newer_of_two_instances_of_one_node_gives_way(peers: PeerStatuses) -> None:
    assert not peers.take(status("planner", 100), 0.0)
    assert not peers.take(status("planner", 101), 0.0)
    with pytest.raises(SecondGraphError, match="another planner already runs"):
        peers.take(status("planner", 99), 0.0)


def test_a_newer_instance_of_a_peer_counts_once_the_older_is_silent(peers: PeerStatuses) -> None:
    peers.take(status("toolpath", 5), 0.0)
    assert not peers.take(status("toolpath", 6), SILENCE_S - 0.1)
    assert peers.take(status("toolpath", 6), SILENCE_S + 0.1)
    assert peers.get("toolpath").instance == 6


def test_an_older_instance_of_a_peer_counts_at_once(peers: PeerStatuses) -> None:
    peers.take(status("toolpath", 6), 0.0)
    assert peers.take(status("toolpath", 5), 0.1)
    assert peers.get("toolpath").instance == 5


def test_silence_is_told_from_never_heard(peers: PeerStatuses) -> None:
    names = ("toolpath", "interpolator")
    assert peers.silent(names, 1e6) is None
    peers.take(status("toolpath", 5), 0.0)
    assert peers.silent(names, SILENCE_S - 0.1) is None
    assert peers.silent(names, SILENCE_S + 0.1) == "toolpath"
