"""Lines on their way out: all of them, in order, and no further ahead of the reader than agreed."""

from __future__ import annotations

import pytest

from feedopt_tools.execute.line_sender import BLOCK_LINES, BLOCKS_AHEAD, LineSender


class Sent:
    def __init__(self) -> None:
        self.blocks: list[tuple[int, list[str], bool]] = []

    def __call__(self, sequence: int, lines: list[str], last: bool) -> None:
        self.blocks.append((sequence, lines, last))


@pytest.mark.parametrize("count", [0, 1, BLOCK_LINES, BLOCK_LINES + 1, 7 * BLOCK_LINES])
def test_every_line_is_sent_once_and_the_end_is_marked(count: int) -> None:
    lines, sent = [f"X{index}" for index in range(count)], Sent()
    LineSender(lines, sent).send(0)
    assert [line for _, block, _ in sent.blocks for line in block] == lines
    assert [sequence for sequence, _, _ in sent.blocks] == list(range(1, len(sent.blocks) + 1))
    assert [last for _, _, last in sent.blocks] == [False] * (len(sent.blocks) - 1) + [True]


def test_sender_waits_for_the_reader() -> None:
    sent = Sent()
    sender = LineSender((f"X{index}" for index in range(3 * BLOCKS_AHEAD * BLOCK_LINES)), sent)
    sender.send(0)
    assert len(sent.blocks) == BLOCKS_AHEAD
    sender.send(0)
    assert len(sent.blocks) == BLOCKS_AHEAD
    sender.send(30)
    assert len(sent.blocks) == BLOCKS_AHEAD + 30
    sender.send(10_000)
    assert len(sent.blocks) == 3 * BLOCKS_AHEAD and sent.blocks[-1][2]
