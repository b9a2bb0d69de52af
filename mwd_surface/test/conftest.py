# SPDX-License-Identifier: Apache-2.0
"""Recordings that several test files read, made once per session."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from mwd_sensors.core import wire
from project import REFERENCE_DATA

START = 1_600_000_000_000_000_000
QUATERNION = wire.Layout("geometry_msgs/msg/QuaternionStamped", (("quaternion", "float64", 4),))


@pytest.fixture(scope="session")
def broad_27(tmp_path_factory):
    """Trial 27 of BROAD as a bag: IMU, magnetometer, and the optical truth of the samples to score."""
    with np.load(REFERENCE_DATA / "broad" / "27_disturbed_phone_vibration_B.npz") as trial:
        gyr, acc, mag, quat = (trial[name].astype(float) for name in ("gyr", "acc", "mag", "quat"))
        scored, rate = trial["movement"] & np.isfinite(quat).all(axis=1), float(trial["fs"])
    imu, field, truth = wire.IMU.empty(len(gyr)), wire.MAG.empty(len(gyr)), QUATERNION.empty(len(gyr))
    imu["angular_velocity"], imu["linear_acceleration"], field["magnetic_field"] = gyr, acc, mag * 1e-6
    # The trial has w first, the message x.
    truth["quaternion"] = np.roll(quat, -1, axis=1)
    for rows in (imu, field, truth):
        rows["stamp_ns"] = START + np.round(np.arange(len(gyr)) * 1e9 / rate).astype(np.int64)
    store, path = get_typestore(Stores.ROS2_JAZZY), tmp_path_factory.mktemp("broad") / "broad_27"
    # The writer of rosbags: a recording by another program, without checksums.
    with RosbagsWriter(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, layout, rows in (
            ("/imu/data_raw", wire.IMU, imu),
            ("/imu/mag", wire.MAG, field),
            ("/truth/orientation", QUATERNION, truth[scored]),
        ):
            connection = writer.add_connection(topic, layout.type_name, typestore=store)
            for stamp, row in zip(rows["stamp_ns"].tolist(), layout.encode(rows, "imu"), strict=True):
                writer.write(connection, stamp, row.tobytes())
    return path
