# SPDX-License-Identifier: Apache-2.0
"""What half a second of samples shows of a sensor by itself."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.sensor_fault import ACCEL, MAG, FaultCode
from mwd_estimation.health import fault_debounce as debounce
from mwd_estimation.health import signal_checks as signals
from mwd_estimation.health.fault_debounce import AGAINST, FOR, NOTHING
from mwd_estimation.health.signal_checks import SignalLimits

LIMITS = np.array([math.radians(2000.0), 16.0 * 9.80665, 800e-6])
N = 50


class Tool:
    """Nine channels, half second by half second."""

    def __init__(self):
        self.channels, self.checks = signals.blank(), debounce.blank()
        self.rng = np.random.default_rng(1)
        self.bins = 0
        self.count = signals.count

    def half_second(self, change=None):
        """What is observed of a tool that turns and shakes, its values changed by `change`: code and place."""
        self.checks["seen"] = NOTHING
        means, spreads = np.repeat([0.5, 5.0, 3e-5], 3), np.repeat([0.2, 2.0, 1e-6], 3)
        values = means + spreads * self.rng.standard_normal((N, 9))
        if change is not None:
            change(values)
        for c in range(9):
            self.count(self.channels[c], values, c, 0, N, LIMITS[c // 3])
        began, limits = self.bins * signals.BIN_NS, SignalLimits()
        signals.summarise(self.channels)
        self.doubtful = signals.judge_bin(limits, self.checks, self.channels, LIMITS, began)
        self.bins += 1
        return {(FaultCode(code), int(place)) for code, place in np.argwhere(self.checks["seen"] == FOR)}


def put(columns, value):
    return lambda v: v.__setitem__((slice(None), columns), value)


def test_a_healthy_tool_shows_nothing():
    tool = Tool()
    assert all(tool.half_second() == set() for _ in range(8))
    assert tool.checks[FaultCode.INVALID, 0].seen == AGAINST
    assert tool.doubtful == 0


@pytest.mark.fault_case(4)
def test_an_axis_that_keeps_one_value_is_stuck_and_its_sensor_doubtful():
    tool = Tool()
    tool.half_second()
    # The first half second still held the change to that value.
    assert [tool.half_second(put(4, 5.0)) for _ in range(3)] == [set()] + [{(FaultCode.STUCK, 4)}] * 2
    assert tool.doubtful == ACCEL
    assert tool.checks[FaultCode.STUCK, 4].seen_value == 5.0


def test_a_sensor_that_repeats_itself_is_dead_while_others_move():
    assert Tool().half_second(put(slice(0, 3), 0.0)) == set()
    tool = Tool()
    for _ in range(2):
        found = tool.half_second(put(slice(0, 3), 0.0))
    assert found == {(FaultCode.DEAD, 0)}


@pytest.mark.fault_case(6)
def test_the_end_of_the_range_is_noted_and_what_lies_beyond_it_within_the_gate_too():
    tool = Tool()
    assert tool.half_second(lambda v: v.__setitem__((slice(0, 20), 3), LIMITS[1])) == {(FaultCode.CLIPPED, 3)}
    assert tool.half_second(put(3, -LIMITS[1])) == {(FaultCode.SATURATED, 3)}
    assert tool.doubtful == ACCEL
    assert (FaultCode.SATURATED, 3) in tool.half_second(put(3, 1.2 * LIMITS[1]))


@pytest.mark.fault_case(2)
def test_values_that_are_not_finite_are_noted_by_axis():
    tool = Tool()
    assert tool.half_second(put(slice(7, 9), math.nan)) == {(FaultCode.INVALID, 6)}
    assert tool.checks[FaultCode.INVALID, 6].seen_which[0] == 0b110


def test_samples_counted_one_by_one_or_together_give_the_same():
    values = np.random.default_rng(3).standard_normal((20, 2))
    values[4, 1] = math.nan
    values[7, 1] = values[6, 1]
    together, single = signals.blank(), signals.blank()
    signals.count(together[5], values, 1, 0, 20, 1.0)
    for i in range(20):
        signals.count(single[5], values, 1, i, i + 1, 1.0)
    assert together.tobytes() == single.tobytes()


@pytest.mark.fault_case(7)
def test_a_field_that_jumps_from_sample_to_sample_is_noise_and_one_that_turns_fast_or_in_another_unit_is_not():
    tool = Tool()
    tool.half_second()
    assert tool.checks[FaultCode.NOISE, 6].seen == AGAINST
    garbage = tool.rng.uniform(-8e-4, 8e-4, (N, 3))
    assert (FaultCode.NOISE, 6) in tool.half_second(put(slice(6, 9), garbage))
    assert tool.checks[FaultCode.NOISE, 6].seen_which[0] == 0b111
    assert tool.checks[FaultCode.NOISE, 6].seen_value == pytest.approx(462e-6, rel=0.1)
    assert tool.doubtful == MAG
    turn = 31.0 * 0.01 * np.arange(N)
    for field in (5e-4 * np.cos(turn), 50.0 * np.cos(turn)):
        assert (FaultCode.NOISE, 6) not in tool.half_second(put(7, field))


def turning(rate, field, silent=False):
    """A tool that turns about x at rates, rad/s, and reads a field, T; silent: its gyros say nothing."""

    def change(v):
        v[:, 0] = np.nan if silent else rate + 0.01 * v[:, 0]
        v[:, 6:] = field

    return change


@pytest.mark.fault_case(7)
@given(size=st.floats(3e-5, 9e-5), rate=st.floats(-10.0, 10.0), seed=st.integers(0, 1000))
def test_random_numbers_as_large_as_the_field_are_noise_while_the_tool_turns_slowly(size, rate, seed):
    rng = np.random.default_rng(seed)
    found = Tool().half_second(turning(rate, rng.normal(0.0, size, (N, 3))))
    assert (FaultCode.NOISE, 6) in found


@pytest.mark.fault_case(7)
@given(
    every=st.integers(6, 25),
    size=st.floats(1e-6, 8e-4),
    direction=st.sampled_from([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, -1.0, 1.0)]),
    rate=st.floats(-10.0, 10.0),
    first=st.integers(0, 24),
)
def test_a_sound_field_of_which_some_samples_are_wrong_is_not_random(every, size, direction, rate, first):
    angle = 0.01 * rate * np.arange(N)
    field = 5e-5 * np.stack([np.full(N, 0.5), np.cos(angle), np.sin(angle)], axis=1)
    field[first % every :: every] += size * np.array(direction)
    assert (FaultCode.NOISE, 6) not in Tool().half_second(turning(rate, field))


def a_noise_fault_lasts(columns, began, size, seed, bins):
    """Whether a fault that random numbers of the size `began` have caused outlasts half seconds of a smaller size."""
    tool, rng = Tool(), np.random.default_rng(seed)
    check = tool.checks[FaultCode.NOISE, columns.start]
    states = []
    for spread in [began] * 8 + [size] * bins:
        tool.half_second(put(columns, rng.normal(0.0, spread, (N, 3))))
        debounce.weigh(tool.checks)
        states.append(check["state"] == debounce.FAULT)
    assert states[7]
    return states[-1]


@pytest.mark.fault_case(7)
@given(size=st.floats(50.0, 54.0), seed=st.integers(0, 1000))
def test_random_forces_that_are_sometimes_small_do_not_end_the_fault(size, seed):
    assert a_noise_fault_lasts(slice(3, 6), 90.0, size, seed, 80)


@pytest.mark.fault_case(7)
@pytest.mark.parametrize(("columns", "limit"), [(slice(0, 3), 2.0), (slice(3, 6), 56.5), (slice(6, 9), 1e-5)])
@given(share=st.floats(0.01, 0.7), seed=st.integers(0, 1000))
def test_broad_band_vibration_does_not_keep_the_noise_fault_of_a_sound_sensor(columns, limit, share, seed):
    assert not a_noise_fault_lasts(columns, 2.0 * limit, share * limit, seed, 60)


@pytest.mark.fault_case(7)
def test_a_noise_fault_ends_in_vibration_after_the_clock_was_set_back():
    tool, rng = Tool(), np.random.default_rng(4)
    check = tool.checks[FaultCode.NOISE, 3]
    for spread, bins, first in ((90.0, 8, 1_000_000), (40.0, 60, 0)):
        tool.bins = first
        for _ in range(bins):
            tool.half_second(put(slice(3, 6), rng.normal(0.0, spread, (N, 3))))
            debounce.weigh(tool.checks)
        assert (check["state"] == debounce.FAULT) == (spread == 90.0)


@pytest.mark.fault_case(7)
@given(
    rate=st.floats(-34.0, 34.0),
    swing=st.floats(0.0, 30.0),
    hertz=st.floats(0.1, 400.0),
    stride=st.sampled_from([1, 2, 5]),
    silent=st.booleans(),
    strength=st.floats(1e-5, 7e-5),
    noise=st.floats(1e-8, 5e-6),
)
def test_no_rotation_or_torsional_vibration_makes_the_field_random(rate, swing, hertz, stride, silent, strength, noise):
    """The string turns at rates within the range of the gyros; the magnetometer sends each sample or each fifth."""
    at = 0.01 * np.arange(N)
    swing = min(swing, 34.0 - abs(rate))
    rates = rate + swing * np.cos(2.0 * np.pi * hertz * at)
    angle = rate * at + swing / (2.0 * np.pi * hertz) * np.sin(2.0 * np.pi * hertz * at)
    field = strength * np.stack([np.full(N, 0.5), np.cos(angle), np.sin(angle)], axis=1)
    field += np.random.default_rng(7).normal(0.0, noise, (N, 3))
    tool = Tool()
    # A slow magnetometer: the channel counts fewer samples than the gyros.
    whole = signals.count

    def count(channel, values, c, start, stop, limit):
        kept = np.ascontiguousarray(values[::stride]) if c >= 6 else values
        whole(channel, kept, c, start, len(kept), limit)

    tool.count = count
    assert (FaultCode.NOISE, 6) not in tool.half_second(turning(rates, field, silent))


@pytest.mark.fault_case(7)
def test_random_forces_over_the_range_are_noise_and_a_tone_of_the_same_size_is_not():
    tool = Tool()
    tool.half_second()
    assert (FaultCode.NOISE, 3) in tool.half_second(put(slice(3, 6), tool.rng.uniform(-156.0, 156.0, (N, 3))))
    assert (FaultCode.NOISE, 3) not in tool.half_second(put(3, 130.0 * np.sin(0.3 * np.arange(N))))
    assert (FaultCode.NOISE, 3) not in tool.half_second(put(slice(3, 6), tool.rng.normal(0.0, 30.0, (N, 3))))


def refused_by_the_gate(sensor, sizes, expected=5e-5, of=N):
    """What is observed of the unit of a sensor of whose readings the gate refused those of these sizes."""
    tool = Tool()
    tool.half_second()
    tool.checks["seen"] = NOTHING
    place = 3 * sensor
    tool.channels["n"][place : place + 3], tool.channels["not_finite"][place : place + 3] = of - len(sizes), len(sizes)
    signals.judge_refused(tool.checks, tool.channels, sensor, np.sort(np.asarray(sizes, dtype=float)), expected, 0)
    check = tool.checks[FaultCode.UNIT, place + signals.BY_GATE]
    return check.seen, check.seen_which[0]


@given(unit=st.integers(0, 4), field=st.floats(2.2e-5, 6.8e-5), share=st.integers(13, N), known=st.booleans())
def test_a_field_in_another_unit_is_named_by_what_the_gate_refused(unit, field, share, known):
    sizes = [field * 10.0 ** signals.FIELD_POWERS[unit]] * share
    assert refused_by_the_gate(2, sizes, field if known else math.nan) == (FOR, unit + 1)


@given(few=st.integers(0, N // 4), size=st.floats(1.0, 1e6))
def test_a_few_absurd_readings_are_no_unit(few, size):
    assert refused_by_the_gate(0, [size] * few)[0] != FOR
    assert refused_by_the_gate(2, [size] * few)[0] != FOR


def test_a_gyro_most_of_whose_readings_are_refused_is_in_another_unit_and_one_of_no_sample_shows_nothing():
    assert refused_by_the_gate(0, [700.0] * 20) == (FOR, 1)
    assert refused_by_the_gate(0, [], of=0)[0] == NOTHING
    # Between the powers of ten of two units no unit is named.
    assert refused_by_the_gate(2, [5e-5 * 10.0**5] * 40)[0] != FOR
