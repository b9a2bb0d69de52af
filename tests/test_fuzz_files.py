# SPDX-License-Identifier: Apache-2.0
"""Files of other people: whatever their bytes are, a parser gives a result or its own error, never another."""

import io
import math

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore
from scipy.io import wavfile

from attacks import attacks, damaged
from mwd_estimation.assembly.assembly import read_assembly
from mwd_estimation.settings.tool_file import from_file
from mwd_sensors.calibration.triad_calibration import Calibration, TriadCalibration, as_table
from mwd_sensors.core import burst, wire
from mwd_sensors.core.input_files import load_yaml
from mwd_sensors.drivers import mtdata2, probe_protocol
from mwd_sensors.drivers.readings import UnitSample
from mwd_sensors.simulator import scenario
from mwd_sensors.telemetry import tool_configuration
from mwd_surface.bags.bag_metadata import MetadataError
from mwd_surface.bags.bag_metadata import read as read_metadata
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.clearance.offset_wells import OffsetWellError, read_offset_wells
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import list_of
from mwd_surface.list_files.table import read_table
from mwd_surface.processing import run_config
from mwd_surface.receiver import pressure_files
from mwd_surface.rig.wits.format import Decoder
from mwd_surface.runs import calibration_run
from mwd_surface.surveys.survey_store import decoded
from mwd_surface.uncertainty.programme import ProgrammeError, read_programme
from project import ROOT

pytestmark = [pytest.mark.fuzz, pytest.mark.fault_case(66)]


TABLE = b"md_m,inc_deg,azi_true_deg\n0,30,40\n60,36,47\n300,60,50\n"
LAS = (
    b"~VERSION\nVERS. 2.0 :\nWRAP. NO :\n~WELL\nSTRT.M 0 :\nSTOP.M 60 :\nSTEP.M 0 :\nNULL. -999.25 :\n"
    b"~CURVE\nMD.M :\nINCL.DEG :\nAZIM.DEG :\n~ASCII\n0 30 40\n60 36 47\n"
)
WITSML = (
    b'<trajectorys xmlns="http://www.witsml.org/schemas/1series" version="1.4.1.1"><trajectory><name>t</name>'
    b'<aziRef>true north</aziRef><trajectoryStation><md uom="m">10</md><incl uom="rad">0.1</incl>'
    b'<azi uom="rad">0.2</azi></trajectoryStation></trajectory></trajectorys>'
)


def rows(count=30):
    samples = wire.IMU.empty(count)
    samples["stamp_ns"] = 10**18 + np.arange(count) * 10**7
    samples["linear_acceleration"] = (-7.0, 0.0, 7.0)
    return samples


