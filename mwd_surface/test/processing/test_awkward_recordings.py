# SPDX-License-Identifier: Apache-2.0
"""Recordings as people have them: one run, written in many ways, gives the same surveys or one sentence."""

import csv
import shlex
import shutil

import awkward_bags as awkward
import numpy as np
import pyarrow.parquet as pq
import pytest
import typer
from awkward_bags import IMU, MAG, surveys

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings, wire
from mwd_surface.bags import salvage
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.cli import app
from mwd_surface.plots.plot_data import gather
from mwd_surface.processing.bag_input import InputSettings, find_topics
from mwd_surface.processing.half_imu import ImuKind
from mwd_surface.processing.input_stream import InputStream, RecordingStream
from mwd_surface.processing.inspection import inspect
from mwd_surface.runs import calibration_run

pytestmark = pytest.mark.slow(0.5)

PLACE = awkward.PLACE_SETTINGS | {"place.date": awkward.DAY}
EPOCH_1980_NS = 315_964_800 * wire.NANOSECONDS


def without_metadata(path):
    (path / "metadata.yaml").unlink()
    return path


def half_topics(path, sent):
    (_, layout, imu, log_ns), *rest = sent
    gyro, accel = awkward.halves(imu)
    return awkward.written(path, [("/a/gyro", layout, gyro, log_ns), ("/a/accel", layout, accel, log_ns), *rest])


def in_turns(path, sent):
    (_, layout, imu, _), *rest = sent
    both = awkward.mixed(dict(enumerate(awkward.halves(imu))))
    return awkward.written(path, [(IMU, layout, both, both["stamp_ns"]), *rest])


def zeros_between(path, sent):
    (_, layout, imu, _), *rest = sent
    empty = awkward.changed(imu, linear_acceleration=0.0, angular_velocity=0.0, stamp_ns=imu["stamp_ns"] + 4_000_000)
    both = awkward.mixed({0: imu, 1: empty})
    return awkward.written(path, [(IMU, layout, both, both["stamp_ns"]), *rest])


def twice(path, sent, late_ns):
    """Both streams from two publishers, the second one later."""
    return awkward.written(
        path,
        [
            (name, layout, np.concatenate([one, one]), np.concatenate([log_ns, log_ns + late_ns]))
            for name, layout, one, log_ns in sent
        ],
    )


def in_g(path, sent):
    (_, layout, imu, log_ns), *rest = sent
    in_units = awkward.changed(imu, linear_acceleration=imu["linear_acceleration"] / 9.80665)
    return awkward.written(path, [(IMU, layout, in_units, log_ns), *rest])


def other_names(path, sent):
    """The unit in halves and its magnetometer under names of its own, beside another one."""
    (_, layout, imu, log_ns), (_, field, mag, mag_ns), *rest = sent
    gyro, accel = awkward.halves(imu)
    names = [
        ("/two/gyro", layout, gyro, log_ns),
        ("/two/acc", layout, accel, log_ns),
        ("/two/field", field, mag, mag_ns),
    ]
    return awkward.written(path, [*names, ("/one/field", field, mag[::-1].copy(), mag_ns), *rest])


def two_pairs(path, sent):
    """Halves of two units, of which the one of the tool has the usual magnetometer beside it."""
    (_, layout, imu, log_ns), mag = sent
    gyro, accel = awkward.halves(imu)
    turned = awkward.changed(accel, linear_acceleration=accel["linear_acceleration"][:, ::-1])
    names = {"/left/gyro": gyro, "/left/accel": accel, "/right/gyro": gyro, "/right/accel": turned}
    return awkward.written(path, [*((name, layout, one, log_ns) for name, one in names.items()), mag])


def empty_field_between(path, sent):
    imu, (_, layout, mag, _) = sent
    empty = awkward.changed(mag, magnetic_field=0.0, stamp_ns=mag["stamp_ns"] + 4_000_000)
    both = awkward.mixed({0: mag, 1: empty})
    return awkward.written(path, [imu, (MAG, layout, both, both["stamp_ns"])])


