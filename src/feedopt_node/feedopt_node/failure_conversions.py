"""Conversions between failures and messages.

Separate from ``conversions.py``, which imports the geometry of the core and needs 1.7 s of processor time for it. Every
node reports failures, also the recorder, which needs no geometry.
"""

from __future__ import annotations

import math
from typing import Any

from feedopt_core.errors import Failure, FailureKind
from feedopt_msgs.msg import Failure as FailureMessage
from feedopt_msgs.msg import NodeStatus

_TEXTS = ("message", "node", "source", "axis", "quantity")
_NUMBERS = ("line", "column")
_MAY_BE_NONE = ("s_mm", "ratio")
_KNOWN_KINDS = frozenset(FailureKind)


def failure_to_message(failure: Failure) -> FailureMessage:
    """Failure as a message; None becomes NaN."""
    message = FailureMessage(kind=int(failure.kind))
    for name in _TEXTS:
        setattr(message, name, str(getattr(failure, name)))
    for name in _NUMBERS:
        setattr(message, name, int(getattr(failure, name)))
    for name in _MAY_BE_NONE:
        value = getattr(failure, name)
        setattr(message, name, math.nan if value is None else float(value))
    return message


def failure_from_message(message: Any) -> Failure | None:
    """Failure of a message, live or recorded; None if nothing failed. An unknown kind becomes OTHER."""
    if message.kind == FailureMessage.NONE:
        return None
    fields: dict[str, Any] = {name: str(getattr(message, name)) for name in _TEXTS}
    fields |= {name: int(getattr(message, name)) for name in _NUMBERS}
    values = {name: float(getattr(message, name)) for name in _MAY_BE_NONE}
    fields |= {name: None if math.isnan(value) else value for name, value in values.items()}
    kind = FailureKind(message.kind) if message.kind in _KNOWN_KINDS else FailureKind.OTHER
    return Failure(kind=kind, **fields)


def failure_of_status(status: Any) -> Failure | None:
    """Cause of a FAULT, live or recorded; None in any other state. If the cause is missing, the text replaces it."""
    if status.state != NodeStatus.FAULT:
        return None
    return failure_from_message(status.failure) or Failure(kind=FailureKind.OTHER, message=str(status.text))
