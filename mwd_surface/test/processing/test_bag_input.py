# SPDX-License-Identifier: Apache-2.0
"""What of a bag goes into the estimator: which topics, in which units, and whether the recording is whole."""

import numpy as np
import pytest

from mwd_sensors.core import wire
from mwd_sensors.core.mount import MountSettings
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.processing import bag_input
from mwd_surface.processing.bag_input import InputSettings, Topics, find_topics, guesses
from mwd_surface.processing.input_stream import InputStream

START = 1_772_344_800_000_000_000
IMU, MAG, RIG = wire.IMU, wire.MAG, wire.RIG_STATE


def written(path, *topics):
    """A bag of 20 messages each of (topic, layout) or (topic, layout, frame)."""
    with BagWriter(path) as bag:
        for name, layout, *frame in topics:
            rows = layout.empty(20)
            rows["stamp_ns"] = START + np.arange(20) * 10_000_000
            channel = bag.topic(name, layout.type_name)
            bag.write_rows(channel, layout.encode(rows, *(frame or ("x",))), rows["stamp_ns"])
    return path


def found(path, **given):
    with Bag(path) as bag:
        return find_topics(bag, InputSettings(**given))


def test_the_topics_of_the_well_are_those_beside_its_imu(tmp_path):
    bag = written(
        tmp_path / "bag",
        ("/rig/well_7/imu/data_raw", IMU),
        ("/rig/well_7/imu/mag", MAG),
        ("/rig/well_7/gyro/data_raw", IMU),
        ("/rig/well_8/imu/mag", MAG),
        ("/rig/well_7/rig/state", RIG),
    )
    topics = found(bag)
    assert topics == Topics(
        "/rig/well_7/imu/data_raw",
        "/rig/well_7/imu/mag",
        "/rig/well_7/gyro/data_raw",
        None,
        "/rig/well_7/rig/state",
    )
    assert None not in topics.all
    assert len(topics.all) == 4


def test_two_wells_must_be_distinguished(tmp_path):
    bag = written(tmp_path / "bag", ("/a/imu/data_raw", IMU), ("/b/imu/data_raw", IMU), ("/b/imu/mag", MAG))
    with pytest.raises(BagError, match=r"2 topics .* choose one with --imu-topic"):
        found(bag)
    assert found(bag, imu_topic="b/imu/data_raw") == Topics("/b/imu/data_raw", "/b/imu/mag", None, None, None)
    assert found(bag, imu_topic="/a/imu/data_raw").mag is None
    assert found(bag, imu_topic="/a/imu/data_raw", mag_topic="/b/imu/mag").mag == "/b/imu/mag"


def test_an_imu_of_any_name_has_the_only_magnetometer_that_can_be_its_own(tmp_path):
    one = written(tmp_path / "one", ("/phone", IMU), ("/compass/imu/mag", MAG))
    assert found(one, imu_topic="/phone").mag == "/compass/imu/mag"
    two = written(tmp_path / "two", ("/phone", IMU), ("/a/imu/mag", MAG), ("/b/imu/mag", MAG))
    assert found(two, imu_topic="/phone").mag is None


def test_the_only_sensors_of_a_recording_are_taken_under_any_name_and_that_is_reported(tmp_path):
    path = written(tmp_path / "one", ("/tool/imu", IMU), ("/tool/magnetic_field", MAG), ("/driller", RIG))
    with Bag(path) as bag:
        topics = find_topics(bag, InputSettings())
        assert topics == Topics("/tool/imu", "/tool/magnetic_field", None, None, "/driller")
        remarks = guesses(bag, topics, InputSettings())
    assert [remark.split(" ")[0] for remark in remarks] == ["/tool/imu", "/tool/magnetic_field"]
    assert all("the recording has no other" in remark for remark in remarks)


def test_what_could_be_either_is_asked_for_with_the_option_that_tells(tmp_path):
    path = written(tmp_path / "two", ("/imu", IMU), ("/fog", IMU), ("/a/mag", MAG), ("/b/mag", MAG))
    with pytest.raises(BagError, match=r"2 topics that may be the IMU: /imu, /fog.*--imu-topic"):
        found(path)
    given = InputSettings(imu_topic="/imu")
    with Bag(path) as bag:
        topics = find_topics(bag, given)
        assert topics == Topics("/imu", None, None, None, None)
        no_mag, no_gyro = guesses(bag, topics, given)
    assert no_mag == "no magnetometer next to /imu; choose one with --mag-topic: /a/mag, /b/mag"
    assert no_gyro == "not used: /fog; choose the precision unit with --gyro-topic"
    named = found(path, imu_topic="/imu", mag_topic="/b/mag", gyro_topic="/fog")
    assert named == Topics("/imu", "/b/mag", "/fog", None, None)


def test_another_wells_sensor_is_not_taken_for_the_only_one(tmp_path):
    path = written(tmp_path / "bag", ("/a/imu/data_raw", IMU), ("/b/imu/mag", MAG), ("/b/rig/state", RIG))
    assert found(path) == Topics("/a/imu/data_raw", None, None, None, None)