# Name: how the same samples are recorded.
SAME = {
    "bare mcap": lambda path, sent: awkward.bare_mcap(path / "b.mcap", sent),
    "db3": lambda path, sent: awkward.db3(path / "b", sent),
    "bare db3": lambda path, sent: next(awkward.db3(path / "b", sent).glob("*.db3")),
    "db3 without metadata": lambda path, sent: without_metadata(awkward.db3(path / "b", sent)),
    "mcap without metadata": lambda path, sent: without_metadata(awkward.written(path / "b", sent)),
    "db3 with a write-ahead log": lambda path, sent: awkward.db3_with_log(path / "b.db3", sent),
    "ros 1 bag": lambda path, sent: awkward.ros1_bag(path / "b.bag", sent),
    "ros 1 bag not closed": lambda path, sent: awkward.not_closed(awkward.ros1_bag(path / "b.bag", sent)),
    "ros 1 in mcap": lambda path, sent: awkward.encoded_mcap(
        path / "b.mcap", sent, "ros1", awkward.ros1_bytes, ("ros1msg", "sensor_msgs/{}")
    ),
    "half topics": lambda path, sent: half_topics(path / "b", sent),
    "halves in turns": lambda path, sent: in_turns(path / "b", sent),
    "zeros between": lambda path, sent: zeros_between(path / "b", sent),
    "empty fields between": lambda path, sent: empty_field_between(path / "b", sent),
    "twice": lambda path, sent: twice(path / "b", sent, 300_000),
    "twice and late": lambda path, sent: twice(path / "b", sent, 53_000_000),
}


@pytest.mark.parametrize("way", SAME)
def test_the_same_samples_give_the_same_surveys_to_the_last_bit(way, sent, expected, tmp_path):
    assert len(expected) == 2
    assert surveys(SAME[way](tmp_path, sent)) == expected


# Ways to record the same samples, and how they are read so that they are the same.
READ_AS = {
    **{name: (SAME[name], {}) for name in ("half topics", "zeros between", "ros 1 bag")},
    "in g": (lambda p, s: in_g(p / "b", s), {"accel_unit": "g"}),
    "imu of 1980": (lambda p, s: other_clock(p / "b", s, "imu"), {"stamps": "recording"}),
    "other names": (lambda p, s: other_names(p / "b", s), {"imu_topic": "/two/acc", "mag_topic": "/two/field"}),
}


@pytest.fixture(scope="module")
def others(sent, tmp_path_factory):
    """What plot, calibrate, the time series and batch make of the plain recording."""
    folder = tmp_path_factory.mktemp("others")
    return seen_by_others(awkward.written(folder / "bag", sent), folder, {})


def with_temperature(sent):
    heat = wire.TEMPERATURE.empty(50)
    heat["stamp_ns"] = np.linspace(sent[0][3][0], sent[0][3][-1], 50).astype(np.int64)
    heat["temperature"] = 40.0
    return [*sent, ("/imu/temperature", wire.TEMPERATURE, heat, heat["stamp_ns"].copy())]


def seen_by_others(path, folder, given):
    """Numbers of the picture, the samples to calibrate, rows of the time series, surveys of the fleet."""
    options = [word for name, value in given.items() for word in (f"--{name.replace('_', '-')}", value)]
    with Bag(path) as bag:
        input_settings = settings.from_mapping(InputSettings, given)
        topics = find_topics(bag, input_settings)
        picture = gather(bag, ("sensors", "spectra"), input_settings, [topics.imu, topics.mag], bins=100)
    lines = sorted(
        (panel.trace.title, axis, *(np.asarray(line).tobytes() for line in panel.envelope.line(axis)))
        for panel in picture.panels
        for axis in range(len(panel.trace.labels))
    )
    powers = sorted((one.quantity, one.spectrum.waterfall.tobytes()) for one in picture.spectra)
    run("export", str(path), "-f", "timeseries", "-o", str(folder / "rows.csv"), *options)
    run("batch", str(path), "-o", str(folder / "fleet"), "--scheduler", "threads", *options)
    surveyed = pq.read_table(folder / "fleet" / "surveys").drop_columns(["key", "bag", "well", "uuid"]).to_pylist()
    return lines, powers, (folder / "rows.csv").read_text(), surveyed