@pytest.fixture(scope="module")
def mcap(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seed")
    with BagWriter(folder / "bag") as bag:
        topic = bag.topic("/imu/data_raw", wire.IMU.type_name)
        bag.write_rows(topic, wire.IMU.encode(rows(), "a"), rows()["stamp_ns"])
    with (folder / "plain.mcap").open("wb") as file:
        writer = McapWriter(file, use_chunking=False)
        writer.start()
        channel = writer.register_channel("/x", "cdr", writer.register_schema("std_msgs/msg/Empty", "ros2msg", b""))
        writer.add_message(channel, 1, b"\x00\x01\x00\x00\x00", 1)
        writer.finish()
    return [next((folder / "bag").glob("*.mcap")).read_bytes(), (folder / "plain.mcap").read_bytes()]


@pytest.fixture(scope="module")
def db3(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seed") / "bag"
    with RosbagsWriter(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/imu/data_raw", wire.IMU.type_name, typestore=get_typestore(Stores.ROS2_JAZZY))
        for row, stamp in zip(wire.IMU.encode(rows(3), "a"), rows(3)["stamp_ns"], strict=True):
            writer.write(topic, int(stamp), row.tobytes())
    return [next(folder.glob("*.db3")).read_bytes()]


def read_whole(path):
    try:
        with Bag(path) as bag:
            for block in bag.blocks(list(bag.topics)):
                for log_ns, _ in block.values():
                    assert (np.diff(log_ns) >= 0).all()
    except BagError:
        return


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "suffix"), [("mcap", ".mcap"), ("db3", ".db3")])
def test_a_recording(kind, suffix, request, tmp_path):
    path = tmp_path / f"attack{suffix}"

    @given(data=attacks(*request.getfixturevalue(kind)))
    def attack(data):
        path.write_bytes(data)
        read_whole(path)

    attack()


@pytest.mark.parametrize("layout", [*wire.LAYOUTS.values()], ids=lambda layout: layout.type_name)
def test_a_message(layout):
    @given(data=attacks(layout.encode(layout.empty(1), "sonde_link")[0].tobytes()))
    def attack(data):
        try:
            samples = layout.decode(data)
        except wire.WireError:
            return
        assert samples.shape == (1,)

    attack()


def test_a_burst():
    samples = rows(4)
    for name in ("orientation", "orientation_covariance"):
        samples[name] = burst.bare()[name]

    @given(data=attacks(burst.encode(samples, "sonde_link")))
    def attack(data):
        try:
            burst.decode(data)
        except wire.WireError:
            return

    attack()


@st.composite
def packets(draw):
    """Packets of an MTi whose content was damaged and whose sum is right; some of them cut."""
    motion = UnitSample("imu/data_raw", 0, (0.1, 0.2, 0.3, -7.0, 0.0, 7.0))
    whole = [mtdata2.packet(motion, 0.01, 100 * k, k)[4:-1] for k in range(2)]
    contents = draw(st.lists(damaged(whole), min_size=1, max_size=4))
    stream = b"".join(mtdata2.message(mtdata2.MTDATA2, content[:2000]) for content in contents)
    return stream[: draw(st.integers(0, len(stream)))]


@given(data=st.one_of(packets(), attacks(b"\xfa\xff\x36\xff\x10\x00\x10\x20")))
def test_the_packets_of_a_unit(data):
    reader = mtdata2.MtReader(5e-5)
    for one in reader.feed(data) + reader.feed(data):
        assert one.topic.startswith("imu/")


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
def test_the_line_of_a_probe(text):
    reading = UnitSample("imu/data_raw", 10**18, (0.1, 0.2, 0.3, -7.0, 0.0, 7.0))
    lines = [probe_protocol.sample(reading, 1, text), probe_protocol.command("start", 2, text, 10**18)]

    @given(data=attacks(*lines))
    def attack(data):
        reader = probe_protocol.ProbeReader(text)
        reader.feed(data)
        for kind, content in probe_protocol.Splitter(text).feed(data):
            probe_protocol.requested(kind, content)

    attack()


def pressure_samples():
    """A WAV of two gauges, and the same as CSV."""
    table = np.arange(80).reshape(40, 2).astype("<i2")
    file = io.BytesIO()
    wavfile.write(file, 100, table)
    lines = "".join(f"{k * 0.01:.2f},{2e7 + a:.0f},{2e7 + b:.0f}\n" for k, (a, b) in enumerate(table.tolist()))
    return {".wav": file.getvalue(), ".csv": f"time_s,pressure_pa,pressure_2_pa\n{lines}".encode()}


@pytest.mark.parametrize("suffix", [".wav", ".csv"])
def test_a_file_of_pressure(suffix, tmp_path):
    path = tmp_path / f"pressure{suffix}"
    whole = pressure_samples()[suffix]

    # The head of a file says how to read the rest of it.
    @given(data=st.one_of(attacks(whole), damaged([whole[:48]]).map(lambda head: head + whole[48:])))
    def attack(data):
        path.write_bytes(data)
        for gauge in (1, 2):
            try:
                found = pressure_files.read(path, gauge)
            except ValueError as error:
                # Names the file, and is no error of a library.
                if str(path) not in str(error):
                    raise
            else:
                assert len(found.time_s) == len(found.pressure_pa)

    attack()


@pytest.mark.parametrize(
    ("reader", "sample"),
    [(list_of, TABLE), (list_of, LAS), (list_of, WITSML)],
    ids=["csv", "las", "witsml"],
)
@pytest.mark.filterwarnings("ignore")
def test_a_list_of_stations(reader, sample):
    assert reader(sample).md.size

    @given(data=attacks(sample))
    def attack(data):
        try:
            found = reader(data)
        except ListFileError:
            return
        assert np.isfinite(found.md).all()
        assert (np.diff(found.md) > 0.0).all()

    attack()


def a_calibration():
    identity, zeros = np.eye(3), np.zeros(3)
    triad = TriadCalibration(identity, zeros, zeros, zeros, identity * 0, zeros, zeros, zeros, 20.0, 1.0, 0.1, 20)
    return yaml.safe_dump({"about": {"unit": "ahrs"}, "calibration": as_table(Calibration(triad, triad, triad))})


TABLES = {
    "scenario": (scenario.read, (ROOT / "bags" / "scenarios" / "default.yaml").read_text(), ValueError),
    "tool": (from_file, "gyro: {bias_deg_h: 10.0}\naccelerometer: {bias_ug: 30.0}\n", ValueError),
    "tool configuration": (
        tool_configuration.read,
        tool_configuration.text(tool_configuration.ToolConfiguration()),
        ValueError,
    ),
    "calibration": (calibration_run.read, a_calibration(), ValueError),
    "assembly": (read_assembly, "hole_mm: 216\nsensor_m: 15\ncomponents: [{length_m: 1.0, od_mm: 171}]\n", ValueError),
    "programme": (read_programme, "intervals: [{to_m: 500, code: MWD+SRGM}]\n", ProgrammeError),
    "offset wells": (read_offset_wells, "wells: [{name: a, file: a.csv, north_m: 1.0}]\n", OffsetWellError),
    "configuration": (
        run_config.read_config,
        "/**: {estimator: {ros__parameters: {survey.settle_s: 1.0}}}\n",
        ValueError,
    ),
    "stations": (read_table, TABLE.decode(), ValueError),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_a_table_of_settings(name, tmp_path):
    reader, sample, expected = TABLES[name]
    path = tmp_path / "attack.yaml"

    @given(data=attacks(sample.encode()))
    def attack(data):
        path.write_bytes(data)
        try:
            reader(path)
        except expected:
            return

    attack()


def test_yaml_itself():
    @given(data=attacks(b"a: &x [1, 2]\nb: {c: *x, <<: {d: 1}}\n", b"? [a, b]\n: !!set {x}\n"))
    def attack(data):
        try:
            load_yaml(data.decode("utf-8", "replace"))
        except yaml.YAMLError:
            return

    attack()


def test_the_metadata_of_a_recording(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.topic("/imu/data_raw", wire.IMU.type_name)
    path = tmp_path / "bag" / "metadata.yaml"

    @given(data=attacks(path.read_bytes()))
    def attack(data):
        path.write_bytes(data)
        try:
            read_metadata(path.parent)
        except MetadataError:
            return

    attack()


def test_a_survey_list():
    @given(data=attacks(b'{"format": "mwd surveys", "version": 1, "sha256": "", "list": {"records": []}}'))
    def attack(data):
        try:
            decoded(data)
        except ValueError:
            return

    attack()


@pytest.mark.fault_case(72)
def test_a_wits_stream():
    @given(data=attacks(b"&&\r\n0108123.4\r\n01101234.5\r\n!!\r\n"))
    def attack(data):
        decoder = Decoder()
        for frame in [*decoder.feed(data), *decoder.feed(b"\r\n!!\r\n&&\r\n0108123.4\r\n!!\r\n")]:
            number = frame.number(108)
            assert number is None or math.isfinite(number)
        assert decoder.waiting <= 65536

    attack()
