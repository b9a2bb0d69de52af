"""Estimates beside the messages they come from: logged with their IMU sample, thinned if asked, told when renamed."""

import numpy as np

from mwd_estimation.pipeline import EstimatorSettings, Pipeline
from mwd_sensors import wire
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.exports.thinner import Thinner
from mwd_surface.runs.merger import Merger

START = 1_700_000_000 * 10**9
IMU = "/w1/imu/data_raw"


def _merge(path, target, rate_hz=0.0):
    pipeline = Pipeline(EstimatorSettings())
    with Bag(path) as bag, Merger(target, bag, IMU, Thinner(rate_hz)) as merger:
        for block, originals in bag.blocks_and_originals([IMU], block_messages=100):
            log_ns, samples = block[IMU]
            merger.take(pipeline.push_imu(samples), log_ns, originals, int(log_ns[-1]))
        remarks = merger.remarks
    with Bag(target) as bag:
        return remarks, {name: topic.count for name, topic in bag.topics.items()}, list(bag.messages())


def test_every_estimate_is_logged_with_the_imu_sample_of_its_time(tmp_path):
    imu = wire.IMU.empty(500)
    imu["stamp_ns"] = START + np.arange(500) * 10_000_000
    imu["linear_acceleration"] = [-9.8, 0.0, 0.0]
    with BagWriter(tmp_path / "bag", chunk_bytes=20_000) as writer:
        writer.write_rows(writer.topic(IMU, wire.IMU.type_name), wire.IMU.encode(imu, "imu_7"), imu["stamp_ns"] + 3000)
    remarks, counts, messages = _merge(tmp_path / "bag", tmp_path / "merged")
    assert remarks == []
    assert (counts[IMU], counts["/w1/attitude"], counts["/w1/gravity"]) == (500, 500, 500)
    assert counts["/w1/interference"] == 8
    for log_ns, name, _, data in messages:
        if name != "/w1/interference":
            stamp = int.from_bytes(data[4:8], "little") * 10**9 + int.from_bytes(data[8:12], "little")
            assert log_ns - stamp == 3000 or name == "/w1/dynamics"
        assert wire.frame_id(data) == "imu_7"
    remarks, counts, _ = _merge(tmp_path / "merged", tmp_path / "again", rate_hz=10.0)
    assert any("/w1/processed/attitude" in remark for remark in remarks)
    assert (counts["/w1/attitude"], counts["/w1/processed/attitude"]) == (500, 50)