# Two ways that the tests above and below assert too.
BESIDES = ("half topics", "zeros between")


@pytest.mark.parametrize(
    "way", [pytest.param(way, marks=pytest.mark.nightly) if way in BESIDES else way for way in READ_AS]
)
def test_every_command_takes_the_same_samples_from_the_same_run(way, sent, others, tmp_path):
    write, given = READ_AS[way]
    path = write(tmp_path, sent)
    found = seen_by_others(path, tmp_path, given)
    # A unit changes the last bits, and no digit of a table.
    assert found[2] == others[2]
    assert found == others or way == "in g"
    with Bag(path) as bag:
        topics = find_topics(bag, settings.from_mapping(InputSettings, given))
        stream = RecordingStream(bag, list(bag.topics), settings.from_mapping(InputSettings, given))
        found = np.concatenate([block[topics.imu][1] for block in stream.blocks() if topics.imu in block])
    for name in ("stamp_ns", "angular_velocity"):
        assert np.array_equal(found[name], sent[0][2][name])


@pytest.mark.parametrize("way", READ_AS)
def test_a_calibration_takes_the_same_samples_from_the_same_run(way, sent, tmp_path):
    write, given = READ_AS[way]
    heat = with_temperature(sent)[2:]
    with Bag(write(tmp_path, [*sent, *heat])) as bag:
        found, _ = calibration_run.recorded(bag, "ahrs", settings.from_mapping(InputSettings, given))
    assert np.array_equal(found.imu["stamp_ns"], sent[0][2]["stamp_ns"])
    assert np.array_equal(found.imu["angular_velocity"], sent[0][2]["angular_velocity"])
    assert np.allclose(found.imu["linear_acceleration"], sent[0][2]["linear_acceleration"], rtol=1e-15)
    assert np.array_equal(found.mag, sent[1][2]["magnetic_field"])


def test_the_half_that_belongs_to_the_one_that_is_named_is_joined(sent, expected, tmp_path):
    path = two_pairs(tmp_path / "b", sent)
    with pytest.raises(BagError, match="--imu-topic"):
        surveys(path)
    assert surveys(path, imu_topic="/left/gyro") == expected
    assert surveys(path, imu_topic="/left/accel") == expected
    assert surveys(path, imu_topic="/right/gyro") != expected


def test_a_write_ahead_log_is_read_from_a_folder_that_nobody_may_write_and_left_as_it_is(sent, expected, tmp_path):
    path = awkward.db3_with_log(tmp_path / "b.db3", sent, flushed=0.0)
    shutil.rmtree(tmp_path / "b.folder")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()}
    tmp_path.chmod(0o555)
    try:
        assert surveys(path) == expected
    finally:
        tmp_path.chmod(0o755)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()} == before


@pytest.mark.parametrize("share", [0.2, 0.55, 0.9])
@pytest.mark.parametrize("closed", [True, False])
def test_a_ros_1_bag_that_was_cut_is_read_as_far_as_it_goes_and_recovered(share, closed, sent, tmp_path):
    path = awkward.ros1_bag(tmp_path / "b.bag", sent)
    if not closed:
        awkward.not_closed(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: round(share * len(whole))])
    with Bag(path) as bag:
        assert not bag.complete
        assert any("the recording is of ROS 1" in note for note in bag.notes)
        read = [(log_ns, name, data) for log_ns, name, _, data in bag.messages()]
    assert share - 0.15 < len(read) / 9000 < share + 0.2
    (report,) = salvage.recover(path, tmp_path / "saved")
    assert report.messages == len(read)
    assert report.lost_bytes > 0
    with Bag(tmp_path / "saved") as saved:
        assert saved.complete
        assert [(log_ns, name, data) for log_ns, name, _, data in saved.messages()] == read


def test_a_database_damaged_in_the_middle_gives_what_is_sound(sent, tmp_path):
    path = next(awkward.db3(tmp_path / "b", sent).glob("*.db3"))
    damaged = bytearray(path.read_bytes())
    middle = len(damaged) // 8192 * 4096
    damaged[middle : middle + 8192] = bytes(8192)
    alone = tmp_path / "alone.db3"
    alone.write_bytes(damaged)
    (report,) = salvage.recover(alone, tmp_path / "saved")
    assert 8000 < report.messages < 9000
    with Bag(tmp_path / "saved") as saved:
        assert saved.message_count == report.messages


