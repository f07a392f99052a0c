"""Failures over the wire and back, and that no package hands them on in any other way."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rclpy.serialization import deserialize_message, serialize_message

from feedopt_core.errors import Failure, FailureKind
from feedopt_msgs.msg import Failure as FailureMessage
from feedopt_msgs.msg import NodeStatus
from feedopt_node.failure_conversions import failure_from_message, failure_of_status, failure_to_message

SOURCE = Path(__file__).resolve().parents[2]
FULL = Failure(
    kind=FailureKind.INFEASIBLE,
    message="raise jerk_limit_mm_s3",
    node="planner",
    source="pocket.ngc",
    line=4_000_000_000,
    column=7,
    axis="X",
    quantity="jerk",
    s_mm=12.5,
    ratio=1.0 / 3.0,
)


def over_the_wire(message: Any) -> Any:
    return deserialize_message(serialize_message(message), type(message))


@pytest.mark.parametrize("failure", [FULL, *(Failure(kind=kind, message="why") for kind in FailureKind)])
def test_round_trip(failure: Failure) -> None:
    assert failure_from_message(over_the_wire(failure_to_message(failure))) == failure


def test_the_numbers_of_the_kinds_are_those_of_the_message() -> None:
    text = (SOURCE / "feedopt_msgs" / "msg" / "Failure.msg").read_text(encoding="utf-8")
    numbers = {name: int(number) for name, number in re.findall(r"^uint8 (\w+)=(\d+)", text, re.MULTILINE)}
    assert numbers == {"NONE": 0, **FailureKind.__members__}


def test_a_blank_message_is_no_failure_and_a_strange_kind_is_other() -> None:
    assert failure_from_message(over_the_wire(FailureMessage())) is None
    strange = failure_from_message(over_the_wire(FailureMessage(kind=250, message="from tomorrow")))
    assert strange is not None
    assert (strange.kind, strange.message) == (FailureKind.OTHER, "from tomorrow")


def test_a_status_tells_its_failure_in_a_fault_alone() -> None:
    message = failure_to_message(FULL)
    assert failure_of_status(NodeStatus(state=NodeStatus.FAULT, failure=message)) == FULL
    assert failure_of_status(NodeStatus(state=NodeStatus.DONE, failure=message)) is None
    bare = NodeStatus(state=NodeStatus.FAULT, text="no cause but this")
    assert failure_of_status(bare) == Failure(kind=FailureKind.OTHER, message="no cause but this")


def test_the_recorder_reports_failures_without_the_geometry() -> None:
    program = "import sys, feedopt_recorder.recorder_node; print('numba' in sys.modules, 'scipy' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert result.stdout.split() == ["False", "False"]


def test_no_text_is_parsed_for_a_failure() -> None:
    """Texts of statuses and failures are only shown: nothing compares, splits or searches them."""
    parsed = re.compile(
        r"(?:status|failure|fault|outcome|error)\.(?:text|message)\.(?:startswith|removeprefix|split|partition|find)"
    )
    prefixed = re.compile(r"_PREFIX\b|(?:startswith|removeprefix)\(.*(?:infeasible|program|internal)")
    found = [
        f"{path.relative_to(SOURCE)}: {line.strip()}"
        for path in SOURCE.glob("*/*/**/*.py")
        if "test" not in path.relative_to(SOURCE).parts
        for line in path.read_text(encoding="utf-8").splitlines()
        if parsed.search(line) or prefixed.search(line)
    ]
    assert found == []
