"""Order of the messages of a stream."""

from __future__ import annotations

import pytest

from feedopt_node.errors import SequenceGapError
from feedopt_node.sequence import SequenceCheck


@pytest.fixture
def check() -> SequenceCheck:
    return SequenceCheck("/toolpath")


def test_programs_follow_each_other(check: SequenceCheck) -> None:
    for program_id, sequence in [(1, 1), (1, 2), (1, 3), (2, 1), (2, 2)]:
        assert check.accept(program_id, sequence)
    assert check.program_id == 2


@pytest.mark.parametrize("sequence", [1, 2, 4, 9])
def test_a_gap_or_a_repeat_is_an_error(check: SequenceCheck, sequence: int) -> None:
    check.accept(1, 1)
    check.accept(1, 2)
    with pytest.raises(SequenceGapError, match=f"/toolpath: program 1 has sequence {sequence}, expected 3"):
        check.accept(1, sequence)


def test_a_program_that_begins_in_the_middle_is_an_error(check: SequenceCheck) -> None:
    with pytest.raises(SequenceGapError, match="expected 1"):
        check.accept(1, 5)


def test_after_an_error_the_rest_of_the_program_is_skipped(check: SequenceCheck) -> None:
    check.accept(1, 1)
    with pytest.raises(SequenceGapError):
        check.accept(1, 3)
    assert not check.accept(1, 4)
    assert check.accept(2, 1)


def test_a_closed_program_is_skipped_and_may_begin_again(check: SequenceCheck) -> None:
    check.accept(1, 1)
    check.close()
    assert not check.accept(1, 2)
    assert check.accept(1, 1)
