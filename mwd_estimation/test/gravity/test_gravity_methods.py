# SPDX-License-Identifier: Apache-2.0
"""What every gravity method owes: the same track for any partition, and no sample, however bad, that ends it."""

import numpy as np
import pytest
from gravity_runs import error_deg, inclination_error, rms
from hypothesis import example, given, settings
from hypothesis import strategies as st

from consistency import consistency
from mwd_estimation.core.status import Status
from mwd_estimation.core.track import Track
from mwd_estimation.gravity import methods as gravity
from mwd_sensors.core.constants import STANDARD_GRAVITY

pytestmark = pytest.mark.slow(0.1)

FIELDS = ("g_t", "sigma_inclination", "sigma_toolface", "non_gravity", "rotary_speed", "status")
every_method = pytest.mark.parametrize("name", list(gravity.METHODS))


def recording(seed: int, n: int, rate_hz: float = 100.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, rates, forces and true down of a tool turning at 120 r/min, dip 40 deg, shaken by 3 m/s^2."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / rate_hz
    turn = 4 * np.pi
    down = np.stack([np.full(n, 0.64), 0.768 * np.sin(turn * t), 0.768 * np.cos(turn * t)], axis=-1)
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    gyro = np.tile([turn, 0.0, 0.0], (n, 1)) + 0.002 * rng.standard_normal((n, 3))
    accel = -STANDARD_GRAVITY * down + 3.0 * rng.standard_normal((n, 3))
    return np.round(t * 1e9).astype(np.int64), gyro, accel, down


def followed(name: str, stamps: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> Track:
    method = gravity.method(name)
    return method.run(method.Params(), method.initial(method.Params()), stamps, gyro, accel)


@every_method
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 1000), cuts=st.lists(st.integers(0, 400), max_size=6))
@example(seed=1, cuts=list(range(1, 400)))
def test_a_block_gives_the_same_bits_as_any_partition_of_it(name, seed, cuts):
    method = gravity.method(name)
    params = method.Params()
    stamps, gyro, accel, _ = recording(seed, 400)
    gyro[50] = np.nan
    accel[60, 1] = np.inf
    accel[70:73] = 160.0
    stamps[80] = stamps[79]
    stamps[200:] += 3_000_000_000
    whole, state, parts = followed(name, stamps, gyro, accel), method.initial(params), []
    for part in np.split(np.arange(400), sorted(cuts)):
        parts.append(method.run(params, state, stamps[part], gyro[part], accel[part]))
        # A state saved and resumed is the same state.
        state = state.copy()
    for field in FIELDS:
        got = np.concatenate([getattr(part, field) for part in parts])
        assert np.array_equal(got, getattr(whole, field), equal_nan=True), field


@pytest.mark.fault_case(1, 3)
@every_method
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_no_measurement_is_rejected_and_flagged_and_changes_nothing(name, bad):
    stamps, *clean, _ = recording(2, 500)
    expected = followed(name, stamps, *clean)
    for sensor in (0, 1):
        spoilt = [block.copy() for block in clean]
        spoilt[sensor][300, 2] = bad
        got = followed(name, stamps, *spoilt)
        assert Status(int(got.status[300])) & Status.REJECTED
        assert np.array_equal(got.g_t[300], got.g_t[299])
        assert np.isfinite(got.g_t).all()
        # One rate sample is bridged by its neighbour; steady turning loses nothing.
        assert np.abs(got.g_t[-1] - expected.g_t[-1]).max() < 0.02


@pytest.mark.fault_case(41, 42)
@every_method
def test_stamps_that_do_not_advance_are_rejected_until_the_clock_has_plainly_been_set_back(name):
    stamps, gyro, accel, _ = recording(3, 600)
    stamps[100] = stamps[99]
    stamps[101] = stamps[90]
    stamps[300:] -= 200_000_000_000
    got = followed(name, stamps, gyro, accel)
    rejected = (got.status & int(Status.REJECTED)) != 0
    assert rejected[100]
    assert rejected[101]
    assert not rejected[102:300].any()
    assert rejected[300:340].all()
    assert not rejected[360:].any()
    assert np.isfinite(got.g_t).all()


@pytest.mark.fault_case(47)
@every_method
def test_a_gap_is_flagged_and_survived(name):
    stamps, gyro, accel, down = recording(4, 4000)
    stamps[2000:] += 7_000_000_000
    got = followed(name, stamps, gyro, accel)
    assert Status(int(got.status[2000])) & Status.GAP
    assert not (got.status[2001:] & int(Status.GAP)).all()
    if name != "raw":
        assert rms(error_deg(got, down)[3000:]) < 3.0


@pytest.mark.fault_case(50)
@every_method
@pytest.mark.parametrize("rate_hz", [50.0, 96.2, 285.7, 1000.0])
def test_any_rate_from_50_to_1000_hz_is_followed_from_a_start_in_motion(name, rate_hz):
    n, runs = int(40 * rate_hz), []
    for seed in (5, 6, 7):
        stamps, gyro, accel, down = recording(seed, n, rate_hz)
        got = followed(name, stamps, gyro, accel)
        if name != "raw":
            assert rms(error_deg(got, down)[n // 2 :]) < 3.0
        assert (got.status[n // 2 :] & int(Status.ROTATING)).all()
        assert got.rotary_speed[-1] == pytest.approx(4 * np.pi, rel=0.01)
        runs.append((inclination_error(got, down)[n // 2 :], got.sigma_inclination[n // 2 :]))
    found = consistency(runs, confidence=0.999)
    # The noises of the comparison methods are round figures on the safe side.
    assert found.inside if name in ("bounded", "raw") else found.nees <= found.high, found


@every_method
def test_no_samples_give_no_track_and_no_error(name):
    assert followed(name, np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3))).g_t.shape == (0, 3)


@every_method
def test_a_first_sample_that_is_bad_leaves_no_estimate_and_says_so(name):
    got = followed(name, [0], [[np.nan, 0, 0]], [[0, 0, 9.8]])
    assert np.isnan(got.g_t).all()
    assert got.sigma_inclination[0] == pytest.approx(np.pi)
    assert Status(int(got.status[0])) & Status.REJECTED
    assert Status(int(got.status[0])) & Status.INITIALISING


@every_method
def test_an_accelerometer_that_reads_zeros_shows_no_direction_and_starts_when_it_measures(name):
    stamps, gyro, accel, down = recording(3, 3000)
    accel[:200] = 0.0
    got = followed(name, stamps, gyro, accel)
    assert ((got.status[:200] & int(Status.REJECTED)) != 0).all()
    assert np.isnan(got.g_t[:200]).all()
    assert got.sigma_inclination[:200] == pytest.approx(np.pi)
    assert np.linalg.norm(got.g_t[200:], axis=1) == pytest.approx(1.0)
    # In the middle: the accelerometer alone is off by its vibration.
    assert np.median(error_deg(got, down)[-500:]) < (20.0 if name == "raw" else 3.0)


def test_blocks_of_the_wrong_shape_are_named():
    with pytest.raises(ValueError, match="gyro_t"):
        followed("s3", [1, 2, 3], np.zeros((2, 3)), np.zeros((3, 3)))
    with pytest.raises(ValueError, match="stamp_ns"):
        followed("s3", [[1]], np.zeros((1, 3)), np.zeros((1, 3)))


def test_an_unknown_method_is_an_error_that_lists_the_known():
    with pytest.raises(ValueError, match=r"no gravity method 'madgwick'; known: .*s3"):
        gravity.method("madgwick")
