# SPDX-License-Identifier: Apache-2.0
"""Dynamics in a driller's numbers, each against motion whose answer is known in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_estimation.attitude import drilling_dynamics as dynamics
from mwd_estimation.attitude.sample import SAMPLE
from mwd_sensors.core import wire
from mwd_sensors.core.constants import STANDARD_GRAVITY

G0 = STANDARD_GRAVITY
DOWN = np.array([0.6, 0.0, 0.8])
START = 1_700_000_000 * 10**9


def window(seconds=10.0, rate_hz=100.0):
    """Samples of a still tool that fill whole periods, and one more that ends the last."""
    n = round(seconds * rate_hz) + 1
    t = np.arange(n) / rate_hz
    stamps = START + np.round(t * 1e9).astype(np.int64)
    return t, stamps, np.zeros((n, 3)), np.tile(-G0 * DOWN, (n, 1)), np.tile(DOWN, (n, 1))


def run(stamps, gyro, accel, g, *, state=None, status=None, **changes):
    params = dynamics.DynamicsParams(**changes)
    state = dynamics.initial() if state is None else state
    samples, attitude = np.zeros(len(stamps), dtype=SAMPLE), wire.ATTITUDE.empty(len(stamps))
    samples["stamp_ns"], samples["gyro"], samples["accel"], samples["down"] = stamps, gyro, accel, g
    attitude["status"] = 0 if status is None else status
    return dynamics.run(params, state, samples, attitude)


@pytest.mark.parametrize(("speed", "depth"), [(12.0, 0.0), (-15.0, 0.3), (-15.0, 1.0), (-15.0, 1.4)])
def test_stick_slip_index_is_half_the_range_over_the_mean(speed, depth):
    t, stamps, gyro, accel, g = window()
    gyro[:, 0] = speed * (1 - depth * np.cos(2 * np.pi * 0.2 * t))
    got = run(stamps, gyro, accel, g)[-1]
    assert got["rotary_speed"] == pytest.approx(speed)
    assert got["stick_slip_index"] == pytest.approx(depth, rel=1e-3, abs=1e-12)
    assert (got["stick_share"] > 0.0) == (depth > 0.9)
    assert (got["axial_rms"], got["lateral_rms"]) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_a_sliding_tool_has_no_stick_slip_index():
    _, stamps, gyro, accel, g = window()
    got = run(stamps, gyro, accel, g)[-1]
    assert np.isnan([got["stick_slip_index"], got["stick_share"]]).all()


def test_vibration_is_split_along_and_across_the_axis():
    t, stamps, gyro, accel, g = window()
    accel[:, 0] += 3.0 * np.sqrt(2.0) * np.sin(2 * np.pi * 7.0 * t)
    accel[:, 1] += 4.0 * np.cos(2 * np.pi * 11.0 * t)
    accel[:, 2] += 4.0 * np.sin(2 * np.pi * 11.0 * t)
    got = run(stamps, gyro, accel, g)[-1]
    assert got["axial_rms"] == pytest.approx(3.0, rel=1e-6)
    assert got["lateral_rms"] == pytest.approx(4.0, rel=1e-6)
    assert got["lateral_peak"] == pytest.approx(4.0, rel=1e-6)
    assert got["axial_peak"] == pytest.approx(3.0 * np.sqrt(2.0), rel=0.01)


def test_shocks_are_counted_once_each_and_the_highest_is_named():
    _, stamps, gyro, accel, g = window(seconds=2.0, rate_hz=500.0)
    # Excursions 10 ms apart or less are one shock: those of samples 100 to 107.
    for at, size in ((100, 300.0), (101, 400.0), (104, 260.0), (107, 260.0), (115, 260.0), (500, 260.0)):
        accel[at, 1] += size
    got = run(stamps, gyro, accel, g)[-1]
    assert got["shocks"] == got["shocks_total"] == 3
    assert got["shock_peak"] == pytest.approx(400.0)


def test_a_summary_comes_every_period_and_forgets_what_is_older_than_the_window():
    _, stamps, gyro, accel, g = window(seconds=14.0)
    accel[150, 0] += 400.0
    got = run(stamps, gyro, accel, g)
    assert (got["stamp_ns"] - START).tolist() == [k * 10**9 for k in range(1, 15)]
    assert got["duration"].tolist() == [*range(1, 10), *[10.0] * 5]
    assert got["shocks"].tolist() == [0, *[1] * 10, 0, 0, 0]
    assert got["shocks_total"].tolist() == [0, *[1] * 13]


def test_samples_that_are_not_finite_or_do_not_advance_are_left_out_and_silence_is_not_filled():
    _, stamps, gyro, accel, g = window(seconds=4.0)
    gyro[3, 0], accel[4, 1], g[5] = np.nan, np.inf, np.nan
    stamps[50:60] = stamps[49]
    later = stamps + 60 * 10**9
    state = dynamics.initial()
    first = run(stamps, gyro, accel, g, state=state)
    second = run(later, gyro, accel, g, state=state)
    assert first["samples"].tolist() == [87, 187, 287, 387]
    # The first ends the window from before the silence; in the others what was before it is too old.
    assert second["samples"].tolist() == [388, 87, 187, 287, 387]
    assert np.isfinite(second["axial_peak"]).all()


def test_the_bits_of_the_last_sample_are_passed_on():
    _, stamps, gyro, accel, g = window(seconds=2.0)
    status = np.arange(len(stamps), dtype=np.uint32)
    assert run(stamps, gyro, accel, g, status=status)["status"].tolist() == [99, 199]


@settings(max_examples=15)
@given(cuts=st.lists(st.integers(0, 600), max_size=8))
def test_any_cut_into_blocks_gives_the_same_bits(cuts):
    rng = np.random.default_rng(3)
    t, stamps, gyro, accel, g = window(seconds=6.0)
    gyro[:, 0] = 10.0 + 9.0 * np.sin(t)
    accel = accel + rng.normal(size=accel.shape) * 90.0
    whole = run(stamps, gyro, accel, g)
    state = dynamics.initial()
    parts = []
    for block in np.split(np.arange(len(stamps)), sorted(cuts)):
        state = state.copy()
        parts.append(run(stamps[block], gyro[block], accel[block], g[block], state=state))
    assert np.concatenate(parts).tobytes() == whole.tobytes()
