# SPDX-License-Identifier: Apache-2.0
"""What the estimator says of its input topics: rate, skew, covariances; and what covariances cannot do."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.nodes import diagnostics
from mwd_estimation.nodes.inputs import InputTopics
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place
from mwd_sensors.core import wire
from mwd_sensors.core.input_covariance import judge
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import OK, WARN
from mwd_sensors.ros.message_buffer import ReceivedMessage

PLACE = Place(field="fixed", total_nt=45826.0, dip_deg=-17.45, declination_deg=0.0)
START = 1_772_344_800_000_000_000


def waiting(messages):
    """A buffer whose messages can be drained once."""
    left = [list(messages)]
    return SimpleNamespace(drain=lambda: left.pop() if left else [])


def topics(**samples):
    """Input topics whose messages of these samples have been taken."""
    node = SimpleNamespace(
        add_buffered_subscription=lambda *_: waiting([]),
        add_subscription=lambda *_, **__: None,
        get_logger=lambda: SimpleNamespace(warning=lambda *_, **__: None),
        resolve_topic_name=lambda name: f"/{name}",
        get_publishers_info_by_topic=lambda _name: [],
        frame=lambda name: name,
    )
    inputs = InputTopics(node)
    for name, rows in samples.items():
        arrive(inputs, name.replace("__", "/"), rows)
    return inputs


def arrive(inputs, topic, rows, frame="sonde_link"):
    """Take messages of these samples."""
    encoded = wire.SONDE_TOPICS[topic].encode(rows, frame)
    inputs._buffers[topic] = waiting([ReceivedMessage(row.tobytes(), 0) for row in encoded])
    return inputs.take(topic)


def stamped(layout, n=40, hz=100.0, later_s=0.0):
    rows = layout.empty(n)
    rows["stamp_ns"] = START + round(later_s * 1e9) + (np.arange(n) * 1e9 / hz).astype(np.int64)
    return rows


@pytest.fixture
def now(monkeypatch):
    """The time of the node, s, that the test sets; kernels that are compiled meanwhile would make a topic silent."""
    times = [1000.0]
    monkeypatch.setattr("mwd_estimation.nodes.inputs.time.monotonic", lambda: times[0])
    return times


@pytest.mark.fault_case(50)
def test_a_rate_that_a_turning_string_outruns_is_named(now):
    slow = topics(imu__data_raw=stamped(wire.IMU, hz=1.0)).diagnostic("imu/data_raw", 40, b"\x02")
    assert slow.level == WARN
    assert "rate too low: 1.0 Hz" in slow.message
    sound = topics(imu__data_raw=stamped(wire.IMU)).diagnostic("imu/data_raw", 40, b"\x02")
    assert sound.level == OK


@pytest.mark.fault_case(50)
def test_a_queue_that_was_full_is_named_and_forgotten(now):
    levels = []
    for waiting_samples in (qos.LONG_QUEUE - 1, qos.LONG_QUEUE):
        inputs = topics(imu__data_raw=stamped(wire.IMU, waiting_samples, 1000.0))
        levels.append(inputs.diagnostic("imu/data_raw", waiting_samples, b"\x02").level)
    now[0] += 60.0
    arrive(inputs, "imu/data_raw", stamped(wire.IMU, 1000, 1000.0, later_s=60.0))
    levels.append(inputs.diagnostic("imu/data_raw", 1, b"\x02").level)
    assert levels == [OK, WARN, OK]


@pytest.mark.fault_case(48, 49)
@pytest.mark.parametrize("hz", [50.0, 100.0, 1000.0])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.5])
def test_the_share_of_lost_samples_is_shown(hz, share):
    rng = np.random.default_rng(3)
    rows = stamped(wire.IMU, 4000, hz)
    # A clock that is uneven by some per cent of a period loses nothing.
    rows["stamp_ns"] += rng.normal(0.0, 0.02e9 / hz, len(rows)).astype(np.int64)
    found = topics(imu__data_raw=rows[rng.random(len(rows)) >= share]).diagnostic("imu/data_raw", 1, b"\x02")
    shown = float(dict(found.values)["lost_percent"])
    assert abs(shown - 100.0 * share) < 8.0
    assert ("samples were lost" in found.message) == (share > 0.0)


def test_stamps_of_a_clock_that_jitters_by_periods_show_no_loss():
    rows = stamped(wire.IMU, 1000)
    rows["stamp_ns"] = np.sort(rows["stamp_ns"] + np.random.default_rng(1).integers(0, 200_000_000, 1000))
    assert topics(imu__data_raw=rows).diagnostic("imu/data_raw", 1, b"\x02").level == OK


@pytest.mark.fault_case(51)
@pytest.mark.parametrize(
    ("later_s", "words"), [(12.0, "12.0 s ahead of"), (1.5, "1.5 s ahead of"), (-12.0, "12.0 s behind")]
)
def test_a_magnetometer_on_another_clock_is_named_and_not_used_until_it_is_right_again(later_s, words):
    inputs, used = topics(), []
    for k in range(90):
        arrive(inputs, "imu/data_raw", stamped(wire.IMU, 1, later_s=0.01 * k))
        off = later_s if 30 <= k < 60 else 0.02
        used.append(len(arrive(inputs, "imu/mag", stamped(wire.MAG, 1, later_s=0.01 * k + off))))
        if k == 59:
            (found,) = inputs.skew_diagnostics()
            assert words in found.message
    assert used[:30] == [1] * 30
    assert used[34:60] == [0] * 26
    assert used[60:] == [1] * 30
    assert inputs.skew_diagnostics() == []


def test_a_magnetometer_goes_on_while_the_imu_does_not_come():
    inputs = topics(imu__data_raw=stamped(wire.IMU))
    assert all(len(arrive(inputs, "imu/mag", stamped(wire.MAG, 1, later_s=0.1 * k))) == 1 for k in range(60))


def test_a_magnetometer_that_falls_silent_is_not_taken_for_one_on_another_clock():
    inputs = topics(imu__data_raw=stamped(wire.IMU), imu__mag=stamped(wire.MAG))
    arrive(inputs, "imu/data_raw", stamped(wire.IMU, later_s=5.0))
    assert inputs.skew_diagnostics() == []


@pytest.mark.fault_case(11, 53)
def test_a_second_unit_on_a_topic_is_named_and_left_out_and_leaves_no_trace(now):
    inputs = topics(imu__mag=stamped(wire.MAG))
    own = inputs.frames["imu/mag"]

    def send(*frames):
        now[0] += 0.1
        sample = stamped(wire.MAG, 1, later_s=now[0])
        rows = [wire.MAG.encode(sample, frame)[0].tobytes() for frame in frames]
        inputs._buffers["imu/mag"] = waiting([ReceivedMessage(row, 0) for row in rows])
        return len(inputs.take("imu/mag"))

    key = inputs.mount_key
    # The order in which the two come makes no difference.
    for k in range(120):
        assert send(*((own, "foreign"), ("foreign", own), ("foreign",))[k % 3]) == int(k % 3 < 2)
        assert inputs.mount_key == key
        (found,) = inputs.frame_diagnostics()
        assert "two units" in found.message
        assert own in found.message
        assert "foreign" in found.message
    for _ in range(60):
        assert send(own) == 1
    assert inputs.frame_diagnostics() == []
    assert inputs.mount_key == key


def test_copies_of_a_second_publisher_are_named_and_not_used_until_it_leaves(now):
    inputs, sound = topics(), stamped(wire.IMU, 300)
    sound["angular_velocity"][:, 0] = np.arange(300.0)
    for k in range(0, 200, 10):
        now[0] += 0.1
        both = np.concatenate([sound[k : k + 10], sound[k : k + 10]])
        assert np.array_equal(arrive(inputs, "imu/data_raw", both), sound[k : k + 10])
    (found,) = inputs.repeat_diagnostics()
    assert "200 samples came a second time" in found.message
    now[0] += 6.0
    assert np.array_equal(arrive(inputs, "imu/data_raw", sound[200:]), sound[200:])
    assert inputs.repeat_diagnostics() == []


def test_the_frame_of_an_exchanged_unit_is_followed_once_the_old_one_is_silent(now):
    inputs, used = topics(imu__mag=stamped(wire.MAG)), []
    for _ in range(40):
        now[0] += 0.1
        arrive(inputs, "imu/mag", stamped(wire.MAG, 1), "new_link")
        used.append(inputs.frames["imu/mag"])
    assert used[18] == "sonde_link"
    assert set(used[20:]) == {"new_link"}
    now[0] += 5.0
    assert inputs.frame_diagnostics() == []


@pytest.mark.fault_case(14, 15)
def test_what_covariances_declare_is_in_the_diagnostics():
    imu = stamped(wire.IMU)
    imu["angular_velocity_covariance"][:, 0] = -1.0
    imu["linear_acceleration_covariance"][:, 4] = -3.0
    rates, forces = (one for one in topics(imu__data_raw=imu).covariance_diagnostics() if one.level == WARN)
    assert "angular_velocity is declared not provided" in rates.message
    assert "linear_acceleration comes with no covariance" in forces.message


@pytest.mark.fault_case(13, 17)
@pytest.mark.parametrize("orientation", [[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 2.0]])
def test_unknown_covariances_and_an_orientation_are_noted_once(orientation):
    imu, mag = stamped(wire.IMU, 40), stamped(wire.MAG, 40)
    imu["orientation"] = orientation
    found = topics(imu__data_raw=imu, imu__mag=mag).covariance_diagnostics()
    assert {one.level for one in found} == {OK}
    assert [one.name for one in found] == ["unknown covariances", "orientation imu/data_raw"]
    assert all(name in found[0].message for name in ("angular_velocity", "linear_acceleration", "magnetic_field"))
    imu["orientation_covariance"][:, 0] = -1.0
    imu["angular_velocity_covariance"] = imu["linear_acceleration_covariance"] = diagonal(1e-3)
    mag["magnetic_field_covariance"] = diagonal(1e-7)
    assert topics(imu__data_raw=imu, imu__mag=mag).covariance_diagnostics() == []


def still(n=4000):
    rng = np.random.default_rng(0)
    imu, mag = stamped(wire.IMU, n), stamped(wire.MAG, n)
    imu["linear_acceleration"] = np.array([-7.0, 0.0, 6.87]) + rng.normal(scale=1e-3, size=(n, 3))
    imu["angular_velocity"] = rng.normal(scale=1e-4, size=(n, 3))
    mag["magnetic_field"] = np.array([2e-5, 1e-5, 4e-5]) + rng.normal(scale=1e-8, size=(n, 3))
    return imu, mag


def estimated(imu, mag, **settings):
    pipeline = Pipeline(EstimatorSettings(**settings))
    pipeline.push_mag(judge(mag, wire.MAG.type_name).samples)
    output = pipeline.push_imu(judge(imu, wire.IMU.type_name).samples)
    return pipeline, output, [*output.surveys, *pipeline.finish().surveys]


def diagonal(sigma):
    """A covariance with these sigmas of its axes."""
    return (sigma**2 * np.eye(3)).ravel()


@pytest.mark.fault_case(16, 17)
def test_overconfident_covariances_and_any_orientation_change_no_bit_of_the_estimate():
    imu, mag = still()
    plain = estimated(imu, mag)[1].attitude
    imu["orientation"] = np.random.default_rng(1).normal(size=(len(imu), 4))
    imu["orientation"][::2] = 0.0
    for name in ("angular_velocity_covariance", "linear_acceleration_covariance"):
        imu[name] = diagonal(1e-9)
    mag["magnetic_field_covariance"] = diagonal(1e-15)
    assert estimated(imu, mag)[1].attitude.tobytes() == plain.tobytes()


def noisy(vector=None, sigma=0.0):
    """The pipeline, the last row and the survey of a tool at rest whose messages state this noise of a vector."""
    imu, mag = still()
    if vector:
        (mag if vector == "magnetic_field" else imu)[f"{vector}_covariance"] = diagonal(sigma)
    pipeline, output, surveys = estimated(imu, mag, place=PLACE)
    return pipeline, output.attitude[-1], surveys[0]


@pytest.mark.parametrize(
    ("vector", "sigma", "words"),
    [
        ("angular_velocity", 0.05, "states 17 deg/sqrt(h)"),
        ("linear_acceleration", 3.0, "states 3 m/s^2 per sample"),
        ("magnetic_field", 2e-5, "states 20000 nT per sample"),
    ],
)
def test_a_covariance_larger_than_the_tools_widens_the_sigmas_and_is_named(vector, sigma, words):
    (_, plain, survey), (pipeline, wide, widened) = noisy(), noisy(vector, sigma)
    (shown,) = diagnostics.input_diagnostics(pipeline)
    assert words in shown.message
    assert [shown.message] == pipeline.noise_notes
    angle = "sigma_azimuth" if vector == "magnetic_field" else "sigma_inclination"
    assert wide[angle] > plain[angle]
    # At rest gravity bounds what the gyros add.
    if vector != "angular_velocity":
        assert wide[angle] > 1.2 * plain[angle]
        assert getattr(widened.station, angle) > 1.2 * getattr(survey.station, angle)


def test_a_covariance_no_larger_than_the_tools_changes_no_bit():
    plain = noisy()[1]
    for vector, sigma in (("angular_velocity", 1e-3), ("linear_acceleration", 0.02), ("magnetic_field", 5e-8)):
        pipeline, same, _ = noisy(vector, sigma)
        assert pipeline.noise_notes == []
        assert same == plain


@pytest.mark.fault_case(20)
def test_without_a_gyro_a_still_tool_gives_surveys_and_the_gyro_is_named():
    imu, mag = still()
    imu["angular_velocity_covariance"][:, 0] = -1.0
    imu["angular_velocity"] = 3.0
    pipeline, output, surveys = estimated(imu, mag)
    (survey,) = surveys
    expected = np.arctan2(6.87, 7.0)
    assert survey.station.inclination == pytest.approx(expected, abs=1e-3)
    (named,) = [one for one in diagnostics.sensor_diagnostics(pipeline, has_azimuth=True) if "gyro" in one.message]
    assert "declare it not provided" in named.message
    # The gyro is waited for before gravity is followed without it.
    assert np.isfinite(output.attitude["inclination"][200:]).all()


def sensor_entries(imu, mag, *, has_azimuth=True):
    """Return the diagnostics of the sensors after these samples."""
    return diagnostics.sensor_diagnostics(estimated(imu, mag)[0], has_azimuth=has_azimuth)


@pytest.mark.parametrize(
    ("vector", "has_azimuth", "level"),
    [
        ("magnetic_field", True, diagnostics.WARN),
        ("magnetic_field", False, diagnostics.ERROR),
        ("linear_acceleration", True, diagnostics.ERROR),
    ],
)
def test_a_broken_sensor_is_an_error_where_the_tool_loses_an_angle_by_it(vector, has_azimuth, level):
    imu, mag = still()
    (mag if vector == "magnetic_field" else imu)[vector] = np.nan
    found = sensor_entries(imu, mag, has_azimuth=has_azimuth)
    named = [one for one in found if ("sensor", "magnetometer") in one.values or vector != "magnetic_field"]
    assert {one.level for one in named} == {level}


@pytest.mark.fault_case(14)
@pytest.mark.parametrize(
    ("vector", "sensor"), [("linear_acceleration", "accelerometer"), ("magnetic_field", "magnetometer")]
)
def test_a_sensor_declared_absent_is_named_as_that_and_a_broken_one_as_broken(vector, sensor):
    imu, mag = still()
    samples = mag if vector == "magnetic_field" else imu
    samples[f"{vector}_covariance"][:, 0] = -1.0
    (declared,) = [found for found in sensor_entries(imu, mag, has_azimuth=False) if sensor in found.message]
    assert "declare it not provided" in declared.message
    assert f"{vector}_covariance" in declared.remedy
    samples[f"{vector}_covariance"], samples[vector] = 0.0, np.nan
    (broken,) = [found for found in sensor_entries(imu, mag, has_azimuth=False) if sensor in found.message]
    assert "not finite" in broken.message
    assert "plug" in broken.remedy


@pytest.mark.parametrize("cut", [7, 500])
def test_a_sensor_that_is_declared_absent_only_after_it_failed_is_broken_however_the_samples_are_cut(cut):
    imu, mag = (samples[:500] for samples in still())
    mag["magnetic_field"][100:] = np.nan
    mag["magnetic_field_covariance"][400:, 0] = -1.0
    pipeline, changes = Pipeline(EstimatorSettings()), []
    for k in range(0, 500, cut):
        pipeline.push_mag(mag[k : k + cut])
        changes += pipeline.push_imu(imu[k : k + cut]).health
    assert [(change.code, change.place // 3) for change in changes] == [(FaultCode.INVALID, 2)]


def test_samples_that_were_not_used_are_told_with_the_remedy_of_their_cause():
    imu, mag = still()
    late, half = Pipeline(EstimatorSettings()), len(imu) // 2
    late.push_imu(imu[:half])
    late.push_mag(mag[:half])
    late.push_imu(imu[half:])
    assert "tool.magnetometer.delay_s" in diagnostics.sample_diagnostic(late, 0).remedy
    assert "expected type" not in diagnostics.sample_diagnostic(late, 0).remedy
    assert "expected type" in diagnostics.sample_diagnostic(Pipeline(EstimatorSettings()), 3).remedy


@pytest.mark.fault_case(23)
def test_a_tool_hotter_than_its_calibration_is_warned_of_until_it_has_cooled():
    pipeline, heat = Pipeline(EstimatorSettings(place=PLACE)), wire.TEMPERATURE.empty(1)
    heat["temperature"] = 190.0
    pipeline.push_temperature(heat)
    (shown,) = diagnostics.input_diagnostics(pipeline)
    assert "190 degC is outside of the calibration" in shown.message
    assert shown.level == WARN
    heat["temperature"] = 90.0
    pipeline.push_temperature(heat)
    assert diagnostics.input_diagnostics(pipeline) == []
