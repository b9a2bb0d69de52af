# SPDX-License-Identifier: Apache-2.0
"""Sonde, estimator and surface in one process: the same surveys, one end."""

import pytest

from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.runs import launch_plan
from mwd_surface.surveys.survey_store import decoded
from running_graph import graph

pytestmark = [pytest.mark.ros, pytest.mark.slow(8)]
STORY = """
name: one
rate_hz: 50
place: {latitude_deg: 38.3, longitude_deg: 109.6}
well: {stations: [[0.0, 30.0, 40.0], [60.0, 36.0, 47.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}
schedule:
  - {kind: drill, seconds: 5.0, rpm: 120.0, rop_m_h: 20.0}
  - {kind: still, seconds: 16.0, pumps: false}
  - {kind: drill, seconds: 5.0, rpm: 120.0, rop_m_h: 20.0}
  - {kind: still, seconds: 14.0, pumps: false}
"""


def test_three_nodes_in_one_process_record_their_surveys_to_the_last_and_end_together(tmp_path):
    story = tmp_path / "story.yaml"
    story.write_text(STORY)
    parameters = {
        "surface": {"folder": str(tmp_path / "data"), "page.port": 0, "record.name": "run"},
        "estimator": launch_plan.reference_parameters(read(story)),
        "sonde": {"scenario": str(story), "rate": 5.0, "exit_at_end": True, "wait_for_listener_s": 30.0},
    }
    file = tmp_path / "parameters.yaml"
    file.write_text(launch_plan.parameter_yaml(parameters, "w1"))
    with graph(tmp_path) as running:
        well = running.start("well", "w1", arguments=["--params-file", str(file)])
        assert running.wait(well, within=240.0) == 0
        log = running.log(well)
    assert "Traceback" not in log
    (recording,) = (tmp_path / "data").rglob("*.mcap")
    with Bag(recording) as bag:
        counts = {name: topic.count for name, topic in bag.topics.items()}
    # The survey of the last rest is taken when the estimator ends.
    assert counts["/w1/survey"] == 2
    (listed,) = (tmp_path / "data").rglob("surveys.json")
    assert len(decoded(listed.read_bytes()).records) == 2
    assert counts["/w1/attitude"] == counts["/w1/imu/data_raw"] > 1000
