# SPDX-License-Identifier: Apache-2.0
"""Continuous attitude: exact pairing on a turning tool, and the same bits for any cut of the streams."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.attitude import time_alignment
from mwd_estimation.attitude.sample import SAMPLE
from mwd_estimation.attitude.time_alignment import FieldModel, MagBlock, TimeAlignmentParams, initial
from mwd_estimation.core.status import Status
from mwd_sensors.core.frames import TAU, gravity_toolface, magnetic_toolface, mat_nt, wrap_pi

START = 10**18
FIELD_N, DOWN = np.array([2e-5, 0.0, 4e-5]), np.array([0.0, 0.0, 1.0])


def run(stamps, g_t, mag_ns, b_t, *, rate_x=16.2, sigma_tilt=0.0, model=None, params=None, state=None):
    """Rows, pairs and the number of magnetic samples used."""
    samples = np.zeros(len(stamps), dtype=SAMPLE)
    samples["stamp_ns"] = samples["sent_ns"] = stamps
    samples["down"], samples["rate_x"], samples["sigma_down"] = g_t, rate_x, sigma_tilt
    state, mag = initial() if state is None else state, MagBlock(mag_ns, np.ascontiguousarray(b_t), mag_ns)
    return time_alignment.run(params or TimeAlignmentParams(), state, model or CLEAN, samples, mag)


CLEAN = FieldModel((0.0, 0.0, 0.0), 0.0, 0.0)


def _turning(inclination, azimuth, times, rate=16.2):
    return mat_nt(inclination, np.full(len(times), azimuth), (rate * times) % TAU)


def _seen(mat, v_n):
    return np.einsum("kji,j->ki", mat, v_n)


def _ns(times):
    return START + np.round(times * 1e9).astype(np.int64)


def _run(inclination, azimuth, *, model=CLEAN, rate=16.2, **how):
    """Rows of a turning tool whose magnetometer sends each third sample, 3 ms late; pairs; attitudes; field read."""
    times = np.arange(600) * 0.01
    mag_times = times[::3] + 0.003
    mat, mag_mat = (_turning(inclination, azimuth, t, rate) for t in (times, mag_times))
    b_t = _seen(mag_mat, FIELD_N) + model.interference
    rows, pairs, _ = run(_ns(times), _seen(mat, DOWN), _ns(mag_times), b_t, rate_x=rate, model=model, **how)
    return rows, pairs, mat, (_ns(mag_times), mag_mat, b_t)


@pytest.mark.parametrize(("inclination", "azimuth"), [(0.6, 2.0), (1.5, 5.0), (3.1, 1.0), (0.02, 0.3), (2.2, 6.2)])
def test_a_fast_turning_tool_keeps_its_azimuth_whatever_the_stamps_of_the_magnetometer(inclination, azimuth):
    rows, _, mat, _ = _run(inclination, azimuth)
    np.testing.assert_allclose(wrap_pi(rows["azimuth"][5:] - azimuth), 0.0, atol=1e-9)
    # Held between samples by the x gyro: exact along the axis, second order in the inclination near vertical.
    slack = 1e-9 if 0.1 < inclination < 3.0 else 1e-3
    np.testing.assert_allclose(wrap_pi(rows["magnetic_toolface"] - magnetic_toolface(mat))[5:], 0.0, atol=slack)


def test_known_interference_is_taken_off_and_the_named_north_added():
    model = FieldModel((3e-6, -1e-6, 2e-6), 0.0, 0.0, north_correction=0.1)
    rows, *_ = _run(0.9, 4.0, model=model)
    np.testing.assert_allclose(wrap_pi(rows["azimuth"][5:] - 4.1), 0.0, atol=1e-9)


def test_no_azimuth_is_invented_before_the_first_magnetic_sample_or_after_the_last_is_old():
    times = np.arange(500) * 0.01
    mat, stamps = _turning(0.8, 1.0, times, 0.0), _ns(times)
    params = TimeAlignmentParams(mag_timeout_ns=1_000_000_000)
    mag = stamps[100:200], _seen(mat[100:200], FIELD_N)
    rows, _, used = run(stamps, _seen(mat, DOWN), *mag, rate_x=0.0, params=params)
    assert used == 100
    known = np.isfinite(rows["azimuth"])
    assert not known[:100].any()
    assert known[103:290].all()
    assert not known[301:].any()
    assert ((rows["status"] & Status.NO_MAG > 0) == ~known).all()
    assert (rows["sigma_azimuth"][~known] == np.pi).all()


@pytest.mark.parametrize("nothing", [0.0, 1e-300, np.nan])
def test_a_sample_without_a_direction_of_gravity_has_no_angles(nothing):
    n = 40
    g_t = np.tile([0.6, 0.0, -0.8], (n, 1))
    g_t[20:30] *= nothing
    stamps = START + np.arange(n) * 10_000_000
    b_t = np.tile([3e-5, 1e-5, 2e-5], (n, 1))
    rows, *_ = run(stamps, g_t, stamps, b_t, rate_x=0.0)
    known = (np.arange(n) < 20) | (np.arange(n) >= 30)
    for angle in ("inclination", "gravity_toolface"):
        assert np.array_equal(np.isfinite(rows[angle]), known)
    assert np.isnan(rows["azimuth"][20:30]).all()
    assert np.isfinite(rows["azimuth"][30:]).all()


def test_near_vertical_is_entered_and_left_with_hysteresis():
    inclination = np.radians(np.concatenate([np.linspace(6, 2, 50), np.linspace(2, 6, 50)]))
    mat = mat_nt(inclination, np.zeros(100), np.zeros(100))
    stamps = START + np.arange(100) * 10**7
    rows, *_ = run(stamps, _seen(mat, DOWN), stamps[:0], np.zeros((0, 3)), rate_x=0.0)
    near = rows["status"] & Status.NEAR_VERTICAL > 0
    np.testing.assert_array_equal(near[:50], np.degrees(inclination[:50]) < 3.0)
    np.testing.assert_array_equal(near[50:], np.degrees(inclination[50:]) <= 4.0)


def test_the_sigma_of_the_azimuth_covers_interference_by_geometry():
    north, east = (_run(0.9, azi, model=CLEAN._replace(sigma_axial=1e-6), rate=0.0)[0] for azi in (0.0, np.pi / 2))
    # Axial interference does not turn the azimuth of a north-going hole; east-going by E sin(I) / H.
    assert north["sigma_azimuth"][-1] == pytest.approx(0.0, abs=1e-6)
    assert east["sigma_azimuth"][-1] == pytest.approx(1e-6 * np.sin(0.9) / 2e-5, rel=1e-3)


def test_the_sigma_of_the_magnetic_toolface_is_that_of_the_level_field_whatever_the_azimuth():
    model = CLEAN._replace(sigma_cross=1e-7, sigma_axial=1e-6, sigma_north=2e-3)
    for azimuth in (0.0, np.pi / 2):
        rows, *_ = _run(0.9, azimuth, model=model, rate=0.0)
        assert rows["sigma_magnetic_toolface"][-1] == pytest.approx(np.hypot(1e-7 / 2e-5, 2e-3), rel=1e-6)
        np.testing.assert_allclose(rows["total"][5:], np.linalg.norm(FIELD_N), rtol=1e-12)
    assert np.isnan(rows["total"][0])
    assert rows["sigma_magnetic_toolface"][0] == np.pi


@pytest.mark.slow
@given(cuts=st.lists(st.integers(0, 300), max_size=5), mag_ahead=st.integers(0, 50))
def test_any_cut_into_blocks_gives_the_same_bits(cuts, mag_ahead):
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.uniform(0.005, 0.015, 300))
    mat, stamps = _turning(1.1, 0.4, times), _ns(times)
    g_t, b_t = _seen(mat, DOWN), _seen(mat, FIELD_N) + 1e-7 * rng.normal(size=(300, 3))
    whole, pairs, _ = run(stamps, g_t, stamps, b_t, sigma_tilt=1e-3)
    state, pieces, handed_on, mag_from = initial(), [], [], 0
    for block in np.split(np.arange(300), sorted(cuts)):
        if not len(block):
            continue
        mag = slice(mag_from, min(block[-1] + 1 + mag_ahead, 300))
        again, (rows, handed, used) = (
            run(stamps[block], g_t[block], stamps[mag], b_t[mag], sigma_tilt=1e-3, state=one)
            for one in (state.copy(), state)
        )
        np.testing.assert_array_equal(again[0]["azimuth"], rows["azimuth"])
        mag_from += used
        pieces.append(rows)
        handed["place"] += block[0]
        handed_on.append(handed)
    for parts, expected in ((pieces, whole), (handed_on, pairs)):
        for name in expected.dtype.names:
            np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), expected[name])


def test_one_magnetic_sample_in_each_interval_is_handed_on_with_the_gravity_of_its_own_time():
    params, model = TimeAlignmentParams(interval_ns=500_000_000), FieldModel((1e-6, 0.0, 0.0), 2e-7, 1e-7)
    rows, pairs, _, (mag_ns, mag_mat, b_t) = _run(0.9, 2.0, model=model, params=params, sigma_tilt=1e-3)
    assert (np.diff(pairs["stamp_ns"] // 500_000_000) == 1).all()
    assert len(pairs) == 12
    at = np.searchsorted(mag_ns, pairs["stamp_ns"])
    np.testing.assert_allclose(pairs["g_t"], _seen(mag_mat, DOWN)[at], atol=1e-9)
    np.testing.assert_array_equal(pairs["b_t"], b_t[at])
    np.testing.assert_allclose(wrap_pi(pairs["azimuth"] - 2.0), 0.0, atol=1e-9)
    np.testing.assert_allclose(pairs["sigma"][1:], rows["sigma_azimuth"][pairs["place"][1:]], rtol=1e-9)


@pytest.mark.parametrize("inclination", [0.9, 0.01])
def test_toolfaces_are_carried_on_over_the_latency(inclination):
    late, *_ = _run(inclination, 1.0, params=TimeAlignmentParams(latency_s=0.08), rate=2.0)
    ahead = mat_nt(inclination, np.full(600, 1.0), (2.0 * (np.arange(600) * 0.01 + 0.08)) % TAU)
    slack = 1e-9 if inclination > 0.1 else 1e-3
    np.testing.assert_allclose(wrap_pi(late["magnetic_toolface"] - magnetic_toolface(ahead))[5:], 0.0, atol=slack)
    np.testing.assert_allclose(
        wrap_pi(late["gravity_toolface"] - gravity_toolface(-_seen(ahead, DOWN))), 0.0, atol=1e-9
    )
    np.testing.assert_allclose(late["inclination"], inclination, atol=1e-9)
