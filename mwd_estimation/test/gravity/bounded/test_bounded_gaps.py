# SPDX-License-Identifier: Apache-2.0
"""Silences: attitude goes on by the rates on either side, with a sigma that covers it, and begins anew only beyond."""

import numpy as np
import pytest
from gravity_runs import PARAMS
from turned_tool import START, noisy_rates, toolface_error, turned

from mwd_estimation.core.status import Status
from mwd_estimation.gravity.bounded import filter as gravity_bounded
from mwd_estimation.gravity.bounded.filter import BoundedParams
from mwd_sensors.core.frames import mat_nt


def turning(speed, seconds=40.0, seed=3):
    """Samples and true toolface of a tool at 50 deg that turns as `speed(t)`, rad/s, says, on 2 m/s^2 of shaking."""
    stamps, angle = turned(speed, seconds)
    n, rng = len(stamps), np.random.default_rng(seed)
    gyro = noisy_rates(angle, rng)
    gyro[0, 0] += speed(np.zeros(1))[0]
    mat = mat_nt(np.radians(50.0), np.zeros(n), angle)
    shaking = rng.normal(size=(n + 1, 3))
    accel = np.einsum("kji,j->ki", mat, [0.0, 0.0, -9.81]) + 2.0 * np.diff(shaking, axis=0) / np.sqrt(2.0)
    return stamps, gyro, accel, angle


def steady(t):
    return np.full(len(t), 6.0)


def resting(t):
    return np.zeros(len(t))


def sticking(t):
    return 8.0 * (1.0 - np.cos(2.0 * np.pi * 0.3 * t))


def without(data, silences):
    t = (data[0] - START) * 1e-9
    kept = np.all([(t < a) | (t >= b) for a, b in silences], axis=0)
    return tuple(column[kept] for column in data)


def followed(data, params=PARAMS):
    return gravity_bounded.run(params, gravity_bounded.initial(params), *data[:3])


@pytest.mark.parametrize(("speed", "silence"), [(steady, 1.0), (resting, 5.0), (sticking, 0.2)])
def test_a_silence_does_not_begin_the_attitude_anew(speed, silence):
    data = without(turning(speed), [(20.0, 20.0 + silence)])
    track = followed(data)
    after = int(np.searchsorted(data[0], START + 19_990_000_000, side="right"))
    assert track.status[after] & Status.GAP
    assert not (track.status[after:] & Status.INITIALISING).any()
    assert np.abs(toolface_error(track, data[3])[after:]).max() < np.radians(12.0)
    # Soon as good as before.
    assert np.abs(toolface_error(track, data[3])[-500:]).max() < np.radians(0.5)


def test_sigma_covers_what_turned_during_the_silence():
    ratios = []
    for seed in range(4):
        for speed in (steady, sticking):
            data = without(turning(speed, seed=seed), [(k, k + 0.15 + 0.05 * (k % 3)) for k in range(15, 38, 4)])
            track = followed(data)
            first = np.flatnonzero(track.status & Status.GAP)
            known = first[track.sigma_toolface[first] < 0.5]
            ratios += list(toolface_error(track, data[3])[known] / track.sigma_toolface[known])
    assert len(ratios) > 20
    assert np.sqrt(np.mean(np.square(ratios))) < 2.0


def test_where_the_speed_may_have_been_anything_only_the_roll_begins_anew():
    data = without(turning(sticking), [(20.0, 21.5)])
    track = followed(data)
    after = int(np.flatnonzero(track.status & Status.GAP)[0])
    sought = np.flatnonzero(track.status[after:] & Status.INITIALISING) + after
    assert len(sought)
    assert (track.sigma_toolface[sought] == np.pi).all()
    inclination = np.arccos(-track.g_t[:, 0])
    assert np.abs(np.pi - inclination[sought] - np.radians(50.0)).max() < np.radians(3.0)
    assert np.abs(toolface_error(track, data[3])[-500:]).max() < np.radians(0.7)


@pytest.mark.fault_case(47)
def test_a_silence_beyond_the_bridge_begins_anew():
    data = without(turning(resting), [(20.0, 24.0)])
    track = followed(data, BoundedParams(max_bridged_gap_s=3.0))
    after = int(np.flatnonzero(track.status & Status.GAP)[0])
    assert track.status[after] & Status.INITIALISING


def test_slow_samples_are_no_silences():
    assert not (followed([column[::20] for column in turning(resting)]).status & Status.GAP).any()


def test_blocks_of_any_length_give_the_same_bits():
    data = without(turning(resting), [(k, k + 0.3) for k in range(10, 38, 3)])
    whole, state = followed(data), gravity_bounded.initial(PARAMS)
    blocks = [[column[k : k + 37] for column in data[:3]] for k in range(0, len(data[0]), 37)]
    pieces = [gravity_bounded.run(PARAMS, state, *block) for block in blocks]
    for name in ("g_t", "status"):
        assert np.concatenate([getattr(piece, name) for piece in pieces]).tobytes() == getattr(whole, name).tobytes()


@pytest.mark.parametrize("speed", [resting, steady])
def test_a_tool_that_turned_in_a_silence_is_found_again_within_two_seconds(speed):
    stamps, gyro, accel, angle = without(turning(speed), [(15.0, 20.0)])
    behind, half_turn = stamps - START >= 20_000_000_000, np.diag([1.0, -1.0, -1.0])
    gyro[behind], accel[behind] = gyro[behind] @ half_turn, accel[behind] @ half_turn
    got = followed((stamps, gyro, accel))
    error = toolface_error(got, angle + np.pi * behind)
    found = stamps - START >= 22_000_000_000
    assert np.degrees(np.abs(error[found]).max()) < 3.0
    assert (np.abs(error[found]) < 5.0 * got.sigma_toolface[found]).all()
