"""The bag that the recorder writes, judged by readers that are not ours."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from recorded_run import TOPICS, messages, schemas, write_run
from rosbags.highlevel import AnyReader

from feedopt_core.errors import ConfigError
from feedopt_recorder import bag_writer
from feedopt_recorder.bag_writer import FLUSH_INTERVAL_S, BagWriter, Received
from feedopt_recorder.bags.repair import repair_bag
from feedopt_recorder.errors import BagWriteError

DURATION_S = 0.5


def rerun_check(path: Path) -> None:
    command = shutil.which("rerun", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    if command is None:
        pytest.skip("the rerun command is not installed")
    result = subprocess.run([command, "mcap", "check", str(path)], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "PROBLEM" not in result.stdout, result.stdout


def test_an_independent_reader_finds_every_byte(tmp_path: Path) -> None:
    bag = write_run(tmp_path / "run", tmp_path / "share", duration_s=DURATION_S)
    written: dict[str, list[tuple[int, bytes]]] = {}
    for message in messages(DURATION_S):
        written.setdefault(message.topic, []).append((message.time_ns, message.payload))
    read: dict[str, list[tuple[int, bytes]]] = {}
    with AnyReader([bag]) as reader:
        for connection, time_ns, payload in reader.messages():
            read.setdefault(connection.topic, []).append((time_ns, bytes(payload)))
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        for connection, _, payload in reader.messages():
            reader.deserialize(payload, connection.msgtype)
    assert read == written
    assert types == {topic.name: topic.type for topic in TOPICS}
    rerun_check(bag / "run_0.mcap")


def test_publish_times_of_several_publishers_run_forward(tmp_path: Path) -> None:
    first, second = [message for message in messages(DURATION_S) if message.topic == "/axis_state"][:2]
    writer = BagWriter(tmp_path / "run", TOPICS, schemas(tmp_path / "share"))
    writer.write([Received(2_000, 1_500, "/axis_state", first.payload, 0)])
    writer.write([Received(2_001, 1_400, "/axis_state", second.payload, 0)])
    writer.close()
    with writer.path.open("rb") as stream:
        times = [(message.log_time, message.publish_time) for _, _, message in make_reader(stream).iter_messages()]
    assert times == [(2_000, 1_500), (2_001, 1_500)]
    rerun_check(writer.path)


def test_metadata_yaml_counts_what_the_file_holds(tmp_path: Path) -> None:
    bag = write_run(tmp_path / "run", tmp_path / "share", duration_s=DURATION_S)
    information = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    with (bag / "run_0.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        records = {record.name: record.metadata for record in reader.iter_metadata()}
    assert summary is not None and summary.statistics is not None
    assert information["version"] == 9
    assert information["message_count"] == summary.statistics.message_count
    assert information["starting_time"]["nanoseconds_since_epoch"] == summary.statistics.message_start_time
    counts = {
        topic["topic_metadata"]["name"]: topic["message_count"] for topic in information["topics_with_message_count"]
    }
    topics = {
        channel.topic: summary.statistics.channel_message_counts.get(i, 0) for i, channel in summary.channels.items()
    }
    assert counts == topics
    assert records["feedopt/program"]["name"] == "eight.nc"
    assert yaml.safe_load(records["rosbag2"]["serialized_metadata"]) == information
    profiles = {
        topic["topic_metadata"]["name"]: topic["topic_metadata"]["offered_qos_profiles"]
        for topic in information["topics_with_message_count"]
    }
    assert profiles["/machine"][0]["durability"] == "transient_local"
    assert not list(bag.glob("*.tmp"))


def test_schema_text_stands_alone(tmp_path: Path) -> None:
    text = schemas(tmp_path).schema("feedopt_msgs/msg/AxisState")
    assert "MSG: builtin_interfaces/Time\n" in text
    assert text.count("MSG: ") == 1
    with pytest.raises(ConfigError, match="nosuch_msgs/msg/Nothing"):
        schemas(tmp_path).schema("nosuch_msgs/msg/Nothing")


WRITER_THAT_IS_KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {here!r})
from recorded_run import TOPICS, messages, schemas
from feedopt_recorder.bag_writer import BagWriter
clock = [0.0]
writer = BagWriter(Path({bag!r}), TOPICS, schemas(Path({share!r})), clock_s=lambda: clock[0])
for count, message in enumerate(messages(0.5)):
    if count == {kill_at}:
        os.kill(os.getpid(), signal.SIGKILL)
    writer.write([message.received()])
    if count == {flush_at}:
        clock[0] += 0.5
    writer.flush_if_due()
"""


