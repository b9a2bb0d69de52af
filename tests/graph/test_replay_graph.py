# SPDX-License-Identifier: Apache-2.0
"""A recording in a loop and sought backward, through the real estimator: each start gives a fresh one's numbers."""

import itertools
import subprocess
import sys

import numpy as np
import pytest

import running_graph
from mwd_estimation.core.status import Status
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.settings import changed
from mwd_sensors.simulator.scenario import read
from mwd_surface.runs import simulate
from running_graph import CALL, PLACE, samples_of, until

pytestmark = [pytest.mark.ros, pytest.mark.slow(13)]

SCENARIO = """
name: loop
rate_hz: 50
seed: 5
date: 2026-03-01T06:00:00
place: {latitude_deg: 38.3, longitude_deg: 109.6}
well: {stations: [[0.0, 30.0, 40.0], [60.0, 36.0, 47.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}
schedule: [{kind: still, seconds: 2.0, pumps: false}, {kind: drill, seconds: 6.0, rpm: 120.0, rop_m_h: 2160.0}]
vibration: {random: [{band_hz: [8.0, 300.0], acceleration_mps2: [6.0, 12.0, 12.0], when: drilling}]}
interference: {axial_nt: 2500.0}
"""
SEEK = (
    CALL
    + """
import sys
from mwd_msgs.srv import SeekReplay
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu
rclpy.init(); node = rclpy.create_node("talk"); heard = []
node.create_subscription(Imu, "/w1/imu/data_raw", heard.append, qos_profile_sensor_data)
for offset in sys.argv[1:]:
    answer = call(node, SeekReplay, "/replay/seek", offset=float(offset))
    assert answer.success, answer.message
    # Something is published from there before the next seek.
    heard.clear()
    while len(heard) < 20: rclpy.spin_once(node, timeout_sec=1.0)
"""
)
TOPICS = ("imu/mag", "gyro/data_raw", "imu/temperature", "imu/data_raw")
# A stamp behind the last may be a stray one; the estimator waits for a few before it takes it that time went back.
DOUBTED = 3


def estimated(bag, from_ns):
    """Attitude by a fresh estimator over the samples from there on."""
    pipeline = Pipeline(changed(EstimatorSettings(), PLACE))
    for topic, push in zip(
        TOPICS, (pipeline.push_mag, pipeline.push_precision, pipeline.push_temperature, pipeline.push_imu), strict=True
    ):
        samples = samples_of(bag, f"/w1/{topic}")
        output = push(samples[samples["stamp_ns"] >= from_ns])
    return output.attitude


@pytest.mark.fault_case(46)
def test_each_round_of_a_loop_and_what_follows_a_seek_equal_a_fresh_start(tmp_path):
    (tmp_path / "loop.yaml").write_text(SCENARIO)
    bag = tmp_path / "bag"
    simulate.record(read(tmp_path / "loop.yaml"), bag, "w1")
    with running_graph.graph(tmp_path) as graph:
        surface = graph.start("surface", "w1", folder=tmp_path / "data", serve_page=False, record__name="again")
        estimator = graph.start("estimator", "w1", **{k.replace(".", "__"): v for k, v in PLACE.items()})
        for name in (surface, estimator):
            until(lambda name=name: ": active" in graph.log(name), 90, f"{name} is active")
        words = ["--sensors", "--loop", "--rate", "2", "--wait", "60"]
        reported = tmp_path / "replay.log"
        with reported.open("w") as log:
            replay = graph.running["replay"] = subprocess.Popen(
                [sys.executable, "-P", "-m", "mwd_surface.cli", "replay", str(bag), *words],
                env=graph.environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        until(lambda: "round 2 is over" in reported.read_text(), 120, "two rounds")
        # To 7 s, forward or backward as it comes; then backward to 4 s.
        subprocess.run([sys.executable, "-c", SEEK, "7", "4"], env=graph.environment, check=True, timeout=240)
        rounds = reported.read_text().count("is over")
        until(lambda: reported.read_text().count("is over") > rounds, 60, "the end of that round")
        assert graph.end("replay")[0] == 0
        assert replay.returncode == 0
        for name in (estimator, surface):
            assert graph.end(name)[0] == 0
    attitude = samples_of(tmp_path / "data" / "w1" / "bags" / "again", "/w1/attitude")
    starts = [0, *(np.flatnonzero(np.diff(attitude["stamp_ns"]) < 0) + 1).tolist(), len(attitude)]
    rounds = [attitude[start:end] for start, end in itertools.pairwise(starts)]
    first = samples_of(bag, "/w1/imu/data_raw")["stamp_ns"][0]
    fresh = estimated(bag, first)
    assert len(rounds) >= 4
    assert rounds[0].tobytes() == fresh.tobytes()
    assert rounds[1][DOUBTED:].tobytes() == fresh[DOUBTED:].tobytes()
    assert (rounds[1]["status"][:DOUBTED] & Status.REJECTED > 0).all()
    (sought,) = (one for one in rounds if one["stamp_ns"][0] == first + 4_000_000_000)
    assert len(sought) == 200
    assert sought[DOUBTED:].tobytes() == estimated(bag, sought["stamp_ns"][0])[DOUBTED:].tobytes()
