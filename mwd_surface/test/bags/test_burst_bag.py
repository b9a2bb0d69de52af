# SPDX-License-Identifier: Apache-2.0
"""A bag whose IMU comes in bursts gives the estimator what the same bag gives with a message for each sample."""

import numpy as np
import pytest

from mwd_sensors.core import burst, wire
from mwd_surface.bags.bag_metadata import qos_profile
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.processing.bag_input import InputSettings, find_topics

START = 1_772_344_800_000_000_000
STREAM = [qos_profile(reliability="best_effort", depth=200)]


def samples(count):
    imu = burst.bare(count)
    imu["stamp_ns"] = START + np.arange(count) * 200_000
    imu["linear_acceleration"] = np.random.default_rng(1).normal(size=(count, 3))
    return imu


@pytest.fixture
def bags(tmp_path):
    imu, mag = samples(1003), wire.MAG.empty(20)
    mag["stamp_ns"] = START + np.arange(20) * 10_000_000
    for name in ("single", "bursts"):
        with BagWriter(tmp_path / name) as bag:
            for well in ("", "gyro"):
                topic = "gyro/" if well else "imu/"
                if name == "single":
                    channel = bag.topic(f"/w/{topic}data_raw", wire.IMU.type_name, STREAM)
                    bag.write_rows(channel, wire.IMU.encode(imu, "sonde_link"), imu["stamp_ns"])
                else:
                    channel = bag.topic(f"/w/{topic}burst", burst.TYPE_NAME, STREAM)
                    for start in range(0, len(imu), 25):
                        part = imu[start : start + 25]
                        bag.write(channel, burst.encode(part, "sonde_link"), int(part["stamp_ns"][-1]))
            channel = bag.topic("/w/imu/mag", wire.MAG.type_name, STREAM)
            bag.write_rows(channel, wire.MAG.encode(mag, "sonde_link"), mag["stamp_ns"])
    return tmp_path, imu


def test_a_topic_of_bursts_gives_the_samples_it_carries(bags):
    folder, imu = bags
    with Bag(folder / "bursts") as bag:
        blocks = [block["/w/imu/burst"][1] for block in bag.blocks(["/w/imu/burst"], block_messages=7)]
        assert np.concatenate(blocks).tobytes() == imu.tobytes()
        fields = {wire.IMU.type_name: ("linear_acceleration",)}
        some = np.concatenate([b["/w/imu/burst"][1] for b in bag.blocks(["/w/imu/burst"], fields=fields)])
        assert some.dtype.names == ("stamp_ns", "linear_acceleration")
        assert (some["linear_acceleration"] == imu["linear_acceleration"]).all()


def test_the_estimate_of_a_bag_takes_bursts_where_there_are_no_single_messages(bags):
    folder, _ = bags
    with Bag(folder / "bursts") as bag:
        topics = find_topics(bag, InputSettings())
        assert (topics.imu, topics.mag, topics.precision) == ("/w/imu/burst", "/w/imu/mag", "/w/gyro/burst")
    with Bag(folder / "single") as bag:
        assert find_topics(bag, InputSettings()).imu == "/w/imu/data_raw"