def test_messages_without_a_time_of_their_own_are_known_by_their_first(tmp_path):
    def stamped(name, imu_ns, mag_ns):
        with BagWriter(tmp_path / name) as bag:
            for topic, layout, stamps in (("/imu/data_raw", IMU, imu_ns), ("/imu/mag", MAG, mag_ns)):
                rows = layout.empty(len(stamps))
                rows["stamp_ns"] = stamps
                logged = START + np.arange(len(stamps)) * 10_000_000
                bag.write_rows(bag.topic(topic, layout.type_name), layout.encode(rows, "x"), logged)
        with Bag(tmp_path / name) as bag:
            topics = find_topics(bag, InputSettings())
            stream = InputStream(bag, topics, InputSettings())
            return stream.without_time, next(stream.blocks())

    none, samples = stamped("none", np.zeros(20), np.zeros(1))
    assert none == {"/imu/data_raw", "/imu/mag"}
    assert samples["/imu/data_raw"][1]["stamp_ns"].tolist() == [START + k * 10_000_000 for k in range(20)]
    assert stamped("stuck", np.full(20, START), np.arange(20))[0] == {"/imu/data_raw"}
    clock, samples = stamped("clock that begins at zero", np.arange(20) * 10_000_000, np.zeros(1))
    assert clock == frozenset()
    assert samples["/imu/data_raw"][1]["stamp_ns"].tolist() == [k * 10_000_000 for k in range(1, 20)]


def test_a_topic_of_another_type_or_none_is_refused(tmp_path):
    bag = written(tmp_path / "bag", ("/imu/data_raw", IMU), ("/imu/mag", MAG))
    with pytest.raises(BagError, match="expected a sensor_msgs/msg/Imu"):
        found(bag, imu_topic="/imu/mag")
    with pytest.raises(BagError, match="has no topic /other; it has /imu/data_raw"):
        found(bag, mag_topic="/other")


def block(force=9.8, rate=0.01, field=5e-5):
    imu, mag = IMU.empty(4), MAG.empty(4)
    imu["linear_acceleration"][:, 0], imu["angular_velocity"][:, 1] = force, rate
    mag["magnetic_field"][:, 2] = field
    return {"i": (np.arange(4), imu), "m": (np.arange(4), mag)}


TOPICS = Topics("i", "m", None, None, None)


def test_samples_come_in_si_whatever_unit_they_were_in():
    given = InputSettings(accel_unit="g", gyro_unit="deg/s", mag_unit="uT")
    samples = bag_input.in_si(block(1.0, 180.0, 50.0), TOPICS, given)
    assert samples["i"][1]["linear_acceleration"][:, 0] == pytest.approx(9.80665)
    assert samples["i"][1]["angular_velocity"][:, 1] == pytest.approx(np.pi)
    assert samples["m"][1]["magnetic_field"][:, 2] == pytest.approx(5e-5)


def test_samples_in_si_are_left_as_they_are_bit_for_bit():
    there = block(9.123456789)
    before = there["i"][1].tobytes()
    assert bag_input.in_si(there, TOPICS, InputSettings())["i"][1].tobytes() == before


def first(**readings):
    return {name: part[1] for name, part in block(**readings).items()}


@pytest.mark.fault_case(12)
def test_other_units_are_refused_in_one_sentence_with_the_options_to_say_so():
    assert bag_input.check_units(TOPICS, first()) == []
    with pytest.raises(ValueError, match=r"^i: .* looks like g; set the unit with --accel-unit g$"):
        bag_input.check_units(TOPICS, first(force=1.0))
    with pytest.raises(ValueError, match=r"i: .* g; m: .* uT; set the unit with --accel-unit g --mag-unit uT$"):
        bag_input.check_units(TOPICS, first(force=1.0, field=50.0))


def test_a_magnetometer_that_is_none_in_any_unit_says_what_to_do():
    (reason,) = bag_input.check_units(TOPICS, first(field=0.0))
    assert reason.startswith("m: ")
    assert "check the magnetometer" in reason


@pytest.mark.fault_case(11)
def test_frames_that_differ_without_a_transform_leave_the_magnetometer_out_and_name_both(tmp_path):
    same = written(tmp_path / "same", ("/imu/data_raw", IMU, "a"), ("/imu/mag", MAG, "a"))
    other = written(tmp_path / "other", ("/imu/data_raw", IMU, "a"), ("/imu/mag", MAG, "b"))
    unnamed = written(tmp_path / "unnamed", ("/imu/data_raw", IMU, ""), ("/imu/mag", MAG, "b"))
    for path in (same, unnamed):
        with Bag(path) as bag:
            assert bag_input.mount_of(bag, find_topics(bag, InputSettings()), MountSettings()).unusable == {}
    with Bag(other) as bag:
        topics = find_topics(bag, InputSettings())
        why = bag_input.mount_of(bag, topics, MountSettings()).unusable
        assert list(why) == ["mag"]
        assert "it is in 'b', the IMU in 'a'" in why["mag"]
        assert bag_input.mount_of(bag, topics, MountSettings(mag="x-down")).unusable == {}
        with pytest.raises(BagError, match="/imu/data_raw: no static transform leads from 'a' to 'sonde_link'"):
            bag_input.mount_of(bag, topics, MountSettings(imu="tf"))


@pytest.mark.parametrize("lost", [1, 8, 400])
def test_a_recording_without_its_end_is_refused_unless_a_part_will_do(tmp_path, lost):
    file = next(written(tmp_path / "bag", ("/imu/data_raw", IMU)).glob("*.mcap"))
    with Bag(tmp_path / "bag") as bag:
        bag_input.refuse_damaged(bag, InputSettings())
    file.write_bytes(file.read_bytes()[:-lost])
    with Bag(tmp_path / "bag") as bag:
        with pytest.raises(BagError, match=r"cut off or damaged.*mwd recover .* --partial"):
            bag_input.refuse_damaged(bag, InputSettings())
        bag_input.refuse_damaged(bag, InputSettings(partial=True))
