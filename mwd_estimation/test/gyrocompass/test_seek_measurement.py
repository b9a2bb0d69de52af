# SPDX-License-Identifier: Apache-2.0
"""The frame of the axis of a tool."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from mwd_estimation.gyrocompass.seek_filter import frame
from mwd_sensors.core.frames import mat_nt


def test_the_frame_of_an_axis_is_its_high_and_right_side() -> None:
    mat = mat_nt(1.0, 0.5, 0.0)
    hx, hy, hz, rx, ry = frame(mat[:, 0].copy())
    assert_allclose([hx, hy, hz], mat[:, 2], atol=1e-12)
    assert_allclose([rx, ry, 0.0], -mat[:, 1], atol=1e-12)
    assert_allclose(frame(np.array([0.0, 0.0, 1.0])), [-1.0, 0.0, 0.0, 0.0, 1.0], atol=0.0)
