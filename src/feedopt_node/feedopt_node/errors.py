"""Errors of the nodes; their base class is the FeedoptError of the core."""

from __future__ import annotations

from feedopt_core.errors import FailureKind, FeedoptError


class SecondGraphError(FeedoptError):
    """Another graph already runs on this ROS domain; the message names the node and the remedy."""

    kind = FailureKind.SECOND_GRAPH


class SequenceGapError(FeedoptError):
    """A message of a stream is missing; the message names the topic and both sequence numbers."""

    kind = FailureKind.SEQUENCE_GAP
