# SPDX-License-Identifier: Apache-2.0
"""What a track is, which samples are admitted, and when a tool counts as still, sliding or rotating."""

import numpy as np
import pytest

from mwd_estimation.core import track
from mwd_estimation.core.status import Status
from mwd_sensors.core import frames

GOOD = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.0, 9.8])


def clock() -> np.record:
    return np.zeros(1, track.CLOCK)[0]


def test_samples_are_first_then_next_then_after_a_gap():
    c = clock()
    assert track.admit(c, 5, *GOOD, 100) == track.FIRST
    assert track.admit(c, 105, *GOOD, 100) == track.NEXT
    assert track.admit(c, 206, *GOOD, 100) == track.AFTER_GAP
    assert c.last_ns == 206


def test_a_sample_is_taken_with_the_time_since_the_last_and_what_is_said_of_it():
    c, fast = clock(), np.array([9.0, 0.0, 0.0])
    assert track.take(c, 5, *GOOD, 100, 10.0, 160.0) == (track.FIRST, 0.0, 0)
    assert track.take(c, 105, fast, GOOD[1], 100, 9.0, 160.0) == (track.NEXT, pytest.approx(1e-7), Status.CLIPPED)
    assert track.take(c, 105, *GOOD, 100, 10.0, 160.0) == (track.REJECTED, 0.0, Status.REJECTED)
    assert track.take(c, 305, *GOOD, 100, 10.0, 9.0) == (
        track.AFTER_GAP,
        pytest.approx(2e-7),
        Status.GAP | Status.CLIPPED,
    )


@pytest.mark.parametrize("place", range(6))
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_no_measurement_is_rejected_and_does_not_move_the_clock(place, bad):
    c = clock()
    track.admit(c, 5, *GOOD, 100)
    values = np.concatenate(GOOD)
    values[place] = bad
    assert track.admit(c, 50, values[:3], values[3:], 100) == track.REJECTED
    assert c.last_ns == 5


@pytest.mark.fault_case(44)
def test_one_stamp_from_the_future_does_not_end_the_estimate():
    c = clock()
    track.admit(c, 0, *GOOD, 100)
    assert track.admit(c, 10**18, *GOOD, 100) == track.AFTER_GAP
    verdicts = [track.admit(c, 10 * k, *GOOD, 100) for k in range(1, 61)]
    assert verdicts[: track.BACKWARD_LIMIT] == [track.REJECTED] * track.BACKWARD_LIMIT
    assert verdicts[track.BACKWARD_LIMIT] == track.AFTER_GAP
    assert verdicts[-1] == track.NEXT


def test_a_stamp_that_is_stuck_is_never_accepted():
    c = clock()
    track.admit(c, 1000, *GOOD, 100)
    assert {track.admit(c, 500, *GOOD, 100) for _ in range(200)} == {track.REJECTED}


@pytest.mark.parametrize(
    ("rate", "non_gravity", "expected"),
    [
        ((0.0, 0.001, 0.0), 0.01, Status.STILL),
        ((0.0, 0.2, 0.0), 0.01, Status.SLIDING),
        ((0.0, 0.001, 0.0), 5.0, Status.SLIDING),
        ((6.0, 0.0, 0.0), 5.0, Status.ROTATING),
        ((-6.0, 0.0, 0.0), 0.0, Status.ROTATING),
    ],
)
def test_still_sliding_and_rotating_are_distinguished(rate, non_gravity, expected):
    motion = np.zeros(1, track.MOTION)[0]
    for _ in range(500):
        bits = track.follow_motion(motion, 0.01, np.array(rate), non_gravity)
    assert bits == int(expected)


def test_rotary_speed_is_a_first_order_low_pass_of_its_own_output():
    motion = np.zeros(1, track.MOTION)[0]
    dt, out = 0.01, []
    for _ in range(100):
        track.follow_motion(motion, dt, np.array([10.0, 0.0, 0.0]), 0.0)
        out.append(motion.rotary_speed)
    share = dt / (track.ROTARY_LAG + dt)
    assert out == pytest.approx(10.0 * (1.0 - (1.0 - share) ** np.arange(1, 101)))


def test_inclination_of_a_track_is_the_one_of_frames():
    rng = np.random.default_rng(0)
    got = track.Track.empty(50)
    g = rng.standard_normal((50, 3))
    got.g_t[:] = g / np.linalg.norm(g, axis=1, keepdims=True)
    assert got.inclination == pytest.approx(frames.inclination(-got.g_t))
