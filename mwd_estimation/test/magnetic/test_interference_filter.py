# SPDX-License-Identifier: Apache-2.0
"""The recursive filter of the tool's own field: honest sigma, the same by blocks, slopes, disturbance, gyro aid."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.magnetic_geometry import raw_azimuth
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.magnetic import interference_filter
from mwd_estimation.magnetic.interference_filter import INNOVATION, STATE, FieldSamples, InterferenceParams, initial
from mwd_sensors.core.frames import mat_nt, wrap_pi

DEG = math.pi / 180.0
SIGMA_B, SIGMA_G, TAU, RATE = 50e-9, 5e-4, 10.0, 10.0
PARAMS = InterferenceParams(axial=9e-7, cross_axial=1.5e-7, noise=SIGMA_B, walk=0.0, field_walk=0.0, varying=1e-9)
ERRORS = SensorErrors(magnetometer_bias_nt=0.0, magnetometer_scale=0.001)
PLAIN = SensorErrors(magnetometer_bias_nt=0.0)
FIELD = np.array([16e-6, 47e-6])


def run(params, state, *samples):
    return interference_filter.run(params, state, FieldSamples(*samples))


def aid_azimuth(params, state, *given):
    return interference_filter.aid_azimuth(params, state, *given)


def learnt(rows):
    """Which samples were learnt from: those within the gate."""
    return rows["ratio"] <= 1.0


def axial(state):
    return float(state[0].x[0]), math.sqrt(state[0].P[0, 0])


def state_of(x):
    """A state with these values against the reference of these tests, and room for an innovation."""
    state = np.zeros(1, dtype=STATE)
    state[0].x[:], state[0].field[:] = x, FIELD
    return state[0], np.zeros(1, dtype=INNOVATION)[0]


def drilled(seed, inc, azi, rpm, seconds):
    """Samples of a turning tool with drawn bias, scale and reference error, white field noise, slow gravity error."""
    rng, n = np.random.default_rng(seed), int(seconds * RATE)
    t = np.arange(n) / RATE
    inc, azi = (np.interp(t, np.linspace(0, seconds, len(x)), x) * DEG for x in (inc, azi))
    toolface = 2 * np.pi * np.cumsum(rpm / 60 * (1 + 0.3 * np.sin(t / 7))) / RATE + rng.uniform(0, 6)
    mat_tn = np.swapaxes(mat_nt(inc, azi, toolface), 1, 2)
    reference = Reference(50e-6 + rng.normal(0, 143e-9), (72 + rng.normal(0, 0.218)) * DEG)
    bias, scale = rng.normal(0, [900e-9, 150e-9, 150e-9]), rng.normal(0, 0.001, 3)
    b_t = mat_tn @ np.array([50e-6 * math.cos(72 * DEG), 0, 50e-6 * math.sin(72 * DEG)])
    b_t = b_t * (1 + scale) + bias + rng.normal(0, SIGMA_B, (n, 3))
    keep = math.exp(-1 / RATE / TAU)
    shocks = rng.normal(0, SIGMA_G, (n, 3)) * math.sqrt(1 - keep**2)
    shocks[0] /= math.sqrt(1 - keep**2)
    tilt = lfilter([1.0], [1.0, -keep], shocks, axis=0)
    g_t = mat_tn @ np.array([0, 0, 1.0])
    g_t += np.cross(tilt, g_t)
    g_t /= np.linalg.norm(g_t, axis=1, keepdims=True)
    stamps = (t * 1e9).astype(np.int64)
    return (stamps, g_t, b_t, np.full(n, SIGMA_G)), reference, azi, bias


# Runs, hole, r/min: what should be seen well (sigma of axial, cross-axial below, nT).
CASES = {
    "still": ([30], [60], 0, 120, 200, 150),
    "turning": ([30], [60], 60, 120, 200, 6),
    "turning near vertical": ([5], [60], 60, 120, 200, 8),
    "building while turning": ([10, 60], [60, 80], 60, 600, 60, 3),
    "east-west horizontal": ([89, 91], [88, 92], 60, 600, 400, 3),
    "turning horizontally": ([90], [60, 120], 60, 600, 30, 3),
}


@pytest.mark.parametrize("case", CASES)
def test_bias_and_azimuth_err_by_their_sigma_in_every_attitude(case):
    inc, azi, rpm, seconds, axial_nt, cross_nt = CASES[case]
    scores, turns = [], []
    for seed in range(30):
        samples, reference, truth, bias = drilled(seed, inc, azi, rpm, seconds)
        got = run(PARAMS, initial(PARAMS, reference, ERRORS), *samples)
        assert learnt(got).mean() > 0.99
        scores.append(((got["bias"][-1] - bias) / got["sigma"][-1]) ** 2)
        turns.append((wrap_pi(got["azimuth"][-1] - truth[-1]) / got["sigma_azimuth"][-1]) ** 2)
        assert got["sigma"][-1, 0] < axial_nt * 1e-9
        assert (got["sigma"][-1, 1:] < cross_nt * 1e-9).all()
    # 30 runs: a mean square lies in 0.56 to 1.57 in 95 of 100 cases; slow errors are counted on the safe side.
    assert (np.mean(scores, axis=0) < 1.7).all()
    assert (np.mean(scores, axis=0) > 0.1).all()
    assert 0.4 < np.mean(turns) < 1.6


def test_east_west_horizontal_with_900_nt_comes_within_half_a_degree_by_magnetics_alone():
    errors, raw = [], []
    for seed in range(20):
        samples, reference, truth, bias = drilled(seed, [89, 91], [85, 95], 60, 600)
        stamps, g_t, b_t, sigma_g = samples
        b_t = b_t - bias + np.array([900e-9, 100e-9, -100e-9])
        got = run(PARAMS, initial(PARAMS, reference, ERRORS), stamps, g_t, b_t, sigma_g)
        errors.append(wrap_pi(got["azimuth"][-1] - truth[-1]) / DEG)
        raw.append(wrap_pi(raw_azimuth(-g_t[-1], b_t[-1]) - truth[-1]) / DEG)
    assert np.sqrt(np.mean(np.square(raw))) > 3.0
    assert np.sqrt(np.mean(np.square(errors))) < 0.5


def test_one_block_and_many_give_the_same_bits_and_a_saved_state_resumes():
    samples, reference, *_ = drilled(1, [20, 40], [60], 60, 30)
    whole_state = initial(PARAMS, reference, ERRORS)
    whole = run(PARAMS, whole_state, *samples)
    state, parts = initial(PARAMS, reference, ERRORS), []
    for start, stop in ((0, 1), (1, 2), (2, 50), (50, 51), (51, 300)):
        state = state.copy()
        parts.append(run(PARAMS, state, *(x[start:stop] for x in samples)))
    for name in ("bias", "sigma", "azimuth", "sigma_azimuth", "ratio"):
        assert np.array_equal(np.concatenate([part[name] for part in parts]), whole[name]), name
    assert state.tobytes() == whole_state.tobytes()


def test_slopes_of_the_innovations_agree_with_finite_differences():
    rng = np.random.default_rng(3)
    g = rng.normal(size=3)
    g /= np.linalg.norm(g)
    x = np.r_[rng.normal(0, 1e-7, 3), rng.normal(0, 1e-3, 3), 1e-7, -1e-7]
    # A reading that fits the state exactly: there the field expected is the field read.
    level = np.cross(g, [1.0, 0.3, 0.2])
    level /= np.linalg.norm(level)
    b = ((FIELD[1] + x[7]) * g + (FIELD[0] + x[6]) * level + x[:3]) / (1 - x[3:6])

    def off(x):
        state, m = state_of(x)
        interference_filter._directions(state, g, b, m)
        return np.array([m.vertical - FIELD[1] - x[7], m.horizontal - FIELD[0] - x[6]])

    assert off(x) == pytest.approx([0, 0], abs=1e-18)
    state, m = state_of(x)
    interference_filter._directions(state, g, b, m)
    interference_filter._slopes(g, m)
    for k, step in enumerate([1e-9] * 3 + [1e-5] * 3 + [1e-9] * 2):
        change = np.zeros(8)
        change[k] = step
        numeric = (off(x + change) - off(x - change)) / (2 * step)
        # By scale the slope is by the true field, 1 - scale of the one read.
        assert list(m.slope[:, k]) == pytest.approx(list(numeric), rel=5e-3, abs=2e-7)


def test_casing_is_not_learnt_and_a_new_assembly_is_after_patience():
    params = InterferenceParams(axial=9e-7, cross_axial=1.5e-7, noise=SIGMA_B, max_reset_time_s=20.0)
    samples, reference, truth, _ = drilled(2, [30], [60], 60, 120)
    stamps, g_t, b_t, sigma_g = samples
    state = initial(params, reference, PLAIN)
    run(params, state, *(x[:400] for x in samples))
    kept = state["x"].copy()
    passing = b_t[400:450] + np.array([4e-6, 3e-6, -2e-6])
    got = run(params, state, stamps[400:450], g_t[400:450], passing, sigma_g[:50])
    assert not learnt(got).any()
    assert (got["ratio"] > 1.0).all()
    assert np.array_equal(state["x"], kept)
    # 70 s with 3 uT more along the axis: first refused, then begun anew.
    changed = b_t[500:] + np.array([1.5e-6, 0, 0])
    got = run(params, state, stamps[500:], g_t[500:], changed, sigma_g[500:])
    assert not learnt(got)[:100].any()
    assert learnt(got)[-100:].all()
    assert abs(wrap_pi(got["azimuth"][-1] - truth[-1])) < 4 * got["sigma_azimuth"][-1]


def test_from_the_interference_a_station_showed_it_starts_and_after_casing_starts_again():
    params = InterferenceParams(axial=9e-7, cross_axial=1.5e-7, noise=SIGMA_B, max_reset_time_s=20.0)
    (stamps, g_t, b_t, sigma_g), reference, truth, bias = drilled(2, [30], [60], 60, 120)
    strong = 4e-5
    b_t = b_t + np.array([strong, 0, 0])
    hopeless = run(params, initial(params, reference, PLAIN), stamps, g_t, b_t, sigma_g)
    assert not learnt(hopeless).any()
    state = initial(params, reference, PLAIN, axial=(strong + bias[0] + 3e-7, 2e-7))
    assert axial(state)[1] == pytest.approx(900e-9)
    b_t[200:700] += np.array([9e-6, 5e-6, 0])
    got = run(params, state, stamps, g_t, b_t, sigma_g)
    assert not learnt(got)[250:650].any()
    for k in (199, -1):
        assert learnt(got)[k]
        assert abs(got["bias"][k, 0] - strong - bias[0]) < 3 * got["sigma"][k, 0]
        assert abs(wrap_pi(got["azimuth"][k] - truth[k])) < 3 * got["sigma_azimuth"][k]
    assert axial(initial(params, reference, PLAIN, axial=(strong, 3e-6))) == (strong, pytest.approx(3e-6))


def test_samples_not_finite_or_repeated_are_not_learnt():
    samples, reference, *_ = drilled(4, [30], [60], 60, 10)
    stamps, g_t, b_t, sigma_g = samples
    state = initial(PARAMS, reference, ERRORS)
    run(PARAMS, state, *(x[:5] for x in samples))
    before = state.copy()
    lost = run(PARAMS, state, stamps[5:6], g_t[5:6], np.full((1, 3), np.nan), sigma_g[5:6])[0]
    assert math.isnan(lost["azimuth"])
    assert lost["sigma_azimuth"] == math.pi
    again = run(PARAMS, state, stamps[4:5], g_t[6:7], b_t[6:7], sigma_g[6:7])[0]
    assert math.isfinite(again["azimuth"])
    assert again["ratio"] <= 1.0
    assert state.tobytes() == before.tobytes()


def test_a_gyro_azimuth_tells_the_axial_interference_where_the_reference_cannot():
    samples, reference, truth, _ = drilled(6, [90], [90], 30, 60)
    stamps, g_t, b_t, sigma_g = samples
    b_t = b_t + np.array([500e-9, 0, 0])
    state = initial(PARAMS, reference, ERRORS)
    before = run(PARAMS, state, stamps, g_t, b_t, sigma_g)["sigma_azimuth"][-1]
    ratio = aid_azimuth(PARAMS, state, g_t[-1], b_t[-1], truth[-1] + 0.2 * DEG, 0.3 * DEG)
    assert ratio < 1.0
    late = run(PARAMS, state, stamps[-1:] + 10**8, g_t[-1:], b_t[-1:], sigma_g[-1:])
    assert late["sigma_azimuth"][0] < min(before, 0.5 * DEG)
    assert abs(wrap_pi(late["azimuth"][0] - truth[-1])) < 3 * late["sigma_azimuth"][0]
    kept = state["x"].copy()
    assert aid_azimuth(PARAMS, state, g_t[-1], b_t[-1], truth[-1] + 30 * DEG, 0.3 * DEG) > 1.0
    assert np.array_equal(state["x"], kept)


def test_slope_of_the_azimuth_agrees_with_finite_differences():
    mat_tn = mat_nt(50 * DEG, 70 * DEG, 2.0).T
    g, b = mat_tn @ np.array([0, 0, 1.0]), mat_tn @ np.array([FIELD[0], 0, FIELD[1]])
    azimuth, horizontal, row = interference_filter._azimuth(state_of(np.zeros(8))[0], g, b)
    assert azimuth == pytest.approx(70 * DEG)
    assert horizontal == pytest.approx(16e-6)
    for k, step in enumerate([1e-9] * 3 + [1e-5] * 3 + [1e-9] * 2):
        change = np.zeros(8)
        change[k] = step
        ends = [interference_filter._azimuth(state_of(sign * change)[0], g, b)[0] for sign in (1.0, -1.0)]
        turned = ends[0] - ends[1]
        assert row[k] * step == pytest.approx(turned / 2, rel=1e-5, abs=1e-12)


def test_priors_hold_the_sensors_own_error_and_turning_shows_the_cross_axial_bias():
    reference = Reference(50e-6, 72 * DEG)
    state = initial(PARAMS, reference, SensorErrors())
    assert axial(state) == (0.0, pytest.approx(math.hypot(900e-9, 70e-9)))
    before = np.sqrt(np.diagonal(state[0].P))[1:3]
    samples, *_ = drilled(7, [30], [60], 60, 20)
    run(PARAMS, state, *samples)
    assert (np.sqrt(np.diagonal(state[0].P))[1:3] < 0.2 * before).all()


def test_a_reference_without_a_field_is_refused():
    with pytest.raises(ValueError, match="no field"):
        initial(PARAMS, Reference(), ERRORS)
