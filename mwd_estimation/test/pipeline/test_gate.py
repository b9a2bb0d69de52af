# SPDX-License-Identifier: Apache-2.0
"""The gate: what no sensor can read has the effect of a missing value, bit for bit, through the whole estimator."""

import functools
import itertools
import math
import re

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from mwd_estimation.core.fault_messages import unit_words
from mwd_estimation.core.input_gate import MARGIN, InputGate, Ranges
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import FaultCode, FaultUnit
from mwd_estimation.core.status import Status
from mwd_estimation.gravity import methods
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import wire
from mwd_sensors.core.constants import EARTH_RATE
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_sensors.core.settings import changed

START = 1_700_000_000 * 10**9
REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.05, convergence=0.01, gravity=9.81, source="test")
SETTINGS = changed(EstimatorSettings(), {"place.lat_deg": 55.0, "survey.wait_for_gyro_s": 0.0})
GATE = InputGate(derivation.input_ranges(SETTINGS))
# Stream, field, axes and gate of each channel.
CHANNELS = {
    "gyro": ("imu", "angular_velocity", 3, GATE.limits[0]),
    "accelerometer": ("imu", "linear_acceleration", 3, GATE.limits[1]),
    "magnetometer": ("mag", "magnetic_field", 3, GATE.limits[2]),
    "precision gyro": ("precision", "angular_velocity", 3, GATE.limits[3]),
    "precision accelerometer": ("precision", "linear_acceleration", 3, GATE.limits[4]),
    "temperature": ("temperature", "temperature", 1, 400.0),
}
SECONDS, STILL_AFTER = 44.0, 9.0


@functools.cache
def _sent():
    """A string that turns, and stands still for a survey; both units, the magnetometer and a thermometer."""
    rng = np.random.default_rng(7)
    n = round(SECONDS * 100)
    times = np.arange(n) * 0.01
    turning = np.where(times < STILL_AFTER, 6.0, 0.0)
    mats = mat_nt(0.8, np.full(n, 1.9), np.cumsum(turning) * 0.01)
    field_n = 5e-5 * np.array([math.cos(1.1) * math.cos(0.05), math.cos(1.1) * math.sin(0.05), math.sin(1.1)])
    earth_n = EARTH_RATE * np.array([math.cos(0.96), 0.0, -math.sin(0.96)])
    imu, fine, mag = wire.IMU.empty(n), wire.IMU.empty(n), wire.MAG.empty(n)
    heat = wire.TEMPERATURE.empty(round(SECONDS))
    stamps = START + np.round(times * 1e9).astype(np.int64)
    for unit, noise in ((imu, 1e-3), (fine, 2e-5)):
        unit["stamp_ns"] = stamps
        unit["angular_velocity"] = np.einsum("kji,j->ki", mats, earth_n) + noise * rng.normal(size=(n, 3))
        unit["angular_velocity"][:, 0] += turning
        unit["linear_acceleration"] = np.einsum("kji,j->ki", mats, [0, 0, -9.81]) + 5e-3 * rng.normal(size=(n, 3))
    fine["angular_velocity"] = np.clip(fine["angular_velocity"], -1.745, 1.745)
    mag["stamp_ns"] = stamps
    mag["magnetic_field"] = np.einsum("kji,j->ki", mats, field_n) + 5e-8 * rng.normal(size=(n, 3))
    heat["stamp_ns"], heat["temperature"] = stamps[::100], 60.0
    return {"imu": imu, "mag": mag, "precision": fine, "temperature": heat}