def test_kill_leaves_every_flushed_message_readable(tmp_path: Path) -> None:
    bag = tmp_path / "run"
    script = WRITER_THAT_IS_KILLED.format(
        here=str(Path(__file__).parent), bag=str(bag), share=str(tmp_path / "share"), kill_at=600, flush_at=500
    )
    result = subprocess.run([sys.executable, "-c", script], check=False)
    assert result.returncode == -signal.SIGKILL
    assert [path.name for path in bag.iterdir()] == ["run_0.mcap"]
    # A piece of the next record, as a process may leave it when it dies inside a write.
    with (bag / "run_0.mcap").open("ab") as stream:
        stream.write(b"\x06\x00\x00\x10\x00\x00\x00\x00\x00" + bytes(range(256)) * 200)
    mended = repair_bag(bag)
    assert sum(topic.message_count for topic in mended.topics) == 501
    expected = [(message.topic, message.payload) for message in messages(DURATION_S)][:501]
    with AnyReader([bag]) as reader:
        read = [(connection.topic, bytes(payload)) for connection, _, payload in reader.messages()]
    assert sorted(read) == sorted(expected)
    rerun_check(bag / "run_0.mcap")


def test_repair_leaves_a_whole_file_alone(tmp_path: Path) -> None:
    bag = write_run(tmp_path / "run", tmp_path / "share", duration_s=DURATION_S)
    before = (bag / "run_0.mcap").read_bytes()
    information = yaml.safe_load((bag / "metadata.yaml").read_text())
    (bag / "metadata.yaml").unlink()
    repair_bag(bag)
    assert (bag / "run_0.mcap").read_bytes() == before
    assert yaml.safe_load((bag / "metadata.yaml").read_text()) == information


class FullDisk(bag_writer._UnbufferedFile):
    """Takes so many bytes, then half of a write, then nothing."""

    room = 0

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        file, disk = self._file, self

        class Limited:
            def write(self, data: memoryview) -> int:
                taken = min(len(data), max(0, disk.room - file.tell()))
                if taken == 0:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                return file.write(data[:taken])

            def __getattr__(self, name: str) -> object:
                return getattr(file, name)

        self._file = Limited()  # type: ignore[assignment]


def write_all(writer: BagWriter, written: list[tuple[str, bytes]]) -> None:
    for message in messages(DURATION_S):
        writer.write([message.received()])
        written.append((message.topic, message.payload))
        writer.flush_if_due()


@pytest.mark.parametrize("room", [40_000, 60_000, 61_111])
def test_full_disk_keeps_whole_chunks_and_names_the_loss(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    monkeypatch.setattr(bag_writer, "_UnbufferedFile", FullDisk)
    monkeypatch.setattr(FullDisk, "room", room)
    bag = tmp_path / "run"
    clock = iter(range(100_000))
    writer = BagWriter(
        bag, TOPICS, schemas(tmp_path / "share"), flush_interval_s=100.0, clock_s=lambda: float(next(clock))
    )
    written: list[tuple[str, bytes]] = []
    with pytest.raises(BagWriteError, match=r"No space left.*messages are saved and readable") as caught:
        write_all(writer, written)
    with AnyReader([bag]) as reader:
        read = [(connection.topic, bytes(payload)) for connection, _, payload in reader.messages()]
    assert 0 < len(read) < len(written)
    assert sorted(read) == sorted(written[: len(read)])
    assert f"{len(read)} of {len(written)} messages" in str(caught.value)
    with pytest.raises(BagWriteError, match="No space left"):
        writer.close()
    rerun_check(bag / "run_0.mcap")


def test_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BagWriteError, match=r"Not a directory.*choose another folder"):
        BagWriter(tmp_path / "file" / "run", TOPICS, schemas(tmp_path / "share"))
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "old").write_text("")
    with pytest.raises(BagWriteError, match="not empty"):
        BagWriter(tmp_path / "used", TOPICS, schemas(tmp_path / "share"))


def test_flush_interval_bounds_what_is_held_back(tmp_path: Path) -> None:
    now = [0.0]
    writer = BagWriter(tmp_path / "run", TOPICS, schemas(tmp_path / "share"), clock_s=lambda: now[0])
    size = writer.path.stat().st_size
    first = next(iter(messages(DURATION_S)))
    writer.write([first.received()])
    now[0] = FLUSH_INTERVAL_S - 0.01
    writer.flush_if_due()
    assert writer.path.stat().st_size == size
    now[0] = FLUSH_INTERVAL_S
    writer.flush_if_due()
    assert writer.path.stat().st_size > size
    writer.close()