@pytest.mark.parametrize("cut", [1, 37, 1000])
def test_halves_are_joined_alike_however_the_stream_is_cut(cut, sent, tmp_path):
    (_, layout, imu, log_ns), mag = sent
    gyro, accel = (part[:3000] for part in awkward.halves(imu))
    slow = awkward.changed(accel, stamp_ns=accel["stamp_ns"] + 300_000)[::3]
    path = awkward.written(
        tmp_path / "b", [("/g", layout, gyro, log_ns[:3000]), ("/f", layout, slow, slow["stamp_ns"]), mag]
    )
    with Bag(path) as bag:
        topics = find_topics(bag, InputSettings())
        assert (topics.imu, topics.accelerometer, topics.kind) == ("/g", "/f", ImuKind.GYRO)
        whole = joined(InputStream(bag, topics, InputSettings()), bag.blocks(topics.all))
        parts = joined(InputStream(bag, topics, InputSettings()), bag.blocks(topics.all, block_messages=cut))
    assert whole.tobytes() == parts.tobytes()
    force = imu["linear_acceleration"][: len(whole)]
    assert np.abs(whole["linear_acceleration"][:1000] - force[:1000]).max() < 0.1


@pytest.mark.parametrize("cut", [37, 1000])
def test_halves_whose_samples_share_stamps_are_joined_by_the_times_of_the_sensor(cut, sent, tmp_path):
    (_, layout, imu, log_ns), mag = sent
    imu = awkward.changed(imu[:3000], stamp_ns=imu["stamp_ns"][:3000] // 16_000_000 * 16_000_000)
    gyro, accel = awkward.halves(imu)
    path = awkward.written(
        tmp_path / "b", [("/g", layout, gyro, log_ns[:3000]), ("/f", layout, accel, log_ns[:3000]), mag]
    )
    with Bag(path) as bag:
        topics = find_topics(bag, InputSettings())
        found = joined(InputStream(bag, topics, InputSettings()), bag.blocks(topics.all, block_messages=cut))
    assert (found["stamp_ns"] == imu["stamp_ns"]).all()
    assert (found["linear_acceleration"] == imu["linear_acceleration"]).all()


def joined(stream, blocks):
    found = [stream.take(block) for block in blocks] + [stream.finish()]
    return np.concatenate([block["/g"][1] for block in found if "/g" in block])


def linear(imu):
    """The IMU as a driver sends it that takes gravity off."""
    still = imu["linear_acceleration"][:1000].mean(axis=0)
    return awkward.changed(imu, linear_acceleration=imu["linear_acceleration"] - still)


def of_1980(samples):
    return awkward.changed(samples, stamp_ns=samples["stamp_ns"] - samples["stamp_ns"][0] + EPOCH_1980_NS)


def in_bursts(stamps):
    """Times of arrival of messages that come ten at a time."""
    k = np.arange(len(stamps))
    return stamps[np.minimum(k // 10 * 10 + 9, len(k) - 1)] + k % 10 * 100_000


def other_clock(path, sent, which):
    (_, _, imu, imu_ns), (_, _, mag, mag_ns), *rest = sent
    imu, mag = of_1980(imu) if "imu" in which else imu, of_1980(mag) if "mag" in which else mag
    return awkward.written(path, [(IMU, wire.IMU, imu, imu_ns), (MAG, wire.MAG, mag, mag_ns), *rest])


def one_imu(path, sent, imu, log_ns=None, name=IMU):
    at = imu["stamp_ns"] if log_ns is None else log_ns
    return awkward.written(path, [(name, wire.IMU, imu, at), sent[1]])


def two_imus(path, sent):
    _, _, imu, log_ns = sent[0]
    return awkward.written(path, [("/imu/data", wire.IMU, linear(imu), log_ns), ("/imu/raw", *sent[0][1:]), sent[1]])


# Name: recording, options that the command must have (None: `mwd process` refuses it), accepted surveys.
AWKWARD = {
    "sound": (awkward.written, [], 2),
    "half topics": (half_topics, [], 2),
    "gyro alone": (lambda p, s: one_imu(p, s, awkward.halves(s[0][2])[0]), None, 0),
    "in turns": (in_turns, [], 2),
    "zeros between": (zeros_between, [], 2),
    "gravity removed": (lambda p, s: one_imu(p, s, linear(s[0][2])), None, 0),
    "gravity removed beside raw": (two_imus, [], 2),
    "twice": (lambda p, s: twice(p, s, 300_000), [], 2),
    "imu of 1980": (lambda p, s: other_clock(p, s, "imu"), ["--stamps", "recording"], 2),
    "magnetometer of 1980": (lambda p, s: other_clock(p, s, "mag"), ["--stamps", "recording"], 2),
    "both of 1980": (lambda p, s: other_clock(p, s, "imu mag"), [], 2),
    "1980 in bursts": (
        lambda p, s: one_imu(p, s, of_1980(s[0][2]), in_bursts(s[0][3])),
        ["--stamps", "recording"],
        2,
    ),
    "bursts": (lambda p, s: one_imu(p, s, s[0][2], in_bursts(s[0][3])), [], 2),
    "in g": (in_g, ["--accel-unit", "g"], 2),
    "never at rest": (lambda p, s: one_imu(p, s, s[0][2][1700:2500]), [], 0),
}


# Two of them that are like others.
ALIKE = ("in turns", "magnetometer of 1980")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.nightly) if name in ALIKE else name for name in AWKWARD]
)
def test_what_inspect_promises_is_what_process_does(name, sent, tmp_path):
    write, options, accepted = AWKWARD[name]
    path = write(tmp_path / "b", sent)
    estimator = settings.changed(EstimatorSettings(), PLACE)
    with Bag(path) as bag:
        found = inspect(bag, InputSettings(), estimator, tmp_path / "out")
    if options is None:
        assert found.refusal
        assert found.command == ""
        with pytest.raises((BagError, ValueError)) as caught:
            run("process", str(path), "-o", str(tmp_path / "out"), *awkward.PLACE)
        assert str(caught.value) == found.refusal
        return
    words = shlex.split(found.command)
    assert words[5:-6] == options
    if options:
        # Without the options that inspect found, process refuses and names them.
        with pytest.raises(ValueError, match=" ".join(options)):
            run("process", str(path), "-o", str(tmp_path / "without"), *awkward.PLACE)
        # Every command that reads the sensors names them, and has them.
        for command in ("view {0}", "export {0} -f timeseries -o {1}", "batch {0} -o {1} --scheduler threads"):
            with pytest.raises((ValueError, typer.Exit), match=f"({' '.join(options)}|^1$)"):
                run(*command.format(path, tmp_path / "others").split())
    run(*words[1:])
    with (tmp_path / "out" / "surveys.csv").open(newline="") as file:
        verdicts = [row["verdict"] for row in csv.DictReader(file)]
    assert len(verdicts) == len(found.surveys)
    assert verdicts.count("accept") == found.surveys.count("accept") == accepted


