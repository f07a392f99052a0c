"""``feedopt replay`` of bags that cannot be replayed, or differ; and of the same program on a running graph."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

pytest.importorskip("feedopt_msgs.msg")

from mcap.reader import make_reader

from feedopt_node.errors import SecondGraphError
from feedopt_node.graph import load_graph
from feedopt_recorder.mcap_writer import McapWriter
from feedopt_tools.command.main import main
from feedopt_tools.errors import ReplayInputError
from feedopt_tools.execute.domain_lock import DomainLock
from feedopt_tools.replay import live
from feedopt_tools.replay.recorded_program import RecordedProgram

BAG = Path(__file__).resolve().parents[1] / "bags" / "corners"
IDENTIFIED = ("/toolpath", "/feed_profile", "/axis_setpoint", "/axis_state")


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["replay", *map(str, arguments)])


class Edited:
    """A copy of the golden bag in which messages, records and definitions can be changed."""

    def __init__(self) -> None:
        with next(BAG.glob("*.mcap")).open("rb") as stream:
            reader = make_reader(stream)
            self.records = {record.name: dict(record.metadata) for record in reader.iter_metadata()}
            rows = list(reader.iter_messages(log_time_order=False))
        self.texts = {channel.topic: schema.data.decode() for schema, channel, _ in rows if schema}
        self.types = {channel.topic: schema.name for schema, channel, _ in rows if schema}
        self.messages = [(channel.topic, bytes(row.data), row.log_time) for _, channel, row in rows]

    def write(self, folder: Path) -> Path:
        bag = folder / "edited"
        bag.mkdir()
        with (bag / "edited_0.mcap").open("wb") as stream:
            writer = McapWriter(stream, "test")
            for name, values in self.records.items():
                writer.add_metadata(name, values)
            channels = {
                topic: writer.add_channel(topic, writer.add_schema(self.types[topic], text), {})
                for topic, text in self.texts.items()
            }
            for topic, payload, log_ns in self.messages:
                writer.add_message(channels[topic], payload, log_ns, log_ns, 0)
            writer.finish()
        return bag


@pytest.fixture
def edited() -> Edited:
    return Edited()


def test_copy_agrees(edited: Edited, tmp_path: Path) -> None:
    result = call(edited.write(tmp_path))
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("record", "key", "named"),
    [
        ("feedopt/parameters", "", "feedopt/parameters"),
        ("feedopt/parameters", "planner", ""),
        ("feedopt/machine", "", "feedopt/machine"),
        ("feedopt/program", "text", "feedopt/program with text"),
    ],
)
def test_missing_record_is_named(edited: Edited, tmp_path: Path, record: str, key: str, named: str) -> None:
    if key:
        del edited.records[record][key]
    else:
        del edited.records[record]
    result = call(edited.write(tmp_path))
    if named:
        assert result.exit_code == 2 and named in result.output and "feedopt run" in result.output
    else:
        # A node without parameters was not in the graph: its stage is left out.
        assert result.exit_code == 0 and "planner" not in result.output.partition("messages of")[2]


@pytest.mark.parametrize("topic", IDENTIFIED)
def test_one_lost_message_is_a_difference(edited: Edited, tmp_path: Path, topic: str) -> None:
    rows = [row for row, message in enumerate(edited.messages) if message[0] == topic]
    del edited.messages[rows[len(rows) // 2]]
    result = call(edited.write(tmp_path))
    assert result.exit_code == 1, result.output
    assert f"{len(rows) - 1} messages recorded" in result.output


def test_differences_on_standard_output(edited: Edited, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The list and nothing else: the same bytes as in a file, the short lines on standard error."""
    del edited.messages[next(row for row, message in enumerate(edited.messages) if message[0] == "/axis_state")]
    bag = edited.write(tmp_path)
    monkeypatch.chdir(tmp_path)
    in_file = call(bag, "--diff", "differences.txt")
    result = call(bag, "--diff", "-")
    assert result.exit_code == in_file.exit_code == 1, result.output
    assert result.stdout_bytes == Path("differences.txt").read_bytes()
    assert result.stdout.startswith(f"{bag}: DIFFERS\n") and "/axis_setpoint" in result.stdout
    assert result.stderr == in_file.stdout and "first in stage" in result.stderr
    assert not Path("-").exists()


def test_several_programs_are_refused(edited: Edited, tmp_path: Path) -> None:
    topic, payload, log_ns = next(row for row in edited.messages if row[0] == "/axis_setpoint")
    edited.messages.append((topic, payload[:12] + struct.pack("<I", 9) + payload[16:], log_ns))
    result = call(edited.write(tmp_path))
    assert result.exit_code == 2 and "holds 2 programs" in result.output


def test_changed_definition_is_refused(edited: Edited, tmp_path: Path) -> None:
    edited.texts["/axis_state"] = edited.texts["/axis_state"].replace("float64[] position_mm", "float64[] position_m ")
    result = call(edited.write(tmp_path))
    assert result.exit_code == 2
    assert "feedopt_msgs/msg/AxisState" in result.output and "position_m" in result.output


def test_bags_that_are_none(tmp_path: Path) -> None:
    assert call(tmp_path / "nosuch").exit_code == 2
    cut = tmp_path / "cut"
    shutil.copytree(BAG, cut)
    path = next(cut.glob("*.mcap"))
    path.write_bytes(path.read_bytes()[:-5000])
    result = call(cut)
    assert result.exit_code == 2 and "feedopt bag recover" in result.output
    (tmp_path / "empty").mkdir()
    assert call(tmp_path / "empty").exit_code == 2


def test_update_goes_alone() -> None:
    result = call(BAG, "--update", "--live")
    assert result.exit_code == 2 and "--update cannot be combined" in result.output


def test_live_needs_the_parameters_of_then(monkeypatch: pytest.MonkeyPatch) -> None:
    recorded = RecordedProgram(BAG)
    real = recorded.node_parameters
    monkeypatch.setattr(
        recorded,
        "node_parameters",
        lambda node: {**real(node), **({"rest_before_ticks": 7} if node == "interpolator" else {})},
    )
    with pytest.raises(ReplayInputError, match=r"interpolator ran with rest_before_ticks = 7"):
        live._refuse_other_parameters(recorded)


def test_free_domain_is_one_without_a_graph() -> None:
    first = live.free_domain()
    with DomainLock(first):
        second = live.free_domain()
        assert second != first
        with pytest.raises(SecondGraphError), DomainLock(first):
            pass


def test_parameters_of_every_node_are_recorded() -> None:
    recorded = RecordedProgram(BAG)
    assert recorded.nodes == set(load_graph().nodes)
    for node in recorded.nodes:
        assert recorded.node_parameters(node)["present_nodes"]


@pytest.mark.graph
def test_program_on_a_running_graph_again() -> None:
    result = call(BAG, "--live")
    assert result.exit_code == 0, result.output
