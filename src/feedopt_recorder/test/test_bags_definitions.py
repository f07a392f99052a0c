"""Message definitions that changed since a bag was made: migrated by a rule or refused by name, never misread."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from recorded_run import SOURCE, TOPICS, messages, schemas, typestore, write_run
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

pytest.importorskip("feedopt_msgs.msg")

from feedopt_core.errors import Failure, FailureKind
from feedopt_recorder.bag_writer import BagWriter
from feedopt_recorder.bags import definitions as module
from feedopt_recorder.bags.conversions import status_from_message
from feedopt_recorder.bags.definitions import MIGRATIONS, migrated, migration
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.errors import BagDefinitionError, BagForeignError
from feedopt_recorder.message_schemas import MessageSchemas

SETPOINT, SEGMENT = "feedopt_msgs/msg/AxisSetpoint", "feedopt_msgs/msg/ToolpathSegment"
STATUS = "feedopt_msgs/msg/NodeStatus"
OLD_FIELDS = {
    "feedopt_msgs/msg/ToolpathSegment": ("dwell_s", "rapid", "events"),
    "feedopt_msgs/msg/FeedProfileChunk": ("dwell_s", "solver"),
    STATUS: ("failure",),
}


def definition(tmp_path: Path, type_name: str) -> str:
    return schemas(tmp_path).schema(type_name)


def without(text: str, *names: str) -> str:
    for name in names:
        text, count = re.subn(rf"(?m)^\S+ {name}\b.*\n", "", text)
        assert count == 1, name
    return text


@pytest.mark.parametrize("type_name", sorted(topic.type for topic in TOPICS))
def test_definitions_of_the_source_tree_agree_with_the_installed_classes(tmp_path: Path, type_name: str) -> None:
    text = definition(tmp_path, type_name)
    assert migration(get_types_from_msg(text, type_name), type_name) is None


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("float64 s_mm ", "float32 s_mm ", "its field s_mm is float, here it is double"),
        ("float64[] position_mm", "float64[3] position_mm", r"its field position_mm is double\[3\]"),
        ("float64 s_mm ", "float64 s_m ", "it has s_m and it lacks s_mm"),
        ("bool last ", "bool last \nuint8 mode ", "it has mode"),
        ("builtin_interfaces/Time stamp", "builtin_interfaces/Duration stamp", "its field stamp is"),
    ],
)
def test_any_other_definition_is_refused_by_name(tmp_path: Path, old: str, new: str, named: str) -> None:
    text = definition(tmp_path, SETPOINT)
    assert old in text
    changed = text.replace(old, new, 1)
    changed += f"\n{'=' * 80}\nMSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n"
    with pytest.raises(BagDefinitionError, match=named) as caught:
        migration(get_types_from_msg(changed, SETPOINT), SETPOINT)
    assert SETPOINT in str(caught.value)


def test_constant_with_another_value_is_refused(tmp_path: Path) -> None:
    text = definition(tmp_path, SEGMENT)
    assert "uint8 ARC=1" in text
    with pytest.raises(BagDefinitionError, match="its constant ARC is 7, here it is 1"):
        migration(get_types_from_msg(text.replace("uint8 ARC=1", "uint8 ARC=7"), SEGMENT), SEGMENT)


def test_type_that_is_not_installed_is_named() -> None:
    with pytest.raises(BagDefinitionError, match="nosuch_msgs/msg/Nothing"):
        migration({}, "nosuch_msgs/msg/Nothing")


def old_share(tmp_path: Path) -> MessageSchemas:
    """The definitions before dwells, rapids, events and failures were carried."""
    schemas(tmp_path)
    for path in (SOURCE / "feedopt_msgs" / "msg").glob("*.msg"):
        text = without(path.read_text(), *OLD_FIELDS.get(f"feedopt_msgs/msg/{path.stem}", ()))
        target = tmp_path / "feedopt_msgs" / "msg" / path.name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)
    return MessageSchemas([tmp_path])


def test_bag_from_before_dwells_is_read(tmp_path: Path) -> None:
    old = old_share(tmp_path / "share")
    today, then = typestore(), get_typestore(Stores.ROS2_JAZZY)
    for name in OLD_FIELDS:
        then.register(get_types_from_msg(old.schema(name), name))
    older = {topic.name: topic.type for topic in TOPICS if topic.type in OLD_FIELDS}
    writer = BagWriter(tmp_path / "old", TOPICS, old)
    for message in messages(0.2):
        row = message.received()
        if message.topic in older:
            row = row._replace(payload=rewritten(today, then, older[message.topic], message.payload))
        writer.write([row])
    writer.close()
    run, new = read_bag(tmp_path / "old"), read_bag(write_run(tmp_path / "new", tmp_path / "share2", duration_s=0.2))
    assert [segment.place for segment in run.segments] == [segment.place for segment in new.segments]
    assert [chunk.dwell_s for chunk in run.chunks] == [0.0] * len(new.chunks)
    np.testing.assert_array_equal(run.chunks[0].profile.q_mm2_s2, new.chunks[0].profile.q_mm2_s2)
    assert run.statuses == new.statuses


def rewritten(today: Typestore, then: Typestore, name: str, payload: bytes) -> bytes:
    """A message as it was serialised before the fields were added."""
    message = today.deserialize_cdr(payload, name)
    values = {field: getattr(message, field) for field, _ in then.get_msgdef(name).fields}
    stamp = then.types["builtin_interfaces/msg/Time"](sec=message.stamp.sec, nanosec=message.stamp.nanosec)
    return bytes(then.serialize_cdr(then.types[name](**{**values, "stamp": stamp}), name))


def test_fault_from_before_failures_were_fields_is_what_its_text_said(tmp_path: Path) -> None:
    definitions = get_types_from_msg(old_share(tmp_path).schema(STATUS), STATUS)
    then = get_typestore(Stores.ROS2_JAZZY)
    then.register(definitions)
    values = {name: 0 for name, (node, _) in then.get_msgdef(STATUS).fields if node == Nodetype.BASE}
    stamp = then.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    text = "infeasible: axis X at s = 1.000 mm"
    for state, failure in ((4, Failure(kind=FailureKind.OTHER, message=text)), (3, None)):
        old = then.types[STATUS](**{**values, "stamp": stamp, "node": "planner", "state": state, "text": text})
        recorded = then.deserialize_cdr(then.serialize_cdr(old, STATUS), STATUS)
        row = status_from_message(*migrated(definitions, STATUS, [recorded]), 5)
        assert (row.failure, row.said) == (failure, text)


def test_machine_from_before_axis_maps(tmp_path: Path) -> None:
    rule = next(rule for (name, *_), rule in MIGRATIONS.items() if name.endswith("/Machine"))

    class Recorded:
        coordinate = np.array([0, 0, 1, 2], np.uint8)

    recorded = Recorded()
    rule(recorded)
    np.testing.assert_array_equal(np.reshape(recorded.axis_map, (4, 3)), [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def test_messages_without_a_difference_are_left_alone(tmp_path: Path) -> None:
    types = get_types_from_msg(definition(tmp_path, SETPOINT), SETPOINT)
    rows = [object()]
    assert migrated(types, SETPOINT, rows) is rows


def test_samples_of_another_definition_are_refused_by_read_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = write_run(tmp_path / "run", tmp_path / "share", duration_s=0.1)
    real = module._installed_class

    class WithForce:
        @staticmethod
        def get_fields_and_field_types() -> dict[str, str]:
            return {**real("feedopt_msgs/msg/AxisState").get_fields_and_field_types(), "force_n": "double"}

    monkeypatch.setattr(
        module, "_installed_class", lambda name: WithForce if name.endswith("AxisState") else real(name)
    )
    with pytest.raises(BagForeignError, match=r"feedopt_msgs/msg/AxisState.*it lacks force_n"):
        read_bag(bag)
