# SPDX-License-Identifier: Apache-2.0
"""Recordings as other programs and drivers make them: one short run of a tool, written in many ways."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings, wire
from mwd_sensors.core.arrays import Samples, Stamps
from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.processing.bag_estimate import BagEstimate
from mwd_surface.processing.bag_input import InputSettings
from mwd_surface.runs import simulate

SCENARIO = """
name: awkward
seed: 5
date: 2026-03-01T06:00:00
place: {latitude_deg: 58.4, longitude_deg: 1.88}
well: {stations: [[0.0, 30.0, 40.0], [60.0, 30.0, 40.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}
schedule:
  - {kind: still, seconds: 14.0, pumps: false}
  - {kind: drill, seconds: 12.0, rpm: 120.0, rop_m_h: 20.0}
  - {kind: still, seconds: 14.0, pumps: false}
"""
DAY = "2026-03-01"
#: The place as options of a command, and as settings of the estimator.
PLACE = ("--lat", "58.4", "--lon", "1.88", "--date", DAY)
PLACE_SETTINGS = {"place.field": "model", "place.lat_deg": 58.4, "place.lon_deg": 1.88, "survey.north": "true"}
IMU, MAG = "/imu/data_raw", "/imu/mag"
STORE = get_typestore(Stores.ROS2_JAZZY)
ROS1 = get_typestore(Stores.ROS1_NOETIC)

#: A stream: its topic, layout, samples, and the time each was logged, ns.
Stream = tuple[str, wire.Layout, Samples, Stamps]


def sent(folder: Path) -> tuple[Samples, Samples]:
    """Simulate the run in a folder and return its samples of the IMU and the magnetometer."""
    (folder / "scenario.yaml").write_text(SCENARIO)
    simulate.record(read(folder / "scenario.yaml"), folder / "sent")
    from running_graph import samples_of

    return samples_of(folder / "sent", IMU), samples_of(folder / "sent", MAG)


def surveys(path: Path, day: str = DAY, **given: object) -> list[tuple[object, ...]]:
    """Return the surveys of a recording without what names them: time, verdict, angles, samples, covariance."""
    with Bag(path) as bag:
        estimator = settings.changed(EstimatorSettings(), PLACE_SETTINGS | {"place.date": day})
        input_settings = settings.from_mapping(InputSettings, {"partial": True, **given})
        summary = BagEstimate(bag, estimator, input_settings).run(lambda _output: None)
    found = [(survey, survey.station) for survey, _ in summary.surveys]
    return [
        (
            *(survey.stamp_ns, one.verdict, one.inclination, one.azimuth, one.dip, survey.record().samples),
            *one.covariance.ravel().tolist(),
        )
        for survey, one in found
    ]


def streams(imu: Samples, mag: Samples) -> list[Stream]:
    """The two streams, logged when they were measured."""
    return [(IMU, wire.IMU, imu, imu["stamp_ns"].copy()), (MAG, wire.MAG, mag, mag["stamp_ns"].copy())]


def written(path: Path, given: list[Stream], frame: str = "imu_link") -> Path:
    """Write streams as a rosbag2 folder of MCAP storage; each in the order of its log times."""
    with BagWriter(path) as bag:
        for name, layout, samples, log_ns in given:
            order = np.argsort(log_ns, kind="stable")
            rows = layout.encode(samples[order], frame)
            bag.write_rows(bag.topic(name, layout.type_name), rows, log_ns[order])
    return path


def _in_order(given: list[Stream]) -> list[tuple[int, str, wire.Layout, bytes]]:
    """Messages of all streams by log time."""
    messages = []
    for name, layout, samples, log_ns in given:
        rows = layout.encode(samples, "imu_link")
        messages += [(int(at), name, layout, row.tobytes()) for at, row in zip(log_ns, rows, strict=True)]
    return sorted(messages, key=lambda message: message[0])


def bare_mcap(path: Path, given: list[Stream]) -> Path:
    """Write one MCAP file without a folder."""
    folder = written(path.with_suffix(".folder"), given)
    shutil.move(next(folder.glob("*.mcap")), path)
    return path


def db3(path: Path, given: list[Stream], serialization: str = "cdr") -> Path:
    """Write a rosbag2 folder of sqlite3 storage."""
    with RosbagsWriter(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {
            name: writer.add_connection(name, layout.type_name, typestore=STORE, serialization_format=serialization)
            for name, layout, _, _ in given
        }
        for log_ns, name, _, data in _in_order(given):
            writer.write(connections[name], log_ns, data)
    return path


def db3_with_log(path: Path, given: list[Stream], flushed: float = 0.5) -> Path:
    """Write a .db3 file as left by a power failure of the recorder: some messages are only in its write-ahead log."""
    whole = next(db3(path.with_suffix(".folder"), given).glob("*.db3"))
    live = path.with_suffix(".live")
    with sqlite3.connect(whole) as source:
        rows = source.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id").fetchall()
        source.execute("DELETE FROM messages")
    shutil.copy(whole, live)
    database = sqlite3.connect(live)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("PRAGMA wal_autocheckpoint=0")
    cut = round(flushed * len(rows))
    insert = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)"
    database.executemany(insert, rows[:cut])
    database.commit()
    database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    database.executemany(insert, rows[cut:])
    database.commit()
    for suffix in ("", "-wal"):
        shutil.copy(f"{live}{suffix}", f"{path}{suffix}")
    database.close()
    return path


def ros1_bag(path: Path, given: list[Stream]) -> Path:
    """Write a recording of ROS 1."""
    with Ros1Writer(path) as writer:
        connections = {
            name: writer.add_connection(name, layout.type_name, typestore=ROS1) for name, layout, _, _ in given
        }
        for log_ns, name, layout, data in _in_order(given):
            writer.write(connections[name], log_ns, ros1_bytes(data, layout.type_name))
    return path


def ros1_bytes(data: bytes, type_name: str) -> bytes:
    """Return a CDR message in the serialisation of ROS 1."""
    return bytes(STORE.cdr_to_ros1(data, type_name))


def encoded_mcap(
    path: Path,
    given: list[Stream],
    encoding: str,
    encode: Callable[[bytes, str], bytes],
    schema: tuple[str, str] = ("ros2msg", "sensor_msgs/msg/{}"),
) -> Path:
    """Write an MCAP file whose channels have an encoding; schema: its encoding, and the name with the type's own."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channels: dict[str, int] = {}
        for _, layout, _, _ in given:
            text = STORE.generate_msgdef(layout.type_name, ros_version=2)[0]
            if schema[0] == "ros1msg":
                text = ROS1.generate_msgdef(layout.type_name, ros_version=1)[0]
            number = writer.register_schema(
                schema[1].format(layout.type_name.rsplit("/", 1)[-1]), schema[0], text.encode()
            )
            channels[layout.type_name] = number
        topics = {
            name: writer.register_channel(name, encoding, channels[layout.type_name]) for name, layout, _, _ in given
        }
        for log_ns, name, layout, data in _in_order(given):
            writer.add_message(topics[name], log_ns, encode(data, layout.type_name), log_ns)
        writer.finish()
    return path


def as_json(data: bytes, type_name: str) -> bytes:
    """Return a message as JSON."""
    message = STORE.deserialize_cdr(data, type_name)
    stamp = message.header.stamp
    return json.dumps({"header": {"stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec}}}).encode()


def as_protobuf(data: bytes, type_name: str) -> bytes:  # noqa: ARG001
    """Return bytes that begin as a protobuf message does."""
    return b"\x0a\x0c" + data[4:16] + b"\x11" + data[16:]


def changed(samples: Samples, **fields: object) -> Samples:
    """Return a copy of samples with other values of some fields."""
    out = samples.copy()
    for name, value in fields.items():
        out[name] = value
    return out


def halves(imu: Samples) -> tuple[Samples, Samples]:
    """Split IMU samples into gyro and accelerometer messages, as drivers do that send them separately."""
    gyro, accel = imu.copy(), imu.copy()
    gyro["linear_acceleration"] = 0.0
    accel["angular_velocity"] = 0.0
    return gyro, accel


def mirrored(samples: Samples) -> Samples:
    """Return samples as another unit reads them: the axes of each vector in reverse order."""
    out = samples.copy()
    for name in ("angular_velocity", "linear_acceleration", "magnetic_field"):
        if name in (out.dtype.names or ()):
            out[name] = samples[name][:, ::-1]
    return out


def mixed(parts: Mapping[int, Samples]) -> Samples:
    """Return samples of several sources in turns; the key is the place of the source in each turn."""
    count = min(len(part) for part in parts.values())
    out = np.empty(count * len(parts), dtype=next(iter(parts.values())).dtype)
    for place, part in parts.items():
        out[place :: len(parts)] = part[:count]
    return out


def not_closed(path: Path) -> Path:
    """Take the index from a ROS 1 bag, as a recorder leaves it that died."""
    data = bytearray(path.read_bytes())
    at = data.find(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(data[at : at + 8], "little")
    data[at : at + 8] = bytes(8)
    path.write_bytes(bytes(data[:index]))
    return path


def with_a_string(source: Path, path: Path, encoding: str = "cdr", data: bytes = b"\0\1\0\0\2\0\0\0a\0") -> Path:
    """Copy an MCAP file and add a topic of strings."""
    with source.open("rb") as old, path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(old).iter_messages():
            if schema is not None and schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                about = schemas[schema.id] if schema is not None else 0
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, about)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        words = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        number = writer.register_channel("/words", encoding, words)
        for k in range(5):
            at = message.log_time + k
            writer.add_message(number, at, data, at)
        writer.finish()
    return path
