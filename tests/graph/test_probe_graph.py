# SPDX-License-Identifier: Apache-2.0
"""From recording to emulator to serial line to probe node, estimator and recorder: the same bits as without a line."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

import running_graph
from mwd_estimation.core import clip_flags
from mwd_estimation.core.status import Status
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core.settings import changed
from mwd_sensors.drivers.emulator import XSENS_FIELD_T
from mwd_sensors.drivers.readings import FIELDS
from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.runs import simulate
from mwd_surface.surveys.survey_source import surveys_of
from running_graph import PLACE, samples_of, until

pytestmark = [pytest.mark.ros, pytest.mark.slow(17)]

SCENARIO = """
name: probe
rate_hz: 50
seed: 8
date: 2026-03-01T06:00:00
place: {latitude_deg: 38.3, longitude_deg: 109.6}
schedule:
  - {kind: drill, seconds: 6.0, rpm: 120.0, rop_m_h: 20.0}
  - {kind: still, seconds: 45.0, pumps: false}
  - {kind: drill, seconds: 4.0, rpm: 120.0, rop_m_h: 20.0}
vibration:
  random: [{band_hz: [8.0, 300.0], acceleration_mps2: [3.0, 3.0, 3.0]}]
  shocks: [{rate_hz: 1.0, peak_g: [3.0, 5.0], width_ms: [0.5, 1.0], when: always}]
ahrs: {changes: {flags_clipping: true, accelerometer: {range_g: [1.2, 1.2, 1.2]}}}
precision: {grade: tactical_north, changes: {flags_clipping: true, accelerometer: {range_g: [0.95, 0.95, 0.95]}}}
"""


MTI = """
name: mti
rate_hz: 50
date: 2026-03-01T06:00:00
place: {latitude_deg: 38.3, longitude_deg: 109.6}
well: {stations: [[0.0, 30.0, 40.0]]}
schedule:
  - {kind: drill, seconds: 10.0, rpm: 120.0, rop_m_h: 20.0}
  - {kind: still, seconds: 18.0, pumps: false}
  - {kind: drill, seconds: 4.0, rpm: 120.0, rop_m_h: 20.0}
vibration:
  random: [{band_hz: [8.0, 300.0], acceleration_mps2: [3.0, 3.0, 3.0]}]
