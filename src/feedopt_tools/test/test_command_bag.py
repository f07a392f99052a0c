"""``feedopt bag``: its output for complete, cut-off, foreign and empty bags, and its exit codes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner, Result
from recorded_run import typestore, write_run
from rosbags.highlevel import AnyReader

pytest.importorskip("feedopt_msgs.msg")

from feedopt_recorder.bags.metadata_yaml import FILE_NAME, metadata_findings
from feedopt_recorder.message_schemas import MessageSchemas
from feedopt_tools.command.main import main

DURATION_S = 1.5


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bag")
    with pytest.MonkeyPatch.context() as patch:
        # The source tree has definitions, but no type descriptions: those come with an installation.
        patch.setattr(MessageSchemas, "type_hash", lambda _, name: str(typestore().hash_rihs01(name)))
        return write_run(folder / "run", folder / "share", duration_s=DURATION_S)


@pytest.fixture
def bag(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "run"))


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def cut(bag: Path, share: float) -> None:
    path = bag / "run_0.mcap"
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    (bag / FILE_NAME).unlink()


def test_info_tells_topics_and_provenance(bag: Path) -> None:
    result = call("bag", "info", bag)
    assert result.exit_code == 0, result.output
    assert "/axis_setpoint" in result.output and "feedopt_msgs/msg/AxisState" in result.output
    assert "eight.nc" in result.output and "with its footer" in result.output


def test_folder_of_a_run_stands_for_its_bag(bag: Path) -> None:
    run = bag.parent / "folder"
    run.mkdir()
    bag.rename(run / "recording")
    assert call("bag", "check", run).exit_code == 0


def test_complete_bag_has_no_findings(bag: Path) -> None:
    result = call("bag", "check", bag)
    assert (result.exit_code, result.output) == (0, f"{bag}: complete\n")


@pytest.mark.parametrize("share", [0.5, 0.9, 0.999])
def test_cut_off_bag_is_named_and_recovered(bag: Path, share: float) -> None:
    cut(bag, share)
    checked = call("bag", "check", bag)
    assert checked.exit_code == 1 and "without its footer" in checked.output
    assert "feedopt bag recover" in call("bag", "info", bag).output
    recovered = call("bag", "recover", bag)
    assert recovered.exit_code == 0, recovered.output
    with AnyReader([bag]) as reader:
        count = sum(1 for _ in reader.messages())
    assert f"{count} messages" in recovered.output and count > 0
    assert "with its footer" in call("bag", "info", bag).output


def test_nothing_to_recover_is_said(bag: Path) -> None:
    path = bag / "run_0.mcap"
    path.write_bytes(path.read_bytes()[:1500])
    result = call("bag", "recover", bag)
    assert result.exit_code == 2 and "nothing to recover" in result.output


@pytest.mark.parametrize("action", ["info", "check", "recover"])
@pytest.mark.parametrize(
    ("content", "named"), [(None, "no such bag"), (b"", "is empty"), (b"#ROSBAG V2.0\n", "not an MCAP file")]
)
def test_what_is_no_bag_is_named(tmp_path: Path, action: str, content: bytes | None, named: str) -> None:
    path = tmp_path / "other" / "other_0.mcap"
    if content is not None:
        path.parent.mkdir()
        path.write_bytes(content)
    result = call("bag", action, path.parent if content is not None else tmp_path / "nosuch")
    assert result.exit_code == 2
    assert named in result.output and "Traceback" not in result.output


def test_recording_of_others_has_an_info_and_no_check(tmp_path: Path) -> None:
    from recorded_run import schemas

    from feedopt_node.graph import Qos, Topic
    from feedopt_recorder.bag_writer import BagWriter, Received

    other = (Topic("/chatter", "builtin_interfaces/msg/Time", (), (), Qos("any", "reliable", "volatile", 1)),)
    writer = BagWriter(tmp_path / "chat", other, schemas(tmp_path / "share"))
    writer.write([Received(1, 1, "/chatter", bytes([0, 1, 0, 0]) + bytes(8), 0)])
    writer.close()
    shown = call("bag", "info", tmp_path / "chat")
    assert shown.exit_code == 0 and "/chatter" in shown.output and "no summary" in shown.output
    checked = call("bag", "check", tmp_path / "chat")
    assert checked.exit_code == 2 and "none of the topics of feedopt" in checked.output


# rosbag2 writes these fields in version 9 (ROS 2 Jazzy): README of rosbag2_storage and its metadata_io tests.
VERSION_9 = {
    "version": 9,
    "storage_identifier": "mcap",
    "compression_format": "",
    "compression_mode": "",
    "ros_distro": "jazzy",
}


def test_metadata_has_every_field_of_version_9(bag: Path) -> None:
    information = yaml.safe_load((bag / FILE_NAME).read_text())["rosbag2_bagfile_information"]
    assert {key: information[key] for key in VERSION_9} == VERSION_9
    assert set(information) == set(VERSION_9) | {
        "duration",
        "starting_time",
        "message_count",
        "topics_with_message_count",
        "relative_file_paths",
        "files",
        "custom_data",
    }
    assert set(information["duration"]) == {"nanoseconds"}
    assert set(information["starting_time"]) == {"nanoseconds_since_epoch"}
    assert information["relative_file_paths"] == ["run_0.mcap"]
    (file,) = information["files"]
    assert file == {
        "path": "run_0.mcap",
        "starting_time": information["starting_time"],
        "duration": information["duration"],
        "message_count": information["message_count"],
    }
    with AnyReader([bag]) as reader:
        times = [time_ns for _, time_ns, _ in reader.messages()]
        hashes = {connection.topic: connection.digest for connection in reader.connections}
    assert information["starting_time"]["nanoseconds_since_epoch"] == min(times)
    assert information["duration"]["nanoseconds"] == max(times) - min(times)
    assert information["message_count"] == len(times)
    for entry in information["topics_with_message_count"]:
        topic = entry["topic_metadata"]
        assert set(topic) == {
            "name",
            "type",
            "serialization_format",
            "offered_qos_profiles",
            "type_description_hash",
        }
        assert topic["serialization_format"] == "cdr"
        assert hashes[topic["name"]] == topic["type_description_hash"]
        (profile,) = topic["offered_qos_profiles"]
        assert set(profile) == {
            "history",
            "depth",
            "reliability",
            "durability",
            "deadline",
            "lifespan",
            "liveliness",
            "liveliness_lease_duration",
            "avoid_ros_namespace_conventions",
        }


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("version",), 8),
        (("message_count",), "many"),
        (("files",), None),
        (("ros_distro",), None),
        (("relative_file_paths",), ["gone_0.mcap"]),
        (("topics_with_message_count", 0, "message_count"), 12345),
        (("topics_with_message_count", 0, "topic_metadata", "type_description_hash"), ""),
        (("topics_with_message_count",), 3),
    ],
)
def test_wrong_metadata_is_found(bag: Path, path: tuple[str | int, ...], value: object) -> None:
    document = yaml.safe_load((bag / FILE_NAME).read_text())
    place = document["rosbag2_bagfile_information"]
    counts = {entry["topic_metadata"]["name"]: entry["message_count"] for entry in place["topics_with_message_count"]}
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    (bag / FILE_NAME).write_text(yaml.safe_dump(document))
    assert metadata_findings(bag, counts)
