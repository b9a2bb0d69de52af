# SPDX-License-Identifier: Apache-2.0
"""Health of the precision unit: held against the conventional one, and what remains of the estimate without it."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from mwd_estimation.core.fault_messages import describe
from mwd_estimation.core.reason_text import text
from mwd_estimation.core.sensor_fault import PRECISION, FaultCode
from mwd_estimation.health.unit_comparison import PrecisionHealth
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place
from mwd_sensors.core import wire
from mwd_sensors.simulator import faults, scenario
from mwd_sensors.simulator.faults import Fault
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS

pytestmark = pytest.mark.slow(0.1)

SCENARIO = SCENARIOS / "bench" / "drillvib.yaml"
BIN = 500_000_000
START_S = 12.1
SCHEDULES = {
    "drilling": [{"kind": "drill", "seconds": 24.0, "rpm": 100.0, "rop_m_h": 0.0}],
    "still": [{"kind": "still", "seconds": 60.0, "pumps": False}],
}


@functools.cache
def sent(schedule):
    changes = {"schedule": SCHEDULES[schedule], "precision": {"grade": "tactical_north"}, "faults": []}
    sonde = Sonde(scenario.read(SCENARIO, changes))
    blocks = list(sonde.blocks(10.0))
    topics = ("imu/mag", "gyro/data_raw", "imu/data_raw", "truth")
    return {topic: np.concatenate([block[topic] for block in blocks]) for topic in topics}, sonde


def spoilt(schedule, component, word, axis="all", start_s=START_S):
    streams, _ = sent(schedule)
    topic = faults.COMPONENTS[component][0]
    samples = streams[topic]
    state = faults.start([Fault(component, word, axis, start_s=start_s)], np.random.default_rng(1))
    t = (samples["stamp_ns"] - streams["truth"]["stamp_ns"][0]) * 1e-9
    return {**streams, topic: faults.spoil(state, topic, samples, t)[0]}


def judged(streams, still=False, at_once=False):
    """Changes, with the seconds after which they were known, and whether the unit was ever in doubt."""
    health = PrecisionHealth(np.radians(5.0) / 3600.0)
    imu, fine = streams["imu/data_raw"], streams["gyro/data_raw"]
    values = np.hstack([fine["angular_velocity"], fine["linear_acceleration"]])
    beside = np.hstack([imu["angular_velocity"], imu["linear_acceleration"]])
    begin = int(imu["stamp_ns"][0])
    changes, doubts = [], 0
    if at_once:
        health.beside(imu["stamp_ns"], beside)
    for k in range(begin // BIN + 1, int(imu["stamp_ns"][-1]) // BIN):
        a, b = np.searchsorted(imu["stamp_ns"], [k * BIN, (k + 1) * BIN])
        c, d = np.searchsorted(fine["stamp_ns"], [k * BIN, (k + 1) * BIN])
        fresh = slice(a + 1, b + 1)
        if not at_once:
            health.beside(imu["stamp_ns"][fresh], beside[fresh])
        found = health.judge((k + 1) * BIN, still, (fine["stamp_ns"][c:d].copy(), values[c:d]))
        changes += [(((k + 1) * BIN - begin) * 1e-9, one) for one in found]
        doubts += health.suspect
    return changes, doubts, health


def test_samples_of_the_conventional_unit_that_come_early_change_nothing():
    # Before it is proved which unit has the wrong axes, what differed is open again without the conventional one.
    streams = spoilt("drilling", "precision_gyro", "flipped", "y", 4.1)
    imu = streams["imu/data_raw"].copy()
    seconds = (imu["stamp_ns"] - imu["stamp_ns"][0]) * 1e-9
    imu["angular_velocity"][(seconds > 7.6) & (seconds < 12.0)] = np.nan
    streams = {**streams, "imu/data_raw": imu}
    changes, doubts, health = judged(streams)
    assert changes
    early = judged(streams, at_once=True)
    assert (early[0], early[1], early[2].faults) == (changes, doubts, health.faults)


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_a_healthy_unit_is_left_in_peace(schedule):
    changes, doubts, health = judged(sent(schedule)[0], schedule == "still")
    assert (changes, doubts, health.refusal) == ([], 0, None)


@pytest.mark.parametrize(
    ("schedule", "component", "word", "axis", "kind", "named"),
    [
        ("drilling", "precision_gyro", "stuck", "y", "stuck", "y"),
        ("drilling", "precision_gyro", "off", "all", "dead", "all"),
        ("drilling", "precision_gyro", "nan", "all", "invalid", "x/y/z"),
        ("drilling", "precision_gyro", "saturated", "y", "saturated", "y"),
        ("drilling", "precision_gyro", "in_deg_s", "all", "unit", "all"),
        ("drilling", "precision_gyro", "swapped", "xy", "swapped", "xy"),
        ("drilling", "precision_gyro", "swapped", "yz", "swapped", "yz"),
        ("drilling", "precision_gyro", "flipped", "x", "flipped", "x"),
        ("drilling", "precision_gyro", "flipped", "z", "flipped", "z"),
        ("drilling", "precision_gyro", "turned", "x", "frame", "yz"),
        ("drilling", "precision_gyro", "repeated_stamps", "all", "stamps", ""),
        ("drilling", "precision_accel", "in_g", "all", "unit", "all"),
        ("drilling", "precision_accel", "swapped", "xz", "swapped", "xz"),
        ("drilling", "precision_accel", "flipped", "all", "flipped", "all"),
        ("still", "precision_gyro", "off", "all", "dead", "all"),
        ("still", "precision_gyro", "stuck", "z", "stuck", "z"),
        ("still", "precision_accel", "swapped", "xy", "swapped", "xy"),
        ("still", "precision_accel", "flipped", "x", "flipped", "x"),
        ("still", "precision_accel", "in_g", "all", "unit", "all"),
    ],
)
def test_a_fault_is_named_within_ten_seconds(schedule, component, word, axis, kind, named):
    changes, _, health = judged(spoilt(schedule, component, word, axis), schedule == "still")
    after, first = changes[0]
    assert START_S < after <= START_S + 10.0
    text = describe(first)
    assert (text.kind, text.axis) == (kind, named)
    assert "precision" in text.sensor
    assert first.unusable == PRECISION
    assert text.remedy
    assert health.refusal


@pytest.mark.slow(4)
@pytest.mark.fault_case(21)
@pytest.mark.parametrize("rpm", [200.0, 250.0])
def test_two_units_apart_in_a_string_that_turns_fast_have_no_wrong_axes(rpm):
    """In stick-slip up to 600 r/min, where the x gyro clips, the forces of the units differ by more than gravity."""
    schedule = [{"kind": "still", "seconds": 5.0}, {"kind": "drill", "seconds": 30.0, "rpm": rpm, "rop_m_h": 0.0}]
    apart = {
        "schedule": schedule,
        "faults": [],
        "vibration": {"stick_slip": {"frequency_hz": 0.15, "depth": 230.0 / rpm - 0.05, "sticky": True}},
        "ahrs": {"grade": "mti3_calibrated", "lever_mm": [20.0, 8.0, -6.0]},
        "precision": {"grade": "tactical_north", "lever_mm": [120.0, 0.0, 5.0]},
    }
    sonde = Sonde(scenario.read(SCENARIO, apart))
    pipeline, found = Pipeline(EstimatorSettings()), []
    fastest = 0.0
    for block in sonde.blocks(5.0):
        pipeline.push_mag(block["imu/mag"])
        pipeline.push_precision(block["gyro/data_raw"])
        found += pipeline.push_imu(block["imu/data_raw"]).health
        fastest = max(fastest, float(np.abs(block["truth"]["angular_velocity"][:, 0]).max()))
    assert fastest > 50.0
    assert not [one.code for one in found if one.code != FaultCode.SATURATED and one.code != FaultCode.CLIPPED]


@pytest.mark.parametrize("component", ["gyro", "precision_gyro"])
def test_y_and_z_of_two_gyros_that_differ_are_held_against_both(component):
    changes, _, health = judged(spoilt("drilling", component, "flipped", "y"))
    assert [(describe(one).sensor, describe(one).axis, one.unusable) for _, one in changes] == [
        ("gyro/precision gyro", "y", PRECISION)
    ]
    assert "one of the two" in text(health.refusal)


def test_what_moves_on_without_a_doubt_of_the_first_unit_is_the_precision_units_own_mistake():
    changes, _, _ = judged(spoilt("drilling", "precision_gyro", "swapped", "xy"))
    assert [describe(one).sensor for _, one in changes] == ["gyro/precision gyro", "precision gyro"]
    assert changes[1][0] - changes[0][0] < 6.0
    at_rest, _, _ = judged(spoilt("still", "precision_accel", "swapped", "xy"), True)
    assert [describe(one).sensor for _, one in at_rest] == ["accelerometer/precision accelerometer"]


def test_what_was_held_against_both_is_dropped_when_the_first_unit_is_left_out():
    streams = spoilt("drilling", "gyro", "flipped", "x")
    imu = streams["imu/data_raw"].copy()
    imu["angular_velocity"][(imu["stamp_ns"] - imu["stamp_ns"][0]) * 1e-9 > START_S + 4.0] = np.nan
    changes, _, health = judged({**streams, "imu/data_raw": imu})
    assert [(describe(one).sensor, bool(one.cleared_ns)) for _, one in changes] == [
        ("gyro/precision gyro", False),
        ("gyro/precision gyro", True),
    ]
    assert health.refusal is None


def test_a_rate_at_rest_is_too_much_only_beyond_what_a_string_pulled_through_a_bend_turns():
    streams = sent("still")[0]

    def turned(name, rate_deg_h):
        samples = streams[name].copy()
        t = (samples["stamp_ns"] - samples["stamp_ns"][0]) * 1e-9 - START_S
        samples["angular_velocity"][:, 1] += np.radians(rate_deg_h(np.maximum(t, 0.0)) / 3600.0) * (t > 0.0)
        return samples

    # In the last case only the precision unit reads it, and less than the comparison of the two units resolves.
    for rate_deg_h, of_both, given in (
        (lambda t: np.full_like(t, 700.0), True, []),
        (lambda t: 9000.0 * np.exp(-t / 3.0), True, []),
        (lambda t: np.full_like(t, 950.0), False, []),
        (lambda t: np.full_like(t, 1600.0), True, ["y/z"]),
    ):
        units = {name: turned(name, rate_deg_h) for name in ("imu/data_raw", "gyro/data_raw")[not of_both :]}
        changes, _, _ = judged({**streams, **units}, True)
        assert [describe(one).axis for _, one in changes] == given


def test_a_unit_that_falls_silent_is_named_and_one_that_never_sent_is_not():
    streams = sent("drilling")[0]
    fine = streams["gyro/data_raw"]
    part = fine[fine["stamp_ns"] < fine["stamp_ns"][0] + 10 * 10**9]
    changes, _, health = judged({**streams, "gyro/data_raw": part})
    assert [(one.code, describe(one).sensor) for _, one in changes] == [(FaultCode.SILENT, "precision unit")]
    assert "precision unit" in text(health.refusal)
    assert judged({**streams, "gyro/data_raw": fine[:0]})[0] == []


def test_a_fault_that_has_gone_is_cleared():
    streams = sent("drilling")[0]
    fine = streams["gyro/data_raw"].copy()
    t = (fine["stamp_ns"] - fine["stamp_ns"][0]) * 1e-9
    fine["angular_velocity"][(t > 6.0) & (t < 12.0), 1] *= -1.0
    changes, _, health = judged({**streams, "gyro/data_raw": fine})
    assert [(describe(one).kind, bool(one.cleared_ns)) for _, one in changes] == [("flipped", False), ("flipped", True)]
    assert 12.0 < changes[1][0] < 16.0
    assert health.refusal is None


def estimated(streams, cut=10**9):
    _, sonde = sent("still")
    field = sonde.reference
    settings = EstimatorSettings(
        place=Place(
            field="fixed",
            total_nt=field.total * 1e9,
            dip_deg=np.degrees(field.dip),
            declination_deg=np.degrees(field.declination),
            lat_deg=38.0,
        ),
    )
    pipeline, output = Pipeline(settings), Output.empty(0)
    imu = streams["imu/data_raw"]
    pipeline.push_mag(streams["imu/mag"])
    pipeline.push_precision(streams["gyro/data_raw"])
    for start in range(0, len(imu), cut):
        output = output.joined(pipeline.push_imu(imu[start : start + cut]))
    return output.joined(pipeline.finish()), pipeline


def test_without_the_unit_the_gyro_azimuth_is_refused_in_words_and_the_magnetic_one_goes_on():
    healthy, _ = estimated(sent("still")[0])
    assert healthy.health == []
    refused = healthy.surveys[0].station.by_method("gyro").refused
    assert refused is None or "precision" not in text(refused)
    # Which of two accelerometers with different axes is wrong, a tool at rest does not show.
    for component, word, axis, says, verdict in (
        ("precision_gyro", "off", "all", "only zeros", "accept"),
        ("precision_accel", "swapped", "xy", "x and y exchanged", "doubtful"),
    ):
        output, pipeline = estimated(spoilt("still", component, word, axis, 0.0))
        (survey,) = output.surveys
        assert says in text(survey.station.by_method("gyro").refused)
        assert survey.weights["gyro"] == 0.0
        assert np.isfinite(survey.station.azimuth)
        assert survey.station.verdict == verdict
        assert any(one.unusable == PRECISION for one in pipeline.sensor_faults)


def test_any_cut_gives_the_same_and_a_seek_that_was_asked_for_ends_with_the_reason():
    streams = spoilt("still", "precision_gyro", "off", start_s=20.0)
    whole, cut = estimated(streams)[0], estimated(streams, 37)[0]
    assert cut.attitude.tobytes() == whole.attitude.tobytes()
    assert cut.health == whole.health
    assert [s.uuid for s in cut.surveys] == [s.uuid for s in whole.surveys]
    _, pipeline = estimated({name: samples[:500] for name, samples in streams.items()})
    pipeline.request_north(60.0)
    pipeline.push_mag(streams["imu/mag"][500:])
    pipeline.push_precision(streams["gyro/data_raw"][500:])
    (ended,) = pipeline.push_imu(streams["imu/data_raw"][500:]).north
    assert not ended.success
    assert "only zeros" in text(ended.reason)


def both_units(rate, seen=None):
    """Both units on a tool that turns by `rate`, rad/s, shape (n, 3); the precision one by `seen`, if that is other."""
    n, rng = len(rate), np.random.default_rng(0)
    turned = np.cumsum(rate[:, 0]) * 0.01
    force = 9.81 * np.stack([np.full(n, -0.45), 0.89 * np.sin(turned), 0.89 * np.cos(turned)], axis=1)
    streams = {}
    for topic, what, bias, noise in (
        ("imu/data_raw", rate, np.radians(0.2), 1e-3),
        ("gyro/data_raw", rate if seen is None else seen, 5e-6, 2e-4),
    ):
        samples = wire.IMU.empty(n)
        samples["stamp_ns"] = 1_700_000_000 * 10**9 + np.arange(n) * 10**7
        samples["angular_velocity"] = what + bias * np.array([1.0, -1.0, 1.0]) + noise * rng.normal(size=(n, 3))
        samples["linear_acceleration"] = force + 5e-3 * rng.normal(size=(n, 3))
        streams[topic] = samples
    return streams


@pytest.mark.parametrize("slew", [0.006, 0.01])
def test_a_slow_turn_between_two_stations_is_no_other_unit(slew):
    """Of its cross-axis rates the conventional unit, cut to one part in 57 of its range, shows a constant: its bias."""
    rate = np.zeros((4000, 3))
    rate[1000:3000, 0] = np.radians(18.0)
    turned = np.cumsum(rate[1000:3000, 0]) * 0.01
    rate[1000:3000, 1], rate[1000:3000, 2] = slew * np.cos(turned), -slew * np.sin(turned)
    changes, _, health = judged(both_units(rate))
    assert (changes, health.refusal) == ([], None)


def test_cross_axes_that_were_wrong_are_not_right_because_the_fast_axis_is():
    rate, t = np.zeros((6000, 3)), np.arange(6000) * 0.01
    rate[1000:2000, 1], rate[1000:2000, 2] = 0.1 * np.sin(3.0 * t[1000:2000]), 0.1 * np.cos(2.0 * t[1000:2000])
    seen = rate.copy()
    seen[1000:2000, 1:] = 0.1 * np.random.default_rng(5).normal(size=(1000, 2))
    rate[3000:5000, 0] = seen[3000:5000, 0] = 1.0
    changes, _, health = judged(both_units(rate, seen))
    assert [one.code for _, one in changes] == [FaultCode.MISMATCH]
    assert "agrees with no axis" in text(health.refusal)
    # Until they are seen to be right.
    rate[5200:6000, 1] = seen[5200:6000, 1] = 0.1 * np.sin(3.0 * t[5200:6000])
    changes, _, health = judged(both_units(rate, seen))
    assert [bool(one.cleared_ns) for _, one in changes] == [False, True]
    assert health.refusal is None
