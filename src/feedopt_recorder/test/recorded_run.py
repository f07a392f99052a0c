"""A made-up run, serialised as the middleware would: six seconds of two axes on a figure of eight, at 1 kHz."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from feedopt_node.graph import load_graph
from feedopt_recorder.bag_writer import BagWriter, Received
from feedopt_recorder.message_schemas import MessageSchemas

SOURCE = Path(__file__).resolve().parents[2]
START_NS = 1_760_000_000_000_000_000
REST_TICKS = 50
OFFSET_VOLTS = np.array([0.148, 0.0119])
TOPICS = tuple(
    topic
    for topic in load_graph(SOURCE.parent / "config" / "graph.yaml").topics.values()
    if topic.type.startswith("feedopt_msgs/")
)
MACHINE_YAML = """/**:
  ros__parameters:
    machine:
      name: test_router
      axis_names: [X, Y]
      coordinate: [x, y]
      feed_limit_mm_s: 150.0
      velocity_limit_mm_s: [150.0, 150.0]
      acceleration_limit_mm_s2: [500.0, 3340.0]
      jerk_limit_mm_s3: [63000.0, 156000.0]
      control_limit_volts: [10.0, 10.0]
      tracking_error_limit_mm: [0.02, 0.02]
      inertia_volts_s2_mm: [2.13e-3, 1.25e-3]
      viscous_volts_s_mm: [4.67e-2, 3.80e-2]
      offset_volts: [0.148, 0.0119]
      coulomb_volts: [0.241, 0.131]
      tracking_kv_s: [4.49e-5, 8.07e-5]
      tracking_ka_s2: [1.99e-5, 1.52e-6]
      tracking_kj_s3: [5.20e-8, 1.80e-8]
"""


@dataclass(frozen=True)
class Message:
    """One serialised message of the made-up run."""

    topic: str
    payload: bytes
    time_ns: int

    def received(self) -> Received:
        """As the recorder takes it, 0.15 ms after it was sent."""
        return Received(self.time_ns, self.time_ns - 150_000, self.topic, self.payload, 0)


def typestore() -> Typestore:
    """The common message types and those of feedopt, from their source files."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in sorted((SOURCE / "feedopt_msgs" / "msg").glob("*.msg")):
        store.register(get_types_from_msg(path.read_text(), f"feedopt_msgs/msg/{path.stem}"))
    return store


def schemas(folder: Path) -> MessageSchemas:
    """Definitions from the source tree, the common ones written below ``folder`` as a ROS installation holds them."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header"):
        package, _, stem = name.split("/")
        target = folder / package / "msg" / f"{stem}.msg"
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(store.generate_msgdef(name, ros_version=2)[0].split("=" * 80)[0])
    return MessageSchemas([SOURCE, folder])


@dataclass(frozen=True)
class Motion:
    """Set points in closed form. Arrays of shape (n,) and (n, 2)."""

    tick: np.ndarray
    s_mm: np.ndarray
    feedrate_mm_s: np.ndarray
    position_mm: np.ndarray
    velocity_mm_s: np.ndarray
    acceleration_mm_s2: np.ndarray
    jerk_mm_s3: np.ndarray
    tracking_error_mm: np.ndarray
    control_volts: np.ndarray


def motion(duration_s: float = 6.0) -> Motion:
    """A figure of eight, driven from rest to rest by a time law without jumps."""
    tick = np.arange(-REST_TICKS, round(duration_s * 1000) + REST_TICKS + 1)
    tau = np.clip(tick / (duration_s * 1000.0), 0.0, 1.0)
    phase = 2 * math.pi * (10 * tau**3 - 15 * tau**4 + 6 * tau**5)
    position = np.stack([70 * np.sin(phase), 32 * np.sin(2 * phase)], axis=1)
    velocity, acceleration, jerk = (_derivative(position, order) for order in (1, 2, 3))
    feedrate = np.hypot(*velocity.T)
    s_mm = np.concatenate([[0.0], np.cumsum((feedrate[1:] + feedrate[:-1]) * 0.5e-3)])
    noise = np.random.default_rng(7).normal(0.0, 2e-4, velocity.shape)
    error = velocity * [4.49e-5, 8.07e-5] + acceleration * [1.99e-5, 1.52e-6] + jerk * [5.2e-8, 1.8e-8] + noise
    control = acceleration * [2.13e-3, 1.25e-3] + velocity * [4.67e-2, 3.8e-2] + np.sign(velocity) * [0.241, 0.131]
    return Motion(tick, s_mm, feedrate, position, velocity, acceleration, jerk, error, control + OFFSET_VOLTS)


def messages(duration_s: float = 6.0, segments: int = 120, chunks: int = 6) -> Iterator[Message]:
    """Every message of the run, in order of time."""
    writer = _Serialiser(typestore(), motion(duration_s))
    yield writer.machine()
    for node in ("toolpath", "planner", "interpolator", "router_sim", "recorder"):
        yield writer.status(node, state=1, program_id=0, time_ns=START_NS)
    yield from writer.segments(segments)
    yield from writer.chunks(chunks)
    yield from writer.samples()
    for node in ("toolpath", "planner", "interpolator", "router_sim"):
        yield writer.status(node, state=3, program_id=1, time_ns=START_NS + round(duration_s * 1e9) + 10**9)


def write_run(
    directory: Path, scratch: Path, *, duration_s: float = 6.0, drop: frozenset[tuple[str, int]] = frozenset()
) -> Path:
    """Write the run as a bag. ``drop`` names messages to leave out: (topic, index within the topic, from 0)."""
    provenance = {
        "feedopt/machine": {"yaml": MACHINE_YAML},
        "feedopt/program": {"name": "eight.nc", "text": "G1 X0 Y0\n", "sha256": "0" * 64},
    }
    writer = BagWriter(directory, TOPICS, schemas(scratch), provenance=provenance)
    seen: dict[str, int] = {}
    for message in messages(duration_s):
        index = seen[message.topic] = seen.get(message.topic, -1) + 1
        if (message.topic, index) not in drop:
            writer.write([message.received()])
    writer.close()
    return directory


def _derivative(position: np.ndarray, order: int) -> np.ndarray:
    values = position
    for _ in range(order):
        values = np.gradient(values, 1e-3, axis=0)
    return values


def _blank_fields(store: Typestore, type_name: str) -> dict[str, Any]:
    """What a publisher leaves as it is: zeros and empty sequences."""
    blanks: dict[str, Any] = {}
    for name, (node, detail) in store.get_msgdef(type_name).fields:
        if node == Nodetype.BASE:
            blanks[name] = {"string": "", "bool": False}.get(detail[0], 0)
        elif node == Nodetype.SEQUENCE:
            element = detail[0][1][0]
            blanks[name] = [] if element == "string" else np.zeros(0, element)
        elif node == Nodetype.NAME and detail.startswith("feedopt_msgs/"):
            blanks[name] = store.types[detail](**_blank_fields(store, detail))
    return blanks


class _Serialiser:
    def __init__(self, store: Typestore, motion: Motion) -> None:
        self.store = store
        self.motion = motion

    def message(self, topic: str, name: str, time_ns: int, /, **values: Any) -> Message:
        time = self.store.types["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        type_name = f"feedopt_msgs/msg/{name}"
        fields = {"stamp": time, **_blank_fields(self.store, type_name), **values}
        message = self.store.types[type_name](**fields)
        return Message(topic, bytes(self.store.serialize_cdr(message, type_name)), time_ns)

    def machine(self) -> Message:
        section = yaml.safe_load(MACHINE_YAML)["/**"]["ros__parameters"]["machine"]
        rows = {key: np.array(value, float) for key, value in section.items() if key.endswith(_ROW_SUFFIXES)}
        return self.message(
            "/machine",
            "Machine",
            START_NS - 10**9,
            name="test_router",
            yaml=MACHINE_YAML,
            axis_names=["X", "Y"],
            axis_map=np.eye(2).ravel(),
            period_s=0.001,
            **{**rows, "feed_limit_mm_s": 150.0},
        )

    def status(self, node: str, *, state: int, program_id: int, time_ns: int) -> Message:
        return self.message(
            "/status",
            "NodeStatus",
            time_ns,
            node=node,
            instance=START_NS,
            state=state,
            program_id=program_id,
            last_input_sequence=0,
            last_output_sequence=0,
            s_mm=0.0,
            motion_time_s=0.0,
            missed_ticks=0,
            starved_chunk_sequence=0,
            text="",
        )

    def segments(self, count: int) -> Iterator[Message]:
        ends = np.linspace(0, len(self.motion.tick) - 1, count + 1).round().astype(int)
        points = self.motion.position_mm[ends]
        keep = np.concatenate([[True], np.hypot(*np.diff(points, axis=0).T) > 1e-6])
        points = points[keep]
        lengths = np.hypot(*np.diff(points, axis=0).T)
        s_start = np.concatenate([[0.0], np.cumsum(lengths)])
        none = np.zeros(0)
        for i, length in enumerate(lengths):
            tangent = (points[i + 1] - points[i]) / length
            yield self.message(
                "/toolpath",
                "ToolpathSegment",
                START_NS - 5 * 10**8 + i * 10**5,
                program_id=1,
                sequence=i + 1,
                source_line=i + 1,
                last=i == len(lengths) - 1,
                exact_stop=False,
                kind=0,
                dimensions=2,
                s_start_mm=float(s_start[i]),
                length_mm=float(length),
                feed_limit_mm_s=math.inf,
                start_mm=points[i],
                tangent=tangent,
                normal=np.array([-tangent[1], tangent[0]]),
                rise=np.zeros(2),
                curvature_start_per_mm=0.0,
                sharpness_per_mm2=0.0,
                degree=0,
                knots=none,
                control_points_mm=none,
                weights=none,
                map_s_mm=none,
                map_u=none,
                map_error_mm=0.0,
            )

    def chunks(self, count: int) -> Iterator[Message]:
        m = self.motion
        ends = np.linspace(REST_TICKS, len(m.tick) - 1 - REST_TICKS, count + 1).round().astype(int)
        for k in range(count):
            rows = np.unique(np.linspace(ends[k], ends[k + 1], 11).round().astype(int))
            s, q = m.s_mm[rows], m.feedrate_mm_s[rows] ** 2
            elements = len(rows) - 1
            yield self.message(
                "/feed_profile",
                "FeedProfileChunk",
                START_NS - 10**8 + k * 10**6,
                program_id=1,
                sequence=k + 1,
                last_segment_sequence=10 * (k + 1),
                last=k == count - 1,
                s_start_mm=float(s[0]),
                s_commit_mm=float(s[-1]),
                s_stop_mm=float(s[-1]),
                t_start_s=float(m.tick[ends[k]] / 1000),
                t_commit_s=float(m.tick[ends[k + 1]] / 1000),
                kind=np.zeros(elements, np.uint8),
                s_mm=s,
                q_mm2_s2=q[:-1],
                dq_ds_mm_s2=np.diff(q) / np.maximum(np.diff(s), 1e-9),
                d2q_ds2_per_s2=np.zeros(elements),
                jerk_mm_s3=np.zeros(elements),
                max_velocity_mm_s=np.array([100.0, 90.0]),
                max_acceleration_mm_s2=np.array([400.0, 900.0]),
                max_jerk_mm_s3=np.array([5e4, 1e5]),
                max_control_volts=np.array([5.0, 4.0]),
                max_tracking_error_mm=np.array([0.01, 0.008]),
                worst_ratio=0.97,
                worst_quantity="acceleration",
                worst_axis="X",
                worst_s_mm=float(s[3]),
                method="lp",
                variables=elements,
                rows=10 * elements,
                iterations=12 + k,
                solve_time_s=0.004 + 0.001 * k,
                audit_time_s=0.001,
                fallback=False,
            )

    def samples(self) -> Iterator[Message]:
        m = self.motion
        lateness = np.random.default_rng(3).gamma(2.0, 6e-5, len(m.tick))
        chunk_ticks = len(m.tick) / 6
        for i, tick in enumerate(m.tick.tolist()):
            time_ns = START_NS + tick * 10**6
            last = i == len(m.tick) - 1
            yield self.message(
                "/axis_setpoint",
                "AxisSetpoint",
                time_ns,
                program_id=1,
                sequence=i + 1,
                chunk_sequence=min(6, 1 + int(i / chunk_ticks)) if tick >= 0 else 0,
                tick=tick,
                last=last,
                s_mm=float(m.s_mm[i]),
                feedrate_mm_s=float(m.feedrate_mm_s[i]),
                position_mm=m.position_mm[i],
                velocity_mm_s=m.velocity_mm_s[i],
                acceleration_mm_s2=m.acceleration_mm_s2[i],
                lateness_s=float(lateness[i]),
            )
            state = self.message(
                "/axis_state",
                "AxisState",
                time_ns,
                program_id=1,
                sequence=i + 1,
                setpoint_sequence=i + 1,
                tick=tick,
                last=last,
                reference_mm=m.position_mm[i],
                position_mm=m.position_mm[i] - m.tracking_error_mm[i],
                velocity_mm_s=m.velocity_mm_s[i],
                tracking_error_mm=m.tracking_error_mm[i],
                control_signal_volts=m.control_volts[i],
                saturated=np.abs(m.control_volts[i]) >= 10.0,
            )
            yield Message(state.topic, state.payload, time_ns + 300_000)


_ROW_SUFFIXES = (
    "_limit_mm_s",
    "_mm_s2",
    "_mm_s3",
    "_volts",
    "_limit_mm",
    "_s2_mm",
    "_s_mm",
    "_kv_s",
    "_ka_s2",
    "_kj_s3",
)
