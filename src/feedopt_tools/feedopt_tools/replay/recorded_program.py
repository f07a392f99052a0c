"""One recorded program with all inputs of its stages: messages, parameters, machine file, program text."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import yaml

from feedopt_core.machine.machine_file import Machine, parse_machine
from feedopt_core.schema import DataclassInstance, build
from feedopt_recorder.bags.definitions import migrated, migration
from feedopt_recorder.bags.messages import BagContents, TopicMessages, read_messages
from feedopt_recorder.errors import BagEmptyError, BagForeignError
from feedopt_tools.errors import ReplayInputError
from feedopt_tools.replay.columns import Columns, columns_of, columns_of_arrays

P = TypeVar("P", bound=DataclassInstance)
IDENTIFIED = ("/toolpath", "/feed_profile", "/axis_setpoint", "/axis_state")
"""Topics whose messages say which program they belong to."""


@dataclass(frozen=True)
class ProgramText:
    """A recorded program. Tolerance 0: the parameter of the toolpath node holds. Reach 0: no layer transitions."""

    name: str
    text: str
    tolerance_mm: float
    transition_reach_mm: float = 0.0
    transition_side: str = ""


class RecordedProgram:
    """The only program of a bag.

    Raises:
        BagError: the bag cannot be read, or its message definitions are unknown to this version.
        ReplayInputError: it holds several programs.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._contents: BagContents = read_messages(path)
        self._objects: dict[str, list[Any]] = {}
        self._columns: dict[str, Columns] = {}
        for topic in self._contents.topics.values():
            if topic.type_name.startswith("feedopt_msgs/"):
                migration(topic.definitions, topic.type_name)
        ids = {int(number) for name in IDENTIFIED for number in set(self.columns(name).values.get("program_id", ()))}
        if not ids:
            raise BagEmptyError(f"{path}: no program was run while this bag was recorded")
        if len(ids) > 1:
            raise ReplayInputError(
                f"{path}: holds {len(ids)} programs; a bag is replayed with one, as feedopt run records it"
            )
        self.program_id = ids.pop()

    @property
    def topics(self) -> frozenset[str]:
        """Topics with messages."""
        return frozenset(name for name, topic in self._contents.topics.items() if len(topic))

    def messages(self, topic: str) -> Sequence[Any]:
        """Messages of one topic, migrated to the definitions of this version."""
        found = self._contents.topics.get(topic)
        if found is None:
            return []
        # Columns hold the messages as recorded: build them before the migration changes the messages.
        self.columns(topic)
        if topic not in self._objects:
            self._objects[topic] = found.objects()
        return migrated(found.definitions, found.type_name, self._objects[topic])

    def columns(self, topic: str) -> Columns:
        """Messages of one topic as they were recorded, field by field."""
        if topic not in self._columns:
            found = self._contents.topics.get(topic)
            self._columns[topic] = Columns() if found is None or not len(found) else self._read_columns(found)
        return self._columns[topic]

    def parameters(self, node: str, kind: type[P]) -> P:
        """Parameters of a node as recorded, as an object of their dataclass.

        Raises:
            ReplayInputError: not recorded.
            ConfigError: this version does not accept a recorded value.
        """
        known = {entry.name for entry in fields(kind)}
        values = {key: value for key, value in self.node_parameters(node).items() if key in known}
        return build(kind, values, f"{self.path}: recorded parameters of {node}")

    def node_parameters(self, node: str) -> dict[str, Any]:
        """All parameters that a node was started with. Raises ReplayInputError."""
        try:
            document = yaml.safe_load(self._record("feedopt/parameters", node))
            values = document[node]["ros__parameters"]
        except (yaml.YAMLError, TypeError, KeyError) as error:
            raise ReplayInputError(
                f"{self.path}: the recorded parameters of {node} cannot be read as a parameter file: {error!r}"
            ) from error
        return dict(values)

    def number(self, node: str, name: str) -> float:
        """One numeric parameter of a node. Raises ReplayInputError."""
        value = self.node_parameters(node).get(name)
        if not isinstance(value, (int, float)):
            raise ReplayInputError(f"{self.path}: the recorded parameter {name} of {node} is missing or not a number")
        return float(value)

    @property
    def nodes(self) -> frozenset[str]:
        """Nodes whose parameters were recorded."""
        return frozenset(self._contents.metadata.get("feedopt/parameters", {}))

    @property
    def machine_yaml(self) -> str:
        """The machine file as loaded. Raises ReplayInputError."""
        return self._record("feedopt/machine", "yaml")

    def machine(self) -> Machine:
        """The machine of the run. Raises ReplayInputError, ConfigError."""
        return parse_machine(self.machine_yaml, f"{self.path}: recorded machine")

    def write_machine(self, folder: Path) -> Path:
        """Write the machine file of the run into a folder. Raises ReplayInputError."""
        path = folder / "machine.yaml"
        path.write_text(self.machine_yaml, encoding="utf-8")
        return path

    def program(self) -> ProgramText:
        """The program that was executed. Raises ReplayInputError."""
        tolerance_mm = 0.0
        with suppress(ValueError):
            tolerance_mm = float(self._record("feedopt/program", "tolerance_mm"))
        # Bags recorded before layer transitions existed have no such entries.
        record = self._contents.metadata.get("feedopt/program", {})
        return ProgramText(
            self._record("feedopt/program", "name"),
            self._record("feedopt/program", "text"),
            tolerance_mm,
            float(record.get("transition_reach_mm", "0")),
            record.get("transition_side", ""),
        )

    def _record(self, name: str, key: str) -> str:
        try:
            return self._contents.metadata[name][key]
        except KeyError as error:
            raise ReplayInputError(
                f"{self.path}: has no record {name} with {key}, which a replay needs; record it with feedopt run"
            ) from error

    def _read_columns(self, topic: TopicMessages) -> Columns:
        # Messages of one fixed layout are read at once, others one by one.
        with suppress(BagForeignError):
            arrays = topic.columns()
            return columns_of_arrays(arrays, len(topic))
        self._objects[topic.name] = topic.objects()
        return columns_of(self._objects[topic.name])
