# SPDX-License-Identifier: Apache-2.0
"""The field corrects a roll that the x gyro missed, and does not change a roll that was not lost."""

import numpy as np
import pytest
from turned_tool import START, noisy_rates, toolface_error, turned

from consistency import consistency
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_estimation.gravity.bounded.field_roll import MagneticSamples
from mwd_sensors.core.frames import mat_nt

LAG_NS = 20_000_000
FIELD = 1e-6 * np.array([20.0, 3.0, 45.0])  # T, north-east-down
RANGE = 34.9


def sticking(t):
    """Rates up to 39 rad/s, 4 rad/s beyond the range of the gyro."""
    return 20.0 - 19.0 * np.cos(2.0 * np.pi * 0.25 * t)


def steady(t):
    return np.full(len(t), 9.0)


def drilled(speed, seed, inclination=1.0, seconds=40.0):
    """Stamps, rates, forces, fields and true toolface of a tool that shakes and turns as `speed(t)`, rad/s, says."""
    stamps, angle = turned(speed, seconds)
    n, rng = len(stamps), np.random.default_rng(seed)
    gyro = noisy_rates(angle, rng)
    gyro[:, 0] = np.clip(1.001 * gyro[:, 0], -RANGE, RANGE)
    mat = mat_nt(inclination, np.zeros(n), angle)
    accel = np.einsum("kji,j->ki", mat, [0.0, 0.0, -9.81]) + 4.0 * np.diff(rng.normal(size=(n + 1, 3)), axis=0)
    field = np.einsum("kji,j->ki", mat, FIELD) + 5e-8 * rng.normal(size=(n, 3)) + [0.0, 6e-8, -5e-8]
    return stamps, gyro, accel, field, angle


def followed(data, size=10**9, params=None):
    """Track of the samples, pushed in blocks; each magnetic sample arrives with the sample of its stamp."""
    stamps, gyro, accel, field, _ = data
    params = params or bounded.BoundedParams(gyro_range=RANGE)
    state, used, parts = bounded.initial(params), 0, []
    for start in range(0, len(stamps), size):
        part = slice(start, start + size)
        waiting = slice(used, min(start + size, len(stamps)))
        mag = MagneticSamples(
            stamps[waiting], np.ascontiguousarray(field[waiting]), LAG_NS, stamps[:0], stamps[waiting]
        )
        parts.append(bounded.run(params, state, stamps[part], gyro[part], accel[part], None, mag))
        used += state.field_used
    return type(parts[0])._make(np.concatenate(column) for column in zip(*parts, strict=True))


def test_the_field_carries_the_roll_while_the_x_gyro_clips():
    rows = []
    for seed, inclination in ((1, 1.0), (2, 0.5), (3, 1.5)):
        data = drilled(sticking, seed, inclination)
        track = followed(data)
        late = slice(1000, None)
        rows.append((toolface_error(track, data[4])[late], track.sigma_toolface[late]))
    errors = np.concatenate([error for error, _ in rows])
    assert np.degrees(np.sqrt(np.mean(errors**2))) < 1.5
    assert np.degrees(np.abs(errors).max()) < 10.0
    assert consistency(rows, correlated=True).nees < 2.2


@pytest.mark.parametrize("lost_s", [0.3, 0.7, 1.6])
@pytest.mark.parametrize("clock_was_set", [False, True])
def test_a_missing_time_and_a_clock_that_was_set_give_the_same_roll(lost_s, clock_was_set):
    """Stamps do not show whether time is missing or the clock was set, so the field must give the roll."""
    stamps, gyro, accel, field, angle = drilled(steady, 4)
    behind, lost = stamps >= START + 20_000_000_000, round(lost_s * 1e9)
    if clock_was_set:
        stamps = stamps + lost * behind
    else:
        kept = ~(behind & (stamps < START + 20_000_000_000 + lost))
        stamps, gyro, accel, field, angle = (column[kept] for column in (stamps, gyro, accel, field, angle))
    track = followed((stamps, gyro, accel, field, angle))
    settled = stamps > START + 20_000_000_000 + lost + 60_000_000
    late = toolface_error(track, angle)[settled]
    assert np.degrees(np.abs(late).max()) < 5.0
    assert (np.abs(late) < 4.0 * track.sigma_toolface[settled]).all()


def test_samples_rejected_by_a_clock_that_was_set_back_do_not_leave_a_wrong_roll():
    stamps, gyro, accel, field, angle = drilled(steady, 5)
    stamps = stamps - 300_000_000 * (stamps >= START + 20_000_000_000)
    track = followed((stamps, gyro, accel, field, angle))
    after = slice(2000 + 30 + 8, None)
    error = np.abs(toolface_error(track, angle))[after]
    assert np.degrees(error.max()) < 5.0
    assert (error < 4.0 * track.sigma_toolface[after]).all()


def test_a_field_that_turns_beside_steel_does_not_touch_a_roll_that_was_not_lost():
    stamps, gyro, accel, field, angle = drilled(steady, 6)
    plain = followed((stamps, gyro, accel, field, angle))
    turned = field.copy()
    turned[2000:] = field[2000:] @ mat_nt(0.0, 0.0, 0.5).T
    assert followed((stamps, gyro, accel, turned, angle)).g_t.tobytes() == plain.g_t.tobytes()


@pytest.mark.parametrize("size", [1, 7, 500])
def test_blocks_of_any_length_give_the_same_bits(size):
    data = drilled(sticking, 7, seconds=12.0)
    whole, cut = followed(data), followed(data, size)
    assert cut.g_t.tobytes() == whole.g_t.tobytes()
    assert cut.sigma_toolface.tobytes() == whole.sigma_toolface.tobytes()
