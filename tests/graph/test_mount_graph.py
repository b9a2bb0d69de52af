# SPDX-License-Identifier: Apache-2.0
"""A unit mounted z-down beside a magnetometer in a frame of its own: processed by preset and by tf, and live by tf."""

import numpy as np
import pytest

import running_graph
from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core import frames, wire
from mwd_sensors.core.mount import PRESETS
from mwd_sensors.core.settings import changed
from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.definitions import installed
from mwd_surface.processing import process
from mwd_surface.runs import simulate
from running_graph import MWD, PLACE, samples_of

pytestmark = [pytest.mark.ros, pytest.mark.slow(5)]

SCENARIO = """
name: mounted
rate_hz: 50
seed: 5
date: 2026-03-01T06:00:00
place: {latitude_deg: 38.3, longitude_deg: 109.6}
well: {stations: [[0.0, 30.0, 40.0], [60.0, 30.0, 40.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}
schedule: [{kind: still, seconds: 14.0, pumps: false}, {kind: drill, seconds: 16.0, rpm: 120.0, rop_m_h: 20.0}]
"""
Z_DOWN, Y_UP = PRESETS["z-down"], PRESETS["y-up"]
SETTINGS = changed(EstimatorSettings(), PLACE)
# Rotation of each unit from its axes to the tool's, and its frame.
MOUNTED = {
    "imu/data_raw": (wire.IMU, ("angular_velocity", "linear_acceleration"), Z_DOWN, "imu_link"),
    "imu/mag": (wire.MAG, ("magnetic_field",), Y_UP, "mag_link"),
    # These name the tool's own frame.
    "gyro/data_raw": (wire.IMU, (), np.eye(3), "sonde_link"),
    "imu/temperature": (wire.TEMPERATURE, (), np.eye(3), "sonde_link"),
    "rig/state": (wire.RIG_STATE, (), np.eye(3), "rig_floor"),
}
_TF = "tf2_msgs/msg/TFMessage"


def static_transforms():
    """The bytes of a message that says how both units are mounted."""
    definitions = installed()
    definitions.load(_TF)
    store = definitions.typestore
    types, made = store.types, []
    for _, fields, mat, name in MOUNTED.values():
        if not fields:
            continue
        header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "sonde_link")
        turn = types["geometry_msgs/msg/Quaternion"](*(float(v) for v in frames.quat_from_mat(mat)))
        transform = types["geometry_msgs/msg/Transform"](types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0), turn)
        made.append(types["geometry_msgs/msg/TransformStamped"](header, name, transform))
    return bytes(store.serialize_cdr(types[_TF](made), _TF))


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """A recording of a tool as the graph expects it, and the same with its units mounted otherwise."""
    folder = tmp_path_factory.mktemp("mounted")
    (folder / "scenario.yaml").write_text(SCENARIO)
    plain, mounted = folder / "plain", folder / "turned"
    simulate.record(read(folder / "scenario.yaml"), plain)
    qos = [{"history": "keep_last", "depth": 1, "reliability": "reliable", "durability": "transient_local"}]
    with BagWriter(mounted) as bag:
        first = samples_of(plain, "/imu/data_raw")["stamp_ns"][0]
        bag.write(bag.topic("/tf_static", _TF, qos), static_transforms(), int(first))
        for topic, (layout, fields, mat, frame) in MOUNTED.items():
            samples = samples_of(plain, f"/{topic}")
            for name in fields:
                samples[name] = samples[name] @ mat
            bag.write_rows(bag.topic(f"/{topic}", layout.type_name), layout.encode(samples, frame), samples["stamp_ns"])
    return plain, mounted


def processed(bag, folder, **mount):
    settings = changed(SETTINGS, {f"tool.mount.{unit}": text for unit, text in mount.items()})
    with Bag(bag) as opened:
        summary = process.process(opened, folder, settings)
    return summary, (folder / "attitude.csv").read_bytes()


def test_a_unit_mounted_z_down_is_named_and_none_of_its_stations_accepted(bags, tmp_path):
    summary, _ = processed(bags[1], tmp_path / "out")
    assert FaultCode.MOUNT in {fault.code for fault in summary.faults}
    (record,) = summary.listed.records
    assert (Verdict(record.survey.verdict), record.in_use) == (Verdict.REJECT, False)


def test_preset_and_tf_give_the_bits_of_a_tool_mounted_x_down(bags, tmp_path):
    plain, expected = processed(bags[0], tmp_path / "plain")
    assert plain.surveys[0][0].station.verdict == "accept"
    for name, mount in {"preset": {"imu": "z-down", "mag": "y-up"}, "tf": {"imu": "tf", "mag": "tf"}}.items():
        summary, attitude = processed(bags[1], tmp_path / name, **mount)
        assert attitude == expected
        assert summary.faults == plain.faults
    # The magnetometer is turned into the axes of the IMU without being asked for.
    assert processed(bags[1], tmp_path / "half", imu="z-down")[1] == expected


def test_the_live_estimator_turns_units_by_tf_as_the_recording_does(bags, tmp_path):
    with running_graph.graph(tmp_path) as graph:
        surface = graph.start("surface", folder=tmp_path / "data", serve_page=False, record__name="live")
        mount = {"tool__mount__imu": "tf", "tool__mount__mag": "tf"}
        estimator = graph.start("estimator", **PLACE, **mount)
        graph.active(surface, estimator)
        replayed = graph.run(*MWD, "replay", bags[1], "--wait", 60, "--rate", 6)
        assert replayed.returncode == 0, replayed.stderr
        for name in (estimator, surface):
            assert graph.end(name)[0] == 0
    (recording,) = (tmp_path / "data").rglob("live")
    live = samples_of(recording, "/attitude")
    assert np.degrees(np.median(live["inclination"])) == pytest.approx(30.0, abs=0.5)
    with Bag(recording) as bag:
        assert bag.topics["/tf_static"].count >= 1
    offline, _ = processed(recording, tmp_path / "again", imu="tf", mag="tf")
    assert offline.without_azimuth < 0.2 * offline.rows