@pytest.mark.parametrize(("pace", "gap"), [(10.0, slice(1500, 2200)), (0.5, slice(0, 700))])
def test_the_pace_at_which_a_run_with_a_gap_was_recorded_changes_nothing(pace, gap, sent, tmp_path):
    """A simulated run or a replay at another rate: the clock of the recorder runs at another speed than the sonde's."""
    kept = np.delete(np.arange(len(sent[1][2])), gap)
    streams = [sent[0], (MAG, sent[1][1], sent[1][2][kept], sent[1][3][kept])]
    begin = int(sent[0][3][0])
    paced = [(name, layout, rows, begin + ((at - begin) / pace).astype(np.int64)) for name, layout, rows, at in streams]
    at_its_pace = awkward.written(tmp_path / "a", streams)
    recorded = awkward.written(tmp_path / "b", paced)
    assert surveys(recorded) == surveys(at_its_pace)
    with Bag(recorded) as bag:
        found = inspect(bag, InputSettings(), settings.changed(EstimatorSettings(), PLACE), tmp_path / "out")
    assert "--stamps" not in found.command


def test_inspect_reports_the_true_rate_of_bursts(sent, tmp_path):
    imu, at = sent[0][2], in_bursts(sent[0][3])
    stamped = awkward.written(
        tmp_path / "b", [(IMU, wire.IMU, awkward.changed(imu, stamp_ns=at), at), (MAG, *sent[1][1:])]
    )
    with Bag(stamped) as bag:
        times = inspect(bag, InputSettings(), EstimatorSettings(), tmp_path).times
    assert times[IMU].rate == pytest.approx(100.0, rel=0.02)
    assert times[IMU].gaps == 0
    assert times[IMU].bursts
    assert not times[MAG].bursts


