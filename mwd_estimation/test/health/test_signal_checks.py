"""What half a second of samples shows of a sensor by itself."""

import math

import numpy as np
import pytest

from mwd_estimation.health import fault_debounce as ev
from mwd_estimation.health import signal_checks as samples

LIMITS = np.array([math.radians(2000.0), 16.0 * 9.80665, 800e-6])
N = 50


class Tool:
    """Nine channels, half second by half second."""

    def __init__(self):
        self.channels, self.counts = samples.blank()
        self.notes = ev.blank()[1]
        self.rng = np.random.default_rng(1)
        self.bins = 0

    def half_second(self, change=None, n=N, mag=True, expects_mag=True):
        """Notes of a bin of a tool that turns and shakes, its values changed by `change`."""
        self.notes[:, ev.SEEN] = ev.NOTHING
        means, spreads = np.repeat([0.5, 5.0, 3e-5], 3), np.repeat([0.2, 2.0, 1e-6], 3)
        values = means + spreads * self.rng.standard_normal((n, 9))
        if change is not None:
            change(values)
        for c in range(9 if mag else 6):
            samples.count(self.channels, c, values, c, 0, n, LIMITS[c // 3])
        self.counts[samples.IMU] = n
        self.doubtful = samples.close_bin(
            self.bins * samples.BIN_NS, self.channels, self.counts, self.notes, LIMITS, 0.01, expects_mag
        )
        self.bins += 1
        return {k: self.notes[k].copy() for k in np.flatnonzero(self.notes[:, ev.SEEN] == ev.FOR)}


def test_a_healthy_tool_shows_nothing():
    tool = Tool()
    assert all(tool.half_second() == {} for _ in range(8))
    assert tool.notes[ev.INVALID, ev.SEEN] == ev.AGAINST


def test_an_axis_that_keeps_one_value_is_noted_after_two_seconds_with_when_it_began():
    tool = Tool()
    tool.half_second()
    found = [tool.half_second(lambda v: v.__setitem__((slice(None), 4), 5.0)) for _ in range(6)]
    # The first of them still held the change to that value.
    assert [set(one) for one in found] == [set()] * 4 + [{ev.STUCK + 4}] * 2
    assert found[4][ev.STUCK + 4][ev.BEGAN] == 2 * samples.BIN_NS


def test_a_sensor_that_repeats_itself_is_dead_after_three_seconds_while_others_move():
    tool = Tool()
    found = [tool.half_second(lambda v: v.__setitem__((slice(None), slice(0, 3)), 0.0)) for _ in range(7)]
    assert [set(one) for one in found] == [set()] * 6 + [{ev.DEAD}]
    assert found[6][ev.DEAD][2] == 1


def test_the_end_of_the_range_is_noted_and_what_lies_far_beyond_is_another_unit():
    tool = Tool()
    found = tool.half_second(lambda v: v.__setitem__((slice(0, 20), 3), LIMITS[1]))
    assert set(found) == {ev.SATURATED + 3}
    assert found[ev.SATURATED + 3][2] == ev.OFTEN
    for _ in range(4):
        found = tool.half_second(lambda v: v.__setitem__((slice(None), 3), -LIMITS[1]))
    assert found[ev.SATURATED + 3][2] == ev.ALWAYS
    assert ev.SATURATED + 3 not in tool.half_second(lambda v: v.__setitem__((slice(None), 3), 3.0 * LIMITS[1]))


def test_values_that_are_no_numbers_are_noted_by_axis():
    found = Tool().half_second(lambda v: v.__setitem__((slice(None), slice(7, 9)), math.nan))
    assert set(found) == {ev.INVALID + 2}
    assert found[ev.INVALID + 2][2] == 0b110


def test_a_silent_magnetometer_is_noted_sooner_where_it_has_been_heard():
    tool = Tool()
    tool.half_second()
    found = [tool.half_second(mag=False) for _ in range(4)]
    assert [set(one) for one in found] == [set()] * 3 + [{ev.ABSENT}]
    never = Tool()
    assert [bool(never.half_second(mag=False)) for _ in range(10)] == [False] * 9 + [True]
    none = Tool()
    assert not any(none.half_second(mag=False, expects_mag=False) for _ in range(12))


def test_a_changed_pace_and_values_sent_twice_are_noted():
    tool = Tool()
    tool.counts[samples.STEPS], tool.counts[samples.LONG] = N, 40
    tool.counts[samples.HOLDS] = 25
    found = tool.half_second()
    assert set(found) == {ev.RATE, ev.HELD}
    assert found[ev.RATE][2] == 1
    assert found[ev.HELD][2] == 50
    assert tool.doubtful == ev.GYRO


def test_what_has_just_begun_to_stick_makes_the_sensor_doubtful():
    tool = Tool()
    tool.half_second()
    assert tool.doubtful == 0
    for _ in range(2):
        assert tool.half_second(lambda v: v.__setitem__((slice(None), 7), 3e-5)) == {}
    assert tool.doubtful == ev.MAG
    tool.half_second(lambda v: v.__setitem__((slice(None), 3), LIMITS[1]))
    assert tool.doubtful == ev.ACCEL


def test_samples_counted_one_by_one_or_together_give_the_same():
    values = np.random.default_rng(3).standard_normal((20, 2))
    values[4, 1] = math.nan
    values[7, 1] = values[6, 1]
    together, single = samples.blank()[0], samples.blank()[0]
    samples.count(together, 5, values, 1, 0, 20, 1.0)
    for i in range(20):
        samples.count(single, 5, values, 1, i, i + 1, 1.0)
    assert np.array_equal(together, single, equal_nan=True)


def test_half_seconds_with_a_push_with_samples_missing_and_of_noise_are_counted_for_the_window():
    tool = Tool()
    tool.half_second()
    assert tool.counts[samples.SPOILT :].tolist() == [0] * 6
    tool.half_second(lambda v: v.__setitem__((slice(None), 4), 16.0 + v[:, 4]))
    assert tool.counts[samples.SPOILT :].tolist() == [0, 0, 0, 1, 0, 0]
    tool.counts[samples.STEPS], tool.counts[samples.LONG] = N, 5
    tool.half_second()
    assert tool.counts[samples.SPOILT :].tolist() == [0, 0, 0, 1, 1, 0]
    noise = tool.rng.normal(0.0, 90.0, (N, 3))
    tool.half_second(lambda v: v.__setitem__((slice(None), slice(3, 6)), noise))
    # A tone of the same size steps less.
    tool.half_second(lambda v: v.__setitem__((slice(None), 3), 130.0 * np.sin(0.3 * np.arange(N))))
    assert tool.counts[samples.SPOILT + 5] == 1


def test_a_field_that_jumps_from_sample_to_sample_is_noise_and_one_that_turns_fast_or_in_another_unit_is_not():
    tool = Tool()
    tool.half_second()
    assert tool.notes[ev.NOISE, ev.SEEN] == ev.AGAINST
    garbage = tool.rng.uniform(-8e-4, 8e-4, (N, 3))
    found = tool.half_second(lambda v: v.__setitem__((slice(None), slice(6, 9)), garbage))
    assert found[ev.NOISE][3] == 0b111
    assert found[ev.NOISE][2] == pytest.approx(462, rel=0.1)
    assert tool.doubtful == ev.MAG
    turn = 31.0 * 0.01 * np.arange(N)
    for scale, field in ((1.0, garbage[:, 0] * 0.1), (1.0, 5e-4 * np.cos(turn)), (1e6, 5e-5 * np.cos(turn))):
        found = tool.half_second(lambda v, b=scale * field: v.__setitem__((slice(None), 7), b))
        assert ev.NOISE not in found
    # In gauss the noise of a still axis would be as large.
    for _ in range(2):
        found = tool.half_second(lambda v: v.__setitem__((slice(None), slice(6, 9)), 0.5 + v[:, 6:9] * 300.0))
    assert ev.NOISE not in found
