"""Check of the sequence of a stream: 1, 2, 3, ... within each program; a gap is an error."""

from __future__ import annotations

from feedopt_node.errors import SequenceGapError


class SequenceCheck:
    """Checks program and sequence number of one input topic.

    A message with sequence 1 always opens a program. After an error or the end of a program, its remaining messages are
    skipped.
    """

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._program_id = 0
        self._sequence = 0
        self._open = False

    @property
    def program_id(self) -> int:
        """Program of the latest message that was accepted; 0 before the first."""
        return self._program_id

    def starts_program(self, program_id: int, sequence: int) -> bool:
        """Whether this message opens a program."""
        return sequence == 1 and (not self._open or program_id != self._program_id)

    def accept(self, program_id: int, sequence: int) -> bool:
        """Compare a message with the previous one; False: its program is closed, skip the message.

        Raises:
            SequenceGapError: a message is missing. The program is then closed.
        """
        if self.starts_program(program_id, sequence):
            self._program_id, self._sequence, self._open = program_id, 1, True
            return True
        if program_id == self._program_id and not self._open:
            return False
        expected = self._sequence + 1 if program_id == self._program_id else 1
        if program_id != self._program_id or sequence != expected:
            self._program_id, self._open = program_id, False
            raise SequenceGapError(
                f"{self._topic}: program {program_id} has sequence {sequence}, expected {expected}: "
                "a message was lost, execute the program again"
            )
        self._sequence = sequence
        return True

    def close(self) -> None:
        """Skip the remaining messages of the program."""
        self._open = False