def run(*words):
    """Run a command; a status other than 0 or an error is raised."""
    status = app(list(words), standalone_mode=False)
    if status:
        raise typer.Exit(status)


# Name: encoding, what makes the bytes of a message, and the encoding and names of the definitions.
UNREADABLE = {
    "json": ("json", awkward.as_json, ("jsonschema", "sensor_msgs/msg/{}")),
    "protobuf": ("protobuf", awkward.as_protobuf, ("protobuf", "sensor_msgs/msg/{}")),
    "ros 1 under a ROS 2 type": ("ros1", awkward.ros1_bytes, ("ros2msg", "sensor_msgs/msg/{}")),
    "ros 1 said to be cdr": ("cdr", awkward.ros1_bytes, ("ros2msg", "sensor_msgs/msg/{}")),
    "json said to be cdr": ("cdr", awkward.as_json, ("ros2msg", "sensor_msgs/msg/{}")),
    "none": ("", awkward.as_protobuf, ("ros2msg", "sensor_msgs/msg/{}")),
}
# {bag} is the recording, {out} a place for results.
COMMANDS = {
    "inspect": "inspect {bag}",
    "process": "process {bag} -o {out}",
    "view": "view {bag}",
    "plot": "plot {bag} -o {out}.png",
    "calibrate": "calibrate {bag} -o {out}.yaml --gravity 9.81",
    "replay": "replay {bag}",
    "export": "export {bag} -f witsml -o {out}",
    "time_series": "export {bag} -f timeseries -o {out}",
    "bag_info": "bag info {bag}",
    "batch": "batch {bag} -o {out} --scheduler threads",
}


@pytest.mark.parametrize(
    ("kind", "others"),
    [
        *((kind, False) for kind in UNREADABLE),
        ("json", True),
        *(pytest.param(kind, True, marks=pytest.mark.nightly) for kind in UNREADABLE if kind != "json"),
    ],
)
def test_every_command_says_in_one_sentence_that_an_encoding_cannot_be_read(kind, others, sent, tmp_path, capsys):
    short = [(name, layout, one[:200], log_ns[:200]) for name, layout, one, log_ns in sent]
    path = awkward.encoded_mcap(tmp_path / "b.mcap", short, *UNREADABLE[kind])
    if others:
        path = awkward.with_a_string(path, tmp_path / "both.mcap")
    for name, words in COMMANDS.items():
        if others and name in ("bag_info", "replay"):
            # There is something to tell, and to publish.
            continue
        with pytest.raises((BagError, ValueError, typer.Exit)) as caught:
            run(*words.format(bag=path, out=tmp_path / name).split())
        said = capsys.readouterr().err + str(caught.value)
        assert "Traceback" not in said, name
        # A list or an attitude is not there in any encoding.
        assert IMU in said or (others and name in ("export", "time_series")), (name, said)
        assert "\n" not in str(caught.value)


def test_a_topic_that_cannot_be_read_stays_in_a_copy_with_the_estimates(sent, tmp_path):
    path = awkward.with_a_string(
        awkward.bare_mcap(tmp_path / "b.mcap", sent), tmp_path / "both.mcap", encoding="json", data=b'{"data": 1}'
    )
    run("process", str(path), "-o", str(tmp_path / "out"), "-f", "mcap", *awkward.PLACE)
    with Bag(tmp_path / "out" / "merged") as merged:
        assert merged.unreadable["/words"].count == 5
        assert "/words" not in merged.topics
