# SPDX-License-Identifier: Apache-2.0
"""Samples that wait: one block, or a bounded time to be smoothed, and then the same numbers as the whole smoothed."""

import numpy as np

from mwd_estimation.gravity import smoother
from mwd_estimation.gravity.bounded.filter import Params
from mwd_sensors.core import wire
from mwd_surface.processing.imu_queue import ImuQueue

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
    assert list(queue.done(START)) == []
    queue.add(imu[:10], imu["stamp_ns"][:10] + 5)
    assert queue.waiting
    assert queue.first_log_ns == START + 5
    (first,) = queue.done(START)
    assert first.samples.tobytes() == imu[:10].tobytes()
    assert first.followed is None
    assert not queue.waiting
    queue.add(imu[10:10], imu["stamp_ns"][10:10])
    assert not queue.waiting
    queue.add(imu[10:], imu["stamp_ns"][10:])
    (rest,) = queue.finish()
    assert len(rest.samples) == 20


def test_smoothed_samples_come_out_in_order_with_the_gravity_of_the_whole(monkeypatch):
    monkeypatch.setattr(smoother, "BLOCK", 800)
    imu = _imu()
    whole = smoother.smooth(Params(), imu["stamp_ns"], imu["angular_velocity"], imu["linear_acceleration"])
    queue, out = ImuQueue(Params()), []
    for part in np.split(imu, [100, 150, 1700, 1701, 2500]):
        out += queue.done(int(part["stamp_ns"][0]))
        queue.add(part, part["stamp_ns"] + 7)
    assert queue.waiting
    out += queue.finish()
    assert np.concatenate([one.samples for one in out]).tobytes() == imu.tobytes()
    assert np.concatenate([one.log_ns for one in out]).tolist() == (imu["stamp_ns"] + 7).tolist()
    assert np.concatenate([one.followed.g_t for one in out]).tobytes() == whole.g_t.tobytes()
    assert all(len(one.samples) == len(one.followed.g_t) for one in out)


def test_an_imu_that_falls_silent_is_not_waited_for():
    imu = _imu(100)
    queue = ImuQueue(Params())
    queue.add(imu, imu["stamp_ns"])
    assert list(queue.done(int(imu["stamp_ns"][-1]) + 10**9)) == []
    (rest,) = queue.done(int(imu["stamp_ns"][-1]) + 61 * 10**9)
    assert len(rest.samples) == 100
    assert not queue.waiting
