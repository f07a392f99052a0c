"""Lines on their way to the reader: in order, nothing lost without an error."""

from __future__ import annotations

import pytest

from feedopt_core.errors import ToolpathError
from feedopt_planner.line_inbox import MOST_BLOCKS, LineInbox


def test_blocks_come_out_as_they_went_in() -> None:
    inbox = LineInbox()
    assert not inbox.ready
    inbox.put(1, ["G21", "G90"], last=False)
    inbox.put(2, ["G1 X1 F600"], last=True)
    assert [inbox.take(), inbox.sequence] == [["G21", "G90"], 1]
    assert [inbox.take(), inbox.sequence] == [["G1 X1 F600"], 2]
    assert inbox.ready
    assert inbox.take() is None


def test_what_comes_behind_the_last_block_is_not_read() -> None:
    inbox = LineInbox()
    inbox.put(1, ["G21"], last=True)
    inbox.put(2, ["G20"], last=True)
    assert inbox.take() == ["G21"]
    assert inbox.take() is None


@pytest.mark.parametrize("sequences", [(2,), (1, 3), (1, 1), (0,)])
def test_lost_block_is_an_error_behind_what_came_before(sequences: tuple[int, ...]) -> None:
    inbox = LineInbox()
    for sequence in sequences:
        inbox.put(sequence, ["G21"], last=False)
    for _ in sequences[:-1]:
        assert inbox.take() == ["G21"]
    assert inbox.ready
    with pytest.raises(ToolpathError, match="lines were lost"):
        inbox.take()


def test_a_sender_that_ignores_back_pressure_gets_an_error() -> None:
    inbox = LineInbox()
    for sequence in range(1, MOST_BLOCKS + 2):
        inbox.put(sequence, [], last=False)
    for _ in range(MOST_BLOCKS):
        assert inbox.take() == []
    with pytest.raises(ToolpathError, match="wait for the toolpath node"):
        inbox.take()
