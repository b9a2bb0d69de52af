# SPDX-License-Identifier: Apache-2.0
"""Recordings whose clocks, publishers or files go wrong midway: the sound surveys, or the option for them."""

import functools
import shutil
from types import SimpleNamespace

import awkward_bags as awkward
import numpy as np
import pytest
import zstandard
from awkward_bags import IMU, MAG
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings as parameters
from mwd_sensors.core import wire
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.processing.bag_estimate import BagEstimate
from mwd_surface.processing.bag_input import FIELDS, InputSettings, OptionNeededError, find_topics
from mwd_surface.processing.input_stream import InputStream
from mwd_surface.processing.stream_times import StreamTimes

pytestmark = pytest.mark.slow(1)

# The day of the field is that of the recording.
surveys = functools.partial(awkward.surveys, day="")
SECOND = wire.NANOSECONDS
# Each example writes a recording and reads it.
on_recordings = settings(
    max_examples=settings().max_examples // 4,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def read_samples(path, name, **wanted):
    """Samples of a topic as the estimator takes them."""
    with Bag(path) as bag:
        input_settings = parameters.from_mapping(InputSettings, wanted)
        stream = InputStream(bag, find_topics(bag, input_settings), input_settings)
        return np.concatenate([block[name][1] for block in stream.blocks() if name in block])


def written(folder, streams):
    """Write streams to a new bag in a folder that examples share."""
    shutil.rmtree(folder / "bag", ignore_errors=True)
    return awkward.written(folder / "bag", streams)


def set_midway(stream, after_s, by_s):
    """A stream whose sensor's clock is set to another time while it records."""
    name, layout, samples, log_ns = stream
    later = log_ns - log_ns[0] > after_s * SECOND
    return name, layout, awkward.changed(samples, stamp_ns=samples["stamp_ns"] + later * round(by_s * SECOND)), log_ns


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("by_s", [30.0, -30.0])
def test_a_clock_that_is_set_midway_is_refused_with_the_option_that_restores_the_surveys(
    which, by_s, sent, expected, tmp_path
):
    streams = list(sent)
    streams[which] = set_midway(streams[which], 20.0, by_s)
    path = awkward.written(tmp_path / "bag", streams)
    with pytest.raises(OptionNeededError, match="--stamps recording"):
        surveys(path)
    assert surveys(path, stamps="recording") == expected


@pytest.mark.parametrize("tick_s", [0.016, 0.08])
def test_a_recording_whose_samples_share_stamps_has_the_rate_and_the_surveys_of_the_sensor(
    tick_s, sent, expected, tmp_path
):
    tick = round(tick_s * SECOND)
    streams = [
        (name, layout, awkward.changed(samples, stamp_ns=samples["stamp_ns"] // tick * tick), at)
        for name, layout, samples, at in sent
    ]
    path = awkward.written(tmp_path / "bag", streams)
    for one, other in zip(surveys(path), expected, strict=True):
        assert one[1] == other[1]
        assert one[2:5] == pytest.approx(other[2:5], abs=1e-3)
    times = StreamTimes()
    for part in np.array_split(streams[0][2]["stamp_ns"], 7):
        times.take(part, part)
    assert times.rate == pytest.approx(100.0, rel=0.02)
    assert (times.backwards, times.gaps, times.bursts) == (0, 0, False)


@pytest.mark.parametrize("speed", [0.5, 2.0, 20.0])
def test_a_run_at_another_speed_has_its_surveys_and_no_clock_that_is_ahead(speed, sent, expected, tmp_path):
    """`mwd run --rate 2`: the stamps advance twice as fast as the recorder's clock."""
    streams = [(name, layout, samples, at[0] + (at - at[0]) / speed) for name, layout, samples, at in sent]
    path = awkward.written(tmp_path / "bag", [(*one, at.astype(np.int64)) for *one, at in streams])
    assert surveys(path) == expected
    times = StreamTimes()
    with Bag(path) as bag:
        for block in bag.blocks([IMU], block_messages=100):
            times.take(block[IMU][1]["stamp_ns"], block[IMU][0])
    (remark,) = times.remarks()
    assert f"runs {speed:.2f} times as fast" in remark
    if len(sent[0][3]) / 100.0 / speed > 30.0:
        with pytest.raises(ValueError, match="another speed"):
            surveys(path, stamps="recording")


@on_recordings
@given(
    which=st.sampled_from([0, 1]),
    after_s=st.floats(0.5, 39.0),
    by_s=st.sampled_from([-1.5e9, -40.0, -3.0, 3.0, 40.0, 1.5e9]),
)
def test_times_of_the_recording_do_not_depend_on_when_a_clock_was_set(which, after_s, by_s, sent, tmp_path):
    streams = list(sent)
    streams[which] = set_midway(streams[which], after_s, by_s)
    path = written(tmp_path, streams)
    name, _, samples, _ = sent[which]
    found = read_samples(path, name, stamps="recording")["stamp_ns"]
    assert np.isin(found, samples["stamp_ns"]).all()
    # A coarse sensor may read the same at a time that comes again within seconds: taken for the same sample.
    assert len(found) >= len(samples) - 3


@on_recordings
@given(seed=st.integers(0, 2**32 - 1), late_ms=st.floats(0.1, 300.0), jitter_ms=st.floats(0.0, 20.0))
def test_a_second_publisher_with_stamps_of_its_own_changes_no_sample(seed, late_ms, jitter_ms, sent, tmp_path):
    imu, mag = sent
    _, layout, samples, log_ns = imu
    late = 1e6 * (late_ms + np.random.default_rng(seed).uniform(0.0, jitter_ms, len(samples)))
    stamps = samples["stamp_ns"] + late.astype(np.int64)
    both = np.concatenate([samples, awkward.changed(samples, stamp_ns=stamps)])
    path = written(tmp_path, [(IMU, layout, both, np.concatenate([log_ns, stamps])), mag])
    found = read_samples(path, IMU)
    assert np.array_equal(found["stamp_ns"], samples["stamp_ns"])
    assert np.array_equal(found["angular_velocity"], samples["angular_velocity"])


@on_recordings
@given(late_ms=st.floats(0.0, 300.0), own_stamps=st.booleans(), cut=st.sampled_from([1, 5, 400]))
def test_the_live_estimator_takes_the_samples_that_processing_takes(late_ms, own_stamps, cut, sent, tmp_path):
    pytest.importorskip("rclpy")
    from mwd_estimation.nodes.inputs import InputTopics
    from mwd_sensors.ros.message_buffer import ReceivedMessage

    imu, mag = sent
    _, layout, samples, log_ns = imu
    late = round(1e6 * late_ms)
    copies = awkward.changed(samples, stamp_ns=samples["stamp_ns"] + late) if own_stamps else samples
    both = np.concatenate([samples[:1000], copies[:1000]])
    path = written(tmp_path, [(IMU, layout, both, np.concatenate([log_ns[:1000], log_ns[:1000] + late])), mag])
    waiting: list[ReceivedMessage] = []
    silent = SimpleNamespace(drain=list)
    node = SimpleNamespace(
        add_buffered_subscription=lambda _kind, topic, _qos: (
            SimpleNamespace(drain=lambda: [waiting.pop(0) for _ in range(len(waiting))])
            if topic == "imu/data_raw"
            else silent
        ),
        add_subscription=lambda *_, **__: None,
    )
    inputs, taken = InputTopics(node), []
    with Bag(path) as bag:
        messages = [ReceivedMessage(data, 0) for _, _, _, data in bag.messages([IMU])]
    for k in range(0, len(messages), cut):
        waiting += messages[k : k + cut]
        taken.append(inputs.take("imu/data_raw"))
    live, processed = np.concatenate(taken), read_samples(path, IMU)
    for name in ("stamp_ns", "angular_velocity", "linear_acceleration"):
        assert live[name].tobytes() == processed[name].tobytes()


@pytest.mark.parametrize("by_s", [-2.0, 2.0])
def test_a_magnetometer_that_is_off_by_seconds_for_a_while_is_not_paired_there_and_named(
    by_s, sent, expected, tmp_path
):
    (_, layout, imu, log_ns), (_, field, mag, mag_ns) = sent
    path = awkward.written(tmp_path / "bag", [(IMU, layout, imu, log_ns), (MAG, field, mag, mag_ns)])
    with Bag(path) as bag:
        estimator = parameters.changed(EstimatorSettings(), awkward.PLACE_SETTINGS)
        run = BagEstimate(bag, estimator, InputSettings())
        taken = []
        for k, block in enumerate(bag.blocks(run.topics.all, block_messages=900, fields=FIELDS)):
            if MAG in block and k % 2:
                block[MAG][1]["stamp_ns"] += round(by_s * SECOND)
            samples = {name: part[1] for name, part in block.items()}
            run._leave_out_skewed(samples, block)
            taken.append(MAG in samples)
    assert taken == [k % 2 == 0 for k in range(len(taken))]
    (said,) = [text for text in run._summary.warnings if "seconds" in text]
    assert said.startswith(f"{MAG}: the stamps are seconds {'ahead of' if by_s > 0 else 'behind'} the stamps of {IMU}")


@on_recordings
@given(which=st.sampled_from([0, 1]), lag_ms=st.integers(1, 30), first=st.booleans())
def test_a_second_unit_in_another_frame_is_left_out_as_live(which, lag_ms, first, sent, tmp_path):
    name, layout, samples, log_ns = sent[which]
    rows = [(int(at), "imu_link", row) for at, row in zip(log_ns, samples, strict=True)]
    later = log_ns + lag_ms * 1_000_000 * (1 if first else -1)
    rows += [(int(at), "spare_link", row) for at, row in zip(later, awkward.mirrored(samples), strict=True)]
    shutil.rmtree(tmp_path / "two", ignore_errors=True)
    with BagWriter(tmp_path / "two") as bag:
        topic = bag.topic(name, layout.type_name)
        for at, frame, row in sorted(rows[:2000] + rows[len(log_ns) : len(log_ns) + 2000], key=lambda one: one[0]):
            bag.write(topic, layout.encode(np.array([row]), frame)[0].tobytes(), at)
        if which == 1:
            _, layout, imu, at = sent[0]
            bag.write_rows(bag.topic(IMU, layout.type_name), layout.encode(imu, "imu_link"), at)
    expected = samples[:2000] if first else awkward.mirrored(samples)[:2000]
    found = read_samples(tmp_path / "two", name)
    vector = "angular_velocity" if which == 0 else "magnetic_field"
    assert np.array_equal(found[vector], expected[vector])


def test_a_coarse_sensor_that_repeats_itself_loses_no_sample(sent, tmp_path):
    imu, mag = sent
    samples = awkward.changed(imu[2], angular_velocity=0.0, linear_acceleration=np.round(imu[2]["linear_acceleration"]))
    path = awkward.written(tmp_path / "bag", [(IMU, imu[1], samples, imu[3]), mag])
    assert len(read_samples(path, IMU)) == len(samples)


def test_samples_before_the_clock_has_a_time_are_left_out(sent, tmp_path):
    early = [(name, layout, awkward.changed(samples), log_ns) for name, layout, samples, log_ns in sent]
    for _, _, samples, _ in early:
        samples["stamp_ns"][:100] = 0
    path = awkward.written(tmp_path / "bag", early)
    assert np.array_equal(read_samples(path, IMU)["stamp_ns"], sent[0][2]["stamp_ns"][100:])
    assert [one[1] for one in surveys(path)] == ["accept"] * 2


def test_a_clock_that_was_never_set_is_refused_where_the_field_needs_the_day(sent, expected, tmp_path):
    unset = [
        (name, layout, awkward.changed(samples, stamp_ns=samples["stamp_ns"] - log_ns[0] + 5 * SECOND), log_ns)
        for name, layout, samples, log_ns in sent
    ]
    path = awkward.written(tmp_path / "bag", unset)
    with pytest.raises(OptionNeededError, match="--stamps recording"):
        surveys(path)
    assert [one[1] for one in surveys(path, stamps="recording")] == [one[1] for one in expected]


def test_an_empty_topic_of_the_usual_name_does_not_hide_the_imu(sent, expected, tmp_path):
    (_, layout, imu, log_ns), (_, field, mag, times) = sent
    streams = [(IMU, layout, imu[:0], log_ns[:0]), ("/real/imu", layout, imu, log_ns), ("/real/mag", field, mag, times)]
    assert surveys(awkward.written(tmp_path / "bag", streams)) == expected


@pytest.mark.parametrize("storage", ["mcap", "db3"])
def test_messages_compressed_one_by_one_are_read_without_the_metadata_that_says_so(storage, sent, expected, tmp_path):
    pack = zstandard.ZstdCompressor().compress
    if storage == "mcap":
        path = awkward.encoded_mcap(tmp_path / "x.mcap", sent, "cdr", lambda data, _: pack(data))
    else:
        import sqlite3

        path = next(awkward.db3(tmp_path / "bag", sent).glob("*.db3"))
        with sqlite3.connect(path) as database:
            database.create_function("pack", 1, pack)
            database.execute("UPDATE messages SET data = pack(data)")
    assert surveys(path) == expected


def test_a_type_named_as_by_the_first_releases_is_the_same_type(sent, expected, tmp_path):
    path = awkward.encoded_mcap(tmp_path / "x.mcap", sent, "cdr", lambda data, _: data, ("ros2msg", "sensor_msgs/{}"))
    with Bag(path) as bag:
        assert bag.topics[MAG].type_name == wire.MAG.type_name
    assert surveys(path) == expected
