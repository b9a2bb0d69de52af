# SPDX-License-Identifier: Apache-2.0
"""Samples that wait: one block, or a bounded time to be smoothed, and then the same numbers as the whole smoothed."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_estimation.gravity import smoother
from mwd_estimation.gravity.bounded.filter import BoundedParams
from mwd_sensors.core import wire
from mwd_surface.processing.bag_estimate import ImuQueue

START = 1_700_000_000 * 10**9


def _imu(n=3000, seed=1):
    rng = np.random.default_rng(seed)
    imu = wire.IMU.empty(n)
    imu["stamp_ns"] = START + np.arange(n) * 10_000_000
    imu["angular_velocity"] = 1e-2 * rng.normal(size=(n, 3))
    imu["linear_acceleration"] = np.array([-9.8, 0.0, 0.0]) + rng.normal(size=(n, 3))
    return imu


def test_without_smoothing_a_block_waits_for_the_next():
    imu = _imu(30)
    queue = ImuQueue()
    assert list(queue.done()) == []
    queue.add(imu[:10], imu["stamp_ns"][:10] + 5)
    assert queue.waiting
    assert queue.first_log_ns == START + 5
    (first,) = queue.done()
    assert first.samples.tobytes() == imu[:10].tobytes()
    assert first.followed is None
    assert not queue.waiting
    queue.add(imu[10:10], imu["stamp_ns"][10:10])
    assert not queue.waiting
    queue.add(imu[10:], imu["stamp_ns"][10:])
    (rest,) = queue.finish()
    assert len(rest.samples) == 20


def _smoothed(imu, cuts):
    """Return the parts that a queue gives for samples that come in parts, and the joined samples and gravity."""
    queue, out = ImuQueue(BoundedParams()), []
    for part in np.split(imu, cuts):
        out += queue.done()
        queue.add(part, part["stamp_ns"] + 7)
    assert queue.waiting
    out += queue.finish()
    return out, np.concatenate([one.samples for one in out]), np.concatenate([one.followed.g_t for one in out])


def test_smoothed_samples_come_out_in_order_with_the_gravity_of_the_whole(monkeypatch):
    monkeypatch.setattr(smoother, "BLOCK", 800)
    monkeypatch.setattr(smoother, "AHEAD", 300)
    imu = _imu()
    whole = smoother.smooth(BoundedParams(), imu["stamp_ns"], imu["angular_velocity"], imu["linear_acceleration"])
    out, samples, down = _smoothed(imu, [100, 150, 1700, 1701, 2500])
    assert samples.tobytes() == imu.tobytes()
    assert np.concatenate([one.log_ns for one in out]).tolist() == (imu["stamp_ns"] + 7).tolist()
    assert down.tobytes() == whole.g_t.tobytes()
    assert all(len(one.samples) == len(one.followed.g_t) for one in out)


@given(cuts=st.lists(st.integers(0, 700), max_size=8).map(sorted), silence_s=st.sampled_from([0, 30, 59, 61, 600]))
@settings(deadline=None, max_examples=20)
def test_where_a_recording_is_cut_into_blocks_and_how_long_they_are_changes_no_bit(cuts, silence_s):
    imu = _imu(700)
    imu["stamp_ns"][400:] += silence_s * 10**9
    _, samples, down = _smoothed(imu, cuts)
    _, whole, expected = _smoothed(imu, [])
    assert samples.tobytes() == whole.tobytes() == imu.tobytes()
    assert down.tobytes() == expected.tobytes()


def test_a_long_silence_begins_the_smoothing_anew():
    imu = _imu(700)
    imu["stamp_ns"][400:] += 61 * 10**9
    down, first, second = (_smoothed(part, [])[2] for part in (imu, imu[:400], imu[400:]))
    assert down.tobytes() == first.tobytes() + second.tobytes()
