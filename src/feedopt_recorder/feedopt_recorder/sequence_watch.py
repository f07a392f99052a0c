"""Counts messages and finds gaps in their sequence numbers while they pass by, without deserialising them."""

from __future__ import annotations

import re
import struct
from dataclasses import asdict, dataclass, field

# Gaps kept one by one; beyond that only their number grows, so that a broken transport cannot fill the memory.
GAPS_KEPT = 100
# CDR header (4 bytes), stamp (8), program_id (uint32), padding to 8, sequence (uint64), little endian.
_IDENTITY = struct.Struct("<12xI4xQ")
_IDENTITY_FIELDS = ["builtin_interfaces/Time stamp", "uint32 program_id", "uint64 sequence"]
_LITTLE_ENDIAN = 1


def has_identity(schema_text: str) -> bool:
    """Whether a message starts with stamp, program_id and sequence, so that its gaps can be seen from outside."""
    lines = (re.sub(r"\s+", " ", line.split("#", 1)[0]).strip() for line in schema_text.splitlines())
    fields = [line for line in lines if line and "=" not in line]
    return fields[:3] == _IDENTITY_FIELDS


@dataclass(frozen=True)
class Gap:
    """Sequence numbers ``first`` to ``last`` of one program that never came; ``last < first``: a number came again.

    Program 0: the numbers are those of the middleware.
    """

    topic: str
    program_id: int
    first: int
    last: int


@dataclass
class TopicCount:
    """What passed by on one topic."""

    messages: int = 0
    payload_bytes: int = 0
    missing: int = 0
    repeated: int = 0
    programs: dict[int, int] = field(default_factory=dict)


class SequenceWatch:
    """Counts and gaps of one topic.

    Args:
        topic: its name.
        identified: its messages carry program_id and sequence (:func:`has_identity`).
        numbered: it has one publisher, so that the numbers the middleware gives tell of gaps where nothing else does.
    """

    def __init__(self, topic: str, *, identified: bool, numbered: bool = False) -> None:
        self.topic = topic
        self.count = TopicCount()
        self.gaps: list[Gap] = []
        self._identified = identified
        self._numbered = numbered
        self._expected = 1
        self._program_id = -1

    def add(self, payload: bytes, number: int = 0) -> None:
        """Take note of one message, in the order of arrival. Sequence numbers of a program start at 1.

        Args:
            payload: its CDR bytes.
            number: what the middleware counted it as; 0: it does not count.
        """
        count = self.count
        count.messages += 1
        count.payload_bytes += len(payload)
        if not self._identified or payload[1] != _LITTLE_ENDIAN:
            if self._numbered and number:
                if number != self._expected:
                    self._note_gap(0, number)
                self._expected = number + 1
            return
        program_id, sequence = _IDENTITY.unpack_from(payload)
        if program_id != self._program_id:
            self._program_id = program_id
            self._expected = count.programs.setdefault(program_id, 0) + 1
        if sequence != self._expected:
            self._note_gap(program_id, sequence)
        if sequence >= self._expected:
            self._expected = sequence + 1
            count.programs[program_id] = sequence

    def _note_gap(self, program_id: int, sequence: int) -> None:
        if sequence > self._expected:
            self.count.missing += sequence - self._expected
        else:
            self.count.repeated += 1
        if len(self.gaps) < GAPS_KEPT:
            self.gaps.append(Gap(self.topic, program_id, self._expected, sequence - 1))


@dataclass(frozen=True)
class RecorderSummary:
    """What a recorder recorded and what it missed.

    Attributes:
        topics: counts by topic; ``programs`` maps a program to the last sequence number seen of it.
        gaps: the first hundred gaps of every topic.
        duration_s: from the start of the recording to its end.
        cpu_share_ratio: processor time over that duration, of one core.
        failure: why the recording broke off; empty when it did not.
    """

    topics: dict[str, TopicCount]
    gaps: tuple[Gap, ...]
    duration_s: float
    cpu_share_ratio: float
    failure: str = ""

    @property
    def complete(self) -> bool:
        """Nothing was lost and nothing failed."""
        return not self.failure and not any(count.missing or count.repeated for count in self.topics.values())

    def as_document(self) -> dict[str, object]:
        """The summary as JSON types."""
        return {"complete": self.complete, **asdict(self)}
