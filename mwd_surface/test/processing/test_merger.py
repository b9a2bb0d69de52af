# SPDX-License-Identifier: Apache-2.0
"""Estimates beside the messages they come from: logged with the IMU sample, thinned if asked, reported when renamed."""

import numpy as np
import pytest

from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import wire
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.merged_bag import merged_bag
from mwd_surface.processing.run_output import Merger, Thinner

START = 1_700_000_000 * 10**9
IMU = "/w1/imu/data_raw"


def _merge(path, target, rate_hz=0.0, count=100, held_back=False):
    pipeline = Pipeline(EstimatorSettings())
    last = Output.empty(0)
    with Bag(path) as bag, merged_bag(target, bag) as merged:
        merger = Merger(merged, IMU, Thinner(rate_hz))
        merger.frame = "imu_7"
        for block, originals in bag.blocks_and_originals([IMU], block_messages=count):
            log_ns, samples = block[IMU]
            output = pipeline.push_imu(samples)
            merger.take(output, log_ns, originals, int(log_ns[-1]))
            if held_back:
                last.surveys += output.surveys
        merger.take(last, None, [], None)
        remarks = merger.remarks
    with Bag(target) as bag:
        return remarks, {name: topic.count for name, topic in bag.topics.items()}, list(bag.messages())


@pytest.mark.slow
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


def test_a_survey_is_logged_with_the_sample_that_ends_it_and_one_held_back_with_the_last_message(tmp_path):
    imu = wire.IMU.empty(3000)
    imu["stamp_ns"] = START + np.arange(3000) * 10_000_000
    imu["linear_acceleration"] = [-9.0, 0.0, 3.9]
    with BagWriter(tmp_path / "bag", chunk_bytes=20_000) as writer:
        writer.write_rows(writer.topic(IMU, wire.IMU.type_name), wire.IMU.encode(imu, "imu_7"), imu["stamp_ns"] + 3000)
    survey = EstimatorSettings().survey
    end_ns = round((survey.settle_s + survey.duration_s) * 1e9)
    for count in (100, 3000):
        _, counts, messages = _merge(tmp_path / "bag", tmp_path / f"merged_{count}", count=count, held_back=True)
        assert counts["/w1/survey"] == 2
        first, last = (log_ns - START for log_ns, name, _, _ in messages if name == "/w1/survey")
        assert 0 <= first - 3000 - end_ns < 500_000_000
        assert last == imu["stamp_ns"][-1] - START + 3000
        times = [log_ns for log_ns, *_ in messages]
        assert times == sorted(times)
