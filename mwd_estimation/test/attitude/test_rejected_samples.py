# SPDX-License-Identifier: Apache-2.0
"""The row of a sample that was not used: the attitude at its own stamp, with a sigma that covers it, or none."""

import numpy as np
import pytest
from tool_streams import REFERENCE, seen, streams
from turned_tool import turned

from mwd_estimation.core.status import Status
from mwd_estimation.gravity import methods as gravity
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings, Gravity
from mwd_sensors.core.frames import mat_nt, wrap_pi


def turning(speed, seconds=12.0, inclination=0.9):
    """A tool that turns as `speed(t)`, rad/s, says; samples, true toolface and true down."""
    _, angle = turned(speed, seconds)
    mat = mat_nt(inclination, np.full(len(angle), 0.7), angle)
    imu, mag = streams(mat, np.random.default_rng(3), rate=100.0 * np.diff(angle, prepend=angle[0]))
    return imu, mag, np.mod(angle, 2.0 * np.pi), seen(mat, [0.0, 0.0, 1.0])


def estimated(imu, mag, method="bounded", cuts=()):
    pipeline = Pipeline(EstimatorSettings(gravity=Gravity(method)), REFERENCE)
    pipeline.push_mag(mag)
    outputs = [pipeline.push_imu(part) for part in np.split(imu, list(cuts))]
    return tuple(np.concatenate([getattr(one, name) for one in outputs]) for name in ("attitude", "gravity"))


def steady(t):
    return np.full_like(t, 4.0 * np.pi)


def stick_slip(t):
    return 8.0 + 8.0 * np.sin(4.0 * t)


def with_bad_values(imu):
    bad = np.arange(450, len(imu), 37)
    imu["angular_velocity"][bad[::3], 0] = np.nan
    imu["linear_acceleration"][bad[1::3], 2] = np.inf
    imu["angular_velocity"][bad[2::3], 0] = 300.0
    return bad, np.arange(len(imu))


def with_late_ones(imu):
    order = np.arange(len(imu))
    for k in range(450, len(imu) - 8, 37):
        order[[k, k + 3]] = order[[k + 3, k]]
    imu[:] = imu[order]
    return np.flatnonzero(np.diff(np.maximum.accumulate(order), prepend=-1) == 0), order


@pytest.mark.parametrize("method", sorted(gravity.METHODS))
@pytest.mark.parametrize("speed", [steady, stick_slip])
@pytest.mark.parametrize("spoil", [with_bad_values, with_late_ones])
def test_a_refused_sample_of_a_turning_tool_is_given_the_toolface_of_its_own_stamp(spoil, speed, method):
    imu, mag, truth, down = turning(speed)
    refused, order = spoil(imu)
    attitude, gravity_rows = estimated(imu, mag, method)
    rejected = attitude["status"] & int(Status.REJECTED) != 0
    assert np.array_equal(np.flatnonzero(rejected), refused)
    off = wrap_pi(attitude["gravity_toolface"] - truth[order])
    sigma = attitude["sigma_gravity_toolface"]
    used = ~rejected & (np.arange(len(imu)) > 400)
    # As good as its neighbours, but for what the rate changed.
    assert np.max(np.abs(off[refused])) < np.max(np.abs(off[used])) + np.radians(0.5)
    assert np.all(sigma[refused] >= 0.9 * np.min(sigma[used]))
    square = off**2 / sigma**2
    assert np.mean(square[refused]) < max(1.5 * np.mean(square[used]), 1.5)
    angle = np.arccos(np.clip(np.sum(gravity_rows["gravity"] * down[order], axis=1), -1.0, 1.0))
    assert np.max(angle[refused]) < np.max(angle[used]) + np.radians(0.5)
    magnetic = wrap_pi(attitude["magnetic_toolface"][1:] - attitude["gravity_toolface"][1:])
    assert np.ptp(np.unwrap(magnetic[500:])) < np.ptp(np.unwrap(magnetic[500:][used[501:]])) + np.radians(0.5)


def test_rows_of_used_samples_and_of_repeated_stamps_are_as_they_were():
    imu, mag, _, _ = turning(steady, seconds=6.0)
    twice = np.repeat(np.arange(len(imu)), np.where(np.arange(len(imu)) % 50 == 7, 2, 1))
    plain, _ = estimated(imu, mag)
    attitude, _ = estimated(imu[twice], mag)
    again = np.flatnonzero(np.diff(twice, prepend=-1) == 0)
    assert (attitude["status"][again] & int(Status.REJECTED) != 0).all()
    assert np.delete(attitude, again).tobytes() == plain.tobytes()
    for name in ("gravity_toolface", "sigma_gravity_toolface", "inclination", "magnetic_toolface"):
        assert np.array_equal(attitude[name][again], attitude[name][again - 1], equal_nan=True)


def test_far_from_any_sample_used_the_toolface_is_withheld_and_the_inclination_stays():
    imu, mag, _, _ = turning(steady, seconds=6.0)
    imu["linear_acceleration"][500:520] = np.nan
    attitude, gravity_rows = estimated(imu, mag)
    # A sample of long ago.
    imu["stamp_ns"][550] -= 700_000_000
    late, _ = estimated(imu, mag)
    assert (attitude["sigma_gravity_toolface"][500:510] > 0.0).all()
    assert (np.diff(attitude["sigma_gravity_toolface"][500:510]) > 0.0).all()
    for rows, lost in ((attitude, slice(510, 520)), (late, slice(550, 551))):
        assert np.isnan(rows["sigma_gravity_toolface"][lost]).all()
        assert np.isnan(rows["sigma_magnetic_toolface"][lost]).all()
        assert np.isnan(rows["gravity_toolface"][lost]).all()
        assert (rows["sigma_inclination"][lost] > 0.0).all()
        assert (np.abs(rows["inclination"][lost] - 0.9) < 0.01).all()
    assert np.isnan(gravity_rows["sigma"][510:520]).all()
    assert np.isnan(gravity_rows["gravity"][510:520]).all()


def test_near_vertical_the_magnetic_toolface_is_that_of_the_row_s_own_stamp():
    for spoil in (with_bad_values, with_late_ones):
        imu, mag, truth, _ = turning(steady, inclination=0.01)
        refused, order = spoil(imu)
        attitude, _ = estimated(imu, mag)
        off = wrap_pi(attitude["magnetic_toolface"] - truth[order] - 0.7)
        used = np.setdiff1d(np.arange(400, len(imu)), refused)
        assert np.max(np.abs(off[refused])) < np.max(np.abs(off[used])) + np.radians(0.5)


@pytest.mark.slow
@pytest.mark.parametrize("spoil", [with_bad_values, with_late_ones])
def test_any_cut_gives_the_same_bits(spoil):
    imu, mag, _, _ = turning(stick_slip, seconds=8.0)
    spoil(imu)
    whole = estimated(imu, mag)
    for cuts in (range(1, 800), (451, 452, 453, 454, 487)):
        for one, other in zip(estimated(imu, mag, cuts=cuts), whole, strict=True):
            assert one.tobytes() == other.tobytes()
