"""``metadata.yaml`` of a rosbag2 bag, version 9, as ROS 2 Jazzy writes it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import yaml

from feedopt_node.graph import Qos

FILE_NAME = "metadata.yaml"
VERSION = 9
_FOREVER = {"sec": 9223372036, "nsec": 854775807}


@dataclass(frozen=True)
class TopicEntry:
    """One topic of a bag; ``offered_qos_profiles`` is the YAML text that also stands in the MCAP channel."""

    name: str
    type_name: str
    type_hash: str
    offered_qos_profiles: str
    message_count: int


@dataclass(frozen=True)
class BagEntry:
    """One bag of a single file."""

    file_name: str
    start_ns: int
    end_ns: int
    topics: tuple[TopicEntry, ...]


def qos_profiles_yaml(profiles: Sequence[Qos]) -> str:
    """The YAML list of QoS profiles, as it stands in MCAP channel metadata."""
    rows = [
        {
            "history": "keep_last",
            "depth": profile.depth,
            "reliability": profile.reliability,
            "durability": profile.durability,
            "deadline": dict(_FOREVER),
            "lifespan": dict(_FOREVER),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_FOREVER),
            "avoid_ros_namespace_conventions": False,
        }
        for profile in profiles
    ]
    return yaml.safe_dump(rows, sort_keys=False)


def bag_information(bag: BagEntry) -> dict[str, Any]:
    """The section ``rosbag2_bagfile_information``."""
    count = sum(topic.message_count for topic in bag.topics)
    span: Mapping[str, Mapping[str, int]] = {
        "starting_time": {"nanoseconds_since_epoch": bag.start_ns},
        "duration": {"nanoseconds": max(0, bag.end_ns - bag.start_ns)},
    }
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        "duration": dict(span["duration"]),
        "starting_time": dict(span["starting_time"]),
        "message_count": count,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": yaml.safe_load(topic.offered_qos_profiles) or [],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.message_count,
            }
            for topic in bag.topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [bag.file_name],
        "files": [
            {
                "path": bag.file_name,
                "starting_time": dict(span["starting_time"]),
                "duration": dict(span["duration"]),
                "message_count": count,
            }
        ],
        "custom_data": {"writer": f"feedopt_recorder {package_version()}"},
        "ros_distro": "jazzy",
    }


def write_metadata(directory: Path, bag: BagEntry) -> None:
    """Write ``metadata.yaml`` in one step: to a temporary name, then renamed. Raises OSError."""
    path = directory / FILE_NAME
    temporary = path.with_name(path.name + ".tmp")
    text = yaml.safe_dump({"rosbag2_bagfile_information": bag_information(bag)}, sort_keys=False)
    with temporary.open("w", encoding="utf-8") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    temporary.replace(path)


_KINDS: Mapping[str, type] = {
    "version": int,
    "storage_identifier": str,
    "duration": dict,
    "starting_time": dict,
    "message_count": int,
    "topics_with_message_count": list,
    "compression_format": str,
    "compression_mode": str,
    "relative_file_paths": list,
    "files": list,
    "custom_data": dict,
    "ros_distro": str,
}


def metadata_findings(directory: Path, counts: Mapping[str, int]) -> list[str]:
    """What is wrong with the ``metadata.yaml`` of a bag, field by field; empty: nothing.

    Args:
        directory: the bag's folder.
        counts: messages of every topic, as the file itself holds them.
    """
    path = directory / FILE_NAME
    try:
        information = yaml.safe_load(path.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        recorded = {
            entry["topic_metadata"]["name"]: entry["message_count"]
            for entry in information["topics_with_message_count"]
        }
        hashes = [
            entry["topic_metadata"]["type_description_hash"] for entry in information["topics_with_message_count"]
        ]
    except (OSError, yaml.YAMLError, KeyError, TypeError) as error:
        return [f"{path}: is not the metadata of a rosbag2 bag: {error!r}"]
    found = [
        f"{path}: {name} is missing or not of type {kind.__name__}"
        for name, kind in _KINDS.items()
        if not isinstance(information.get(name), kind)
    ]
    if information.get("version") != VERSION:
        found.append(f"{path}: version is {information.get('version')}, not {VERSION}")
    found += [
        f"{path}: {name} has {recorded.get(name, 'no')} messages, the file {counts.get(name, 'no')}"
        for name in sorted(recorded.keys() | counts.keys())
        if recorded.get(name) != counts.get(name)
    ]
    found += [
        f"{path}: names the file {name}, which is not there"
        for name in information.get("relative_file_paths") or ()
        if not (directory / name).is_file()
    ]
    if not all(str(text).startswith("RIHS01_") for text in hashes):
        found.append(f"{path}: not every topic has its type hash")
    return found


def package_version() -> str:
    """Version of the installed recorder; ``source`` if it runs from the source tree."""
    for name in ("feedopt-recorder", "feedopt_recorder"):
        try:
            return version(name)
        except PackageNotFoundError:
            continue
    return "source"