def _with(*edits):
    """The streams with values put in; each edit is a channel, an axis, the places and the value."""
    streams = {name: samples.copy() for name, samples in _sent().items()}
    for channel, axis, places, value in edits:
        stream, field, axes, _ = CHANNELS[channel]
        # Temperatures come a hundred times slower.
        rows = np.unique(np.asarray(places) // 100) if axes == 1 else np.asarray(places)
        streams[stream][field].reshape(len(streams[stream]), axes)[rows, axis % axes] = value
    return streams


def _output(streams, given=SETTINGS, cuts=(1300,), north=True, mount=None):
    """All that comes out: the streams in bytes, all else in words."""
    pipeline = Pipeline(given, REFERENCE, mount)
    output, edges = Output.empty(0), [0, *cuts, len(streams["imu"])]
    stamps = streams["imu"]["stamp_ns"]
    for start, stop in itertools.pairwise(edges):
        end_ns = stamps[stop] if stop < len(stamps) else np.iinfo(np.int64).max
        for name, push in (
            ("mag", pipeline.push_mag),
            ("precision", pipeline.push_precision),
            ("temperature", pipeline.push_temperature),
        ):
            part = streams[name]
            push(part[(part["stamp_ns"] >= stamps[start]) & (part["stamp_ns"] < end_ns)])
        output = output.joined(pipeline.push_imu(streams["imu"][start:stop]))
        if north and start == 0:
            pipeline.request_north(30.0)
    output = output.joined(pipeline.finish())
    rows = [getattr(output, name).tobytes() for name in ("attitude", "gravity", "interference", "dynamics")]
    events = (output.surveys, output.refusals, output.health, output.north, output.rotary_refusals)
    rest = pipeline.counters, pipeline.sensor_faults, pipeline.temperature.last, pipeline.temperature.outside
    return rows, re.sub(r"0x[0-9a-f]+", "", repr((events, rest))), pipeline, output


@functools.cache
def _clean():
    return _output(_sent())[3]


def _assert_same_as(replaced, *edits, **how):
    """Assert that the values of the edits have the same effect as another value at their places, bit for bit."""
    mine = _output(_with(*edits), **how)
    theirs = _output(_with(*((*where, replaced) for *where, _ in edits)), **how)
    assert mine[1] == theirs[1]
    assert mine[0] == theirs[0]


def beyond(limit):
    """Any finite double beyond a gate: just beyond it, twice the margin, huge, or not a number in another way."""
    size = st.one_of(
        st.just(math.nextafter(limit, math.inf)),
        st.floats(limit, 1e4 * limit, exclude_min=True),
        st.floats(limit, exclude_min=True, allow_infinity=True),
    )
    return st.builds(math.copysign, size, st.sampled_from([1.0, -1.0]))


@pytest.mark.slow(2.5)
@pytest.mark.fault_case(3)
@settings(max_examples=5)
@given(data=st.data())
def test_any_double_beyond_the_gate_in_one_sample_has_the_effect_of_a_missing_value(data):
    """In every channel at once, each at a place of its own."""
    edits = []
    for channel, (*_, limit) in CHANNELS.items():
        places = [data.draw(st.integers(20, round(SECONDS * 100) - 20))]
        edits.append((channel, data.draw(st.integers(0, 2)), places, data.draw(beyond(limit))))
    _assert_same_as(math.nan, *edits)


@pytest.mark.slow(0.5)
@pytest.mark.parametrize(("value", "length"), [(1e9, 2), (-1e150, 37)])
def test_bursts_beyond_the_gate_have_the_effect_of_missing_values(value, length):
    starts = range(700, 4000, 550)
    _assert_same_as(
        math.nan, *((name, 1, range(at, at + length), value) for name, at in zip(CHANNELS, starts, strict=True))
    )


@pytest.mark.slow(0.4)
@pytest.mark.parametrize("channel", CHANNELS)
def test_a_whole_channel_beyond_the_gate_has_the_effect_of_missing_values(channel):
    _assert_same_as(math.nan, (channel, 1, range(700, round(SECONDS * 100)), 1.7e308))


@pytest.mark.slow(0.5)
@pytest.mark.parametrize("method", methods.METHODS)
def test_every_gravity_method_takes_an_absurd_value_for_a_missing_one(method):
    values = ((1000.0, 400), (-1e150, 1500))
    edits = [("gyro", 1, [place], value) for value, place in values]
    edits += [("accelerometer", 1, [place + 250], value) for value, place in values]
    _assert_same_as(math.nan, *edits, given=changed(SETTINGS, {"gravity.method": method}))


@pytest.mark.slow(0.4)
def test_the_gate_stands_before_a_mount_that_turns_the_axes():
    # Turned by 45 deg a value just beyond the range would be two within it.
    half = math.sqrt(0.5)
    askew = changed(SETTINGS, {"tool.mount.imu": f"1, 0, 0, 0, {half}, {-half}, 0, {half}, {half}"})
    channels = ["gyro", "accelerometer", "magnetometer", "precision gyro"]
    edits = [(name, 1, [500 + 250 * k], math.nextafter(CHANNELS[name][3], math.inf)) for k, name in enumerate(channels)]
    _assert_same_as(math.nan, *edits, given=askew)


@pytest.mark.slow(0.7)
@settings(max_examples=4)
@given(
    edits=st.lists(
        st.tuples(
            st.sampled_from(sorted(CHANNELS)),
            st.integers(0, 2),
            st.integers(20, round(SECONDS * 100) - 20).map(lambda place: [place]),
            st.sampled_from([0.0, 5e-324, -2e-308, 1e-200, 1e-9]),
        ),
        min_size=3,
        max_size=6,
    )
)
def test_tiny_values_are_readings_that_break_nothing(edits):
    rows, _, _, output = _output(_with(*edits))
    for name in ("attitude", "gravity", "interference", "dynamics"):
        samples = getattr(output, name)
        assert not any(np.isinf(samples[field]).any() for field in samples.dtype.names)
    assert rows


@pytest.mark.slow(2.3)
@pytest.mark.fault_case(3)
@settings(max_examples=5, phases=[Phase.explicit, Phase.generate])
@given(
    channel=st.sampled_from(["gyro", "precision gyro"]),
    axis=st.integers(0, 2),
    place=st.integers(20, round(SECONDS * 100) - 20),
    share=st.floats(-0.99, 0.99).filter(lambda share: abs(share) > 0.3),
)
# A rate across the axis so large that its half second looks like random numbers.
@example("gyro", 2, 346, -0.97)
def test_one_wrong_rate_within_the_range_has_the_effect_of_a_missing_value(channel, axis, place, share):
    value = share * (35.0 if channel == "gyro" else 3.4)
    given_, missing = (_output(_with((channel, axis, [place], what)))[3] for what in (value, math.nan))
    # The health judges the sample as it came, and the usual change remembers it: the angles hardly show it.
    for field in ("inclination", "azimuth", "gravity_toolface"):
        sigma = missing.attitude[f"sigma_{field}"]
        error = np.abs(wrap_pi(given_.attitude[field] - missing.attitude[field]))
        assert (error[sigma > 0.0] <= 0.02 * sigma[sigma > 0.0]).all(), field
    azimuths = [[one.station.azimuth for one in output.surveys] for output in (given_, missing)]
    assert np.allclose(*azimuths, atol=2e-4)
    assert given_.health == missing.health == []


@pytest.mark.slow(0.5)
@pytest.mark.parametrize("length", [2, pytest.param(3, marks=pytest.mark.nightly), 4])
@pytest.mark.parametrize("place", [500, 1500])
def test_some_wrong_rates_in_a_row_leave_the_angles_within_their_sigma(length, place):
    clean = _clean()
    for axis, value in ((1, 5.0), (2, -20.0)):
        _, _, _, spoilt = _output(_with(("gyro", axis, range(place, place + length), value)))
        for field in ("inclination", "azimuth"):
            sigma = spoilt.attitude[f"sigma_{field}"]
            error = np.abs(wrap_pi(spoilt.attitude[field] - clean.attitude[field]))
            assert (error[sigma > 0.0] <= 3.0 * sigma[sigma > 0.0]).all(), (axis, value, field)


@pytest.mark.slow(0.2)
@pytest.mark.fault_case(49)
@pytest.mark.parametrize("jitter_s", [1e-4, 1e-3, 2e-3])
def test_uneven_stamps_widen_the_toolface_of_a_turning_string_by_what_it_turns_meanwhile(jitter_s):
    streams = dict(_sent())
    imu = streams["imu"] = streams["imu"].copy()
    errors = np.random.default_rng(1).normal(0.0, jitter_s, len(imu))
    imu["stamp_ns"] += (1e9 * errors).astype(np.int64)
    _, _, _, output = _output(streams, north=False)
    turning = slice(300, round(100 * STILL_AFTER) - 100)
    true = 0.06 * (1.0 + np.arange(len(imu))) - 6.0 * -errors
    error = wrap_pi(output.attitude["gravity_toolface"] - true)[turning]
    sigma = output.attitude["sigma_gravity_toolface"][turning]
    assert (np.abs(error) > 3.0 * sigma).mean() < 0.02
    assert np.median(sigma) < 6.0 * 6.0 * jitter_s + 0.002


@pytest.mark.slow(0.4)
def test_the_sign_of_zero_says_nothing():
    _assert_same_as(0.0, *((channel, 1, [500 + 100 * k, 1500 + 100 * k], -0.0) for k, channel in enumerate(CHANNELS)))


@pytest.mark.slow(0.2)
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("share", [1.0, 0.999 * MARGIN])
def test_between_its_range_and_the_gate_a_gyro_is_taken_for_clipped(axis, share):
    value = share * math.radians(2000.0)
    clean, places = _clean(), [500, 1500]
    rows = _output(_with(("gyro", axis, places, value)))[3].attitude
    # Alone among slow rates it is missing, as any other wrong sample.
    assert (rows["status"][places] & (Status.CLIPPED | Status.REJECTED) != 0).all()
    error = np.abs(wrap_pi(rows["azimuth"] - clean.attitude["azimuth"]))
    known = np.isfinite(rows["sigma_azimuth"])
    assert (error[known] <= rows["sigma_azimuth"][known] + 1e-3).all()


@pytest.mark.parametrize(("power", "words"), [(3, "mT"), (4, "G"), (6, "uT"), (7, "mG"), (9, "nT")])
def test_a_magnetometer_in_another_unit_is_not_used_and_its_unit_is_named(power, words):
    streams = dict(_sent())
    streams["mag"] = streams["mag"].copy()
    streams["mag"]["magnetic_field"] *= 10.0**power
    _, _, pipeline, output = _output(streams, cuts=range(100, 4400, 100))
    (fault,) = [one for one in pipeline.sensor_faults if one.place // 3 == 2]
    assert fault.code == FaultCode.UNIT
    assert fault.since_ns == START
    assert unit_words(fault) == words
    assert np.isnan(output.attitude["sigma_azimuth"]).all()


@pytest.mark.parametrize(("stream", "unit"), [("imu", FaultUnit.CONVENTIONAL), ("precision", FaultUnit.PRECISION)])
def test_gyros_in_deg_s_are_named_while_the_string_turns(stream, unit):
    streams = dict(_sent())
    streams[stream] = streams[stream].copy()
    streams[stream]["angular_velocity"] = np.degrees(_sent()["imu"]["angular_velocity"])
    _, _, _, output = _output(streams, north=False)
    named = [one for one in output.health if one.code == FaultCode.UNIT and not one.cleared_ns]
    assert {(one.unit, one.place // 3) for one in named} == {(unit, 0)}
    assert named[0].since_ns < START + 10**9


@given(
    value=st.floats(allow_nan=True, allow_infinity=True),
    full=st.floats(1e-3, 1e3),
)
def test_what_passed_the_gate_passes_again_as_it_is(value, full):
    gate = InputGate(Ranges(full, full, full, full))
    imu, mag, heat = wire.IMU.empty(3), wire.MAG.empty(3), wire.TEMPERATURE.empty(3)
    imu["angular_velocity"][1, 2] = imu["linear_acceleration"][0, 0] = value
    mag["magnetic_field"][2, 1] = heat["temperature"][2] = value
    for take, samples in ((gate.imu, imu), (gate.mag, mag), (gate.precision, imu), (gate.temperature, heat)):
        before = samples.tobytes()
        once = take(samples)
        assert take(once).tobytes() == once.tobytes()
        # The caller keeps what was sent.
        assert samples.tobytes() == before
