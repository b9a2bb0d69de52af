# SPDX-License-Identifier: Apache-2.0
"""A unit of 5 kHz through real nodes: in bursts, every sample is in the recording, and estimated on the way."""

import numpy as np
import pytest

import running_graph
from mwd_sensors.core import wire
from mwd_sensors.simulator.scenario import read
from mwd_sensors.simulator.sonde import Sonde
from running_graph import PLACE, samples_of, until

pytestmark = [pytest.mark.ros, pytest.mark.slow(11)]

RATE_HZ, BURST = 5000, 10
SCENARIO = f"""
name: fast
seed: 5
rate_hz: {RATE_HZ}
kinematics_hz: {2 * RATE_HZ}
place: {{latitude_deg: 38.3, longitude_deg: 109.6}}
well: {{stations: [[0.0, 30.0, 40.0], [60.0, 36.0, 47.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}}
schedule: [{{kind: drill, seconds: 4.0, rpm: 120.0, rop_m_h: 20.0}}]
vibration: {{random: [{{band_hz: [8.0, 300.0], acceleration_mps2: [6.0, 12.0, 12.0], when: drilling}}]}}
ahrs: {{changes: {{adc_hz: {RATE_HZ}}}}}
precision: {{grade: tactical_north, changes: {{adc_hz: {RATE_HZ}}}}}
"""


def test_every_sample_of_a_five_kilohertz_unit_in_bursts_is_recorded_and_estimated(tmp_path):
    (tmp_path / "fast.yaml").write_text(SCENARIO)
    with running_graph.graph(tmp_path) as graph:
        surface = graph.start("surface", "w1", folder=tmp_path / "data", serve_page=False, record__name="fast")
        estimator = graph.start("estimator", "w1", **{k.replace(".", "__"): v for k, v in PLACE.items()})
        for name in (surface, estimator):
            until(lambda name=name: ": active" in graph.log(name), 120, f"{name} is active")
        sonde = graph.start(
            "sonde",
            "w1",
            scenario=tmp_path / "fast.yaml",
            wait_for_listener_s=60.0,
            exit_at_end=True,
            burst=BURST,
            thin=50,
        )
        assert graph.wait(sonde, 120.0) == 0
        for name in (estimator, surface):
            assert graph.end(name)[0] == 0
    bag = tmp_path / "data" / "w1" / "bags" / "fast"
    # What was sent: the same seed gives the same samples, but for when they were.
    sent = list(Sonde(read(tmp_path / "fast.yaml", {})).blocks(0.1))
    for topic, burst in (("imu/data_raw", "imu/burst"), ("gyro/data_raw", "gyro/burst")):
        made = np.concatenate([block[topic] for block in sent])
        kept = samples_of(bag, f"/w1/{burst}")
        assert len(made) == 4 * RATE_HZ
        assert (np.diff(kept["stamp_ns"]) == wire.NANOSECONDS // RATE_HZ).all()
        for field in ("angular_velocity", "linear_acceleration"):
            assert kept[field].tobytes() == made[field].tobytes()
    # A fast unit is estimated at its rate and published at a kilohertz or little more: never 1 ms without an attitude.
    attitude = samples_of(bag, "/w1/attitude")
    assert np.ptp(attitude["stamp_ns"]) > 3.99 * wire.NANOSECONDS
    assert np.diff(attitude["stamp_ns"]).max() <= wire.NANOSECONDS // 1000
