# SPDX-License-Identifier: Apache-2.0
"""The raw accelerometer: exact at rest, and its sigma grows with what disturbs it."""

import numpy as np
import pytest

from consistency import assert_consistent
from mwd_estimation.core.status import Status
from mwd_estimation.gravity import accelerometer_only as raw
from mwd_sensors.core.constants import STANDARD_GRAVITY

DOWN = np.array([0.6, 0.0, 0.8])
STAMPS = np.arange(1000, dtype=np.int64) * 10_000_000


def test_at_rest_it_is_exact():
    p = raw.Params()
    got = raw.run(p, raw.initial(p), STAMPS, np.zeros((1000, 3)), np.tile(-STANDARD_GRAVITY * DOWN, (1000, 1)))
    assert got.g_t == pytest.approx(np.tile(DOWN, (1000, 1)), abs=1e-15)
    assert (got.status & int(Status.STILL) != 0).all()
    assert got.sigma_inclination[-1] == pytest.approx(p.sigma_floor, rel=1e-3)


def test_sigma_grows_with_the_disturbance():
    rng = np.random.default_rng(1)
    p = raw.Params()
    accel = -STANDARD_GRAVITY * DOWN + rng.standard_normal((1000, 3))
    got = raw.run(p, raw.initial(p), STAMPS, np.zeros((1000, 3)), accel)
    error = got.inclination - np.arctan2(0.8, 0.6)
    assert_consistent(error[300:], got.sigma_inclination[300:])


def test_no_force_at_all_is_rejected():
    p = raw.Params()
    got = raw.run(p, raw.initial(p), [0], np.zeros((1, 3)), np.zeros((1, 3)))
    assert Status(int(got.status[0])) & Status.REJECTED
