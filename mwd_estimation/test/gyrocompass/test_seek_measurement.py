# SPDX-License-Identifier: Apache-2.0
"""What a tool in its hole cannot do: the frame of its axis, and the axis that lies elsewhere."""

from __future__ import annotations

import math

import numpy as np
from north_signals import motion, still
from numpy.testing import assert_allclose

from mwd_estimation.gyrocompass import north_seek
from mwd_estimation.gyrocompass.seek_measurement import frame
from mwd_estimation.gyrocompass.seek_params import SeekParams
from mwd_sensors.core.frames import mat_nt


def test_the_frame_of_an_axis_is_its_high_and_right_side() -> None:
    mat = mat_nt(1.0, 0.5, 0.0)
    hx, hy, hz, rx, ry = frame(mat[:, 0].copy())
    assert_allclose([hx, hy, hz], mat[:, 2], atol=1e-12)
    assert_allclose([rx, ry, 0.0], -mat[:, 1], atol=1e-12)
    assert_allclose(frame(np.array([0.0, 0.0, 1.0])), [-1.0, 0.0, 0.0, 0.0, 1.0], atol=0.0)


def test_an_axis_that_turns_is_a_move_and_one_at_rest_is_none() -> None:
    def moves(azimuth) -> int:
        clean = motion(30.0, math.radians(34.0), 1.0, azimuth, still, 50.0)
        state = north_seek.initial()
        north_seek.run(SeekParams(), state, clean.stamp_ns, clean.gyro_t, clean.accel_t)
        return int(state.moved)

    assert moves(0.5) == 0
    assert moves(lambda t: 0.5 + 0.1 * np.clip((t - 15.0) / 2.0, 0.0, 1.0)) > 0