ahrs: {grade: mti3_calibrated}
"""


def command(graph, name, *words):
    """Start a command of `mwd`, with its log."""
    with (graph.folder / f"{name}.log").open("w") as log:
        graph.running[name] = subprocess.Popen(
            [sys.executable, "-P", "-m", "mwd_surface.cli", *words],
            env=graph.environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )


def recorded(tmp_path, scenario, protocol, *line, **place):
    """Simulate a scenario and play it through a serial line into a graph: what was sent, what the surface recorded."""
    (tmp_path / "scenario.yaml").write_text(scenario)
    sent, link = tmp_path / "sent", tmp_path / "line"
    simulate.record(read(tmp_path / "scenario.yaml"), sent)
    with running_graph.graph(tmp_path) as graph:
        surface = graph.start("surface", folder=tmp_path / "data", serve_page=False, record__name="got")
        estimator = graph.start("estimator", **{key.replace(".", "__"): value for key, value in place.items()})
        for name in (surface, estimator):
            until(lambda name=name: ": active" in graph.log(name), 90, f"{name} is active")
        settings = [f"port:={link}", f"protocol:={protocol}", "clock:=unit", "wait_for_listener_s:=60.0", *line]
        command(graph, "probe", "node", "probe", "--ros-args", *(w for s in settings for w in ("-p", s)))
        until(lambda: "trying again" in graph.log("probe"), 60, "the probe node looks for its line")
        words = ["--protocol", protocol, "--link", str(link), "--wait", "--rate", "4"]
        command(graph, "emulator", "emulate", str(sent), *words)
        assert graph.wait("emulator", 90) == 0
        until(lambda: "was lost" in graph.log("probe"), 20, "the node sees that the line is gone")
        for name in ("probe", estimator, surface):
            assert graph.end(name)[0] == 0
    (got,) = (tmp_path / "data").rglob("got")
    return sent, got


def test_a_probe_on_a_serial_line_gives_the_samples_of_the_recording(tmp_path):
    sent, got = recorded(tmp_path, SCENARIO, "binary", **PLACE)
    for topic, fields in FIELDS.items():
        expected, mine = samples_of(sent, f"/{topic}"), samples_of(got, f"/{topic}")
        assert np.array_equal(mine["stamp_ns"], expected["stamp_ns"])
        for field in fields:
            assert mine[field].tobytes() == expected[field].tobytes()
    flags = clip_flags.of(samples_of(sent, "/imu/data_raw"))
    for topic in ("/imu/data_raw", "/gyro/data_raw"):
        expected = clip_flags.of(samples_of(sent, topic))
        assert np.array_equal(clip_flags.of(samples_of(got, topic)), expected)
        assert 0.0 < np.mean(expected & clip_flags.ACCEL != 0) < 1.0
    live, alone = samples_of(got, "/attitude"), Pipeline(changed(EstimatorSettings(), PLACE))
    alone.push_mag(samples_of(sent, "/imu/mag"))
    alone.push_precision(samples_of(sent, "/gyro/data_raw"))
    alone.push_temperature(samples_of(sent, "/imu/temperature"))
    offline = alone.push_imu(samples_of(sent, "/imu/data_raw"))
    assert live.tobytes() == offline.attitude.tobytes()
    # The gyrocompass, which is told what the precision unit clipped, finds the same north to the bit.
    (survey,) = offline.surveys
    expected = survey.record()
    with Bag(got) as bag:
        (heard,) = (Survey.from_message(bag.decode("/survey", data)) for _, _, _, data in bag.messages(["/survey"]))
    assert any(one.method.startswith("gyro") for one in heard.azimuths)
    assert heard == dataclasses.replace(expected, frame_id=heard.frame_id, sequence=heard.sequence)
    assert np.array_equal(live["status"] & np.uint32(Status.CLIPPED) != 0, flags != 0)


def test_an_mti_on_a_serial_line_gives_a_survey_at_the_surface(tmp_path):
    place = PLACE | {"place.date": "2026-03-01"}  # the unit's clock begins at zero
    sent, got = recorded(tmp_path, MTI, "xsens", f"xsens_field_ut:={1e6 * XSENS_FIELD_T}", **place)
    for topic, field in (("/imu/data_raw", "linear_acceleration"), ("/imu/mag", "magnetic_field")):
        expected, mine = samples_of(sent, topic), samples_of(got, topic)
        # The unit counts 100 us from zero. On a busy machine the middleware drops samples of a best-effort topic.
        since = [(one["stamp_ns"][-1] - one["stamp_ns"]) // 100_000 for one in (expected, mine)]
        places = np.flatnonzero(np.isin(since[0], since[1]))
        assert len(places) == len(mine) > 0.9 * len(expected)
        assert mine[field] == pytest.approx(expected[field][places], rel=1e-9)
    live, alone = samples_of(got, "/attitude"), Pipeline(changed(EstimatorSettings(), place))
    alone.push_mag(samples_of(got, "/imu/mag"))
    alone.push_temperature(samples_of(got, "/imu/temperature"))
    offline = alone.push_imu(samples_of(got, "/imu/data_raw"))
    # On a busy machine the middleware drops a sample for one of estimator and recorder; what follows it then differs.
    both = min(len(live), len(offline.attitude))
    equal = live["stamp_ns"][:both] == offline.attitude["stamp_ns"][:both]
    same = int(np.argmin(np.append(equal, False)))
    assert same > 0.1 * len(live)
    assert live[:same].tobytes() == offline.attitude[:same].tobytes()
    (record,) = surveys_of(got)[0].records
    assert record.survey.verdict == Verdict.ACCEPT
    assert np.degrees(record.survey.inclination) == pytest.approx(30.0, abs=0.2)
    assert np.degrees(record.survey.azimuth) == pytest.approx(40.0, abs=2.0)
