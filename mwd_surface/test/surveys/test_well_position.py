# SPDX-License-Identifier: Apache-2.0
"""How well a surveyed well is known ahead of its stations: at the bit and along the plan."""

import example_surveys as example
import numpy as np
import pytest

from mwd_surface.surveys.well_position import AHEAD, continued, uncertain
from mwd_surface.trajectory.plan import plan_of

MD = np.arange(0.0, 1501.0, 30.0)
PLAN = plan_of(MD, np.clip(np.radians((MD - 300.0) / 7.5), 0.0, np.radians(60.0)), np.full(MD.size, np.radians(78.0)))


def test_the_plan_ahead_has_its_ellipses():
    whole = example.surveys()
    path = continued(whole.definitive(bit_depth=642.5), PLAN, 300.0)
    known = uncertain(whole, path)
    ahead = np.array(path.kind) == AHEAD
    assert 9 <= ahead.sum() <= 10
    assert path.md[-1] <= 642.5 + 300.0
    volume = np.linalg.det(known.covariance[:, :2, :2])
    assert np.all(np.diff(volume[path.md.size - ahead.sum() - 1 :]) > 0.0)


def test_the_path_ahead_runs_beside_the_plan_as_far_as_the_well_does_now():
    bit = example.surveys().definitive(bit_depth=642.5)
    path = continued(bit, PLAN, 200.0)
    shift = path.positions[-1] - bit.positions[-1]
    n = bit.md.size
    assert np.linalg.norm(shift) == pytest.approx(path.md[-1] - path.md[n - 1], rel=0.02)
    assert path.inclination[-1] > bit.inclination[-1]


def test_without_plan_or_beyond_its_end_the_path_ends_at_the_bit():
    bit = example.surveys().definitive(bit_depth=642.5)
    assert continued(bit, None, 200.0) is bit
    short = plan_of(MD[:5], np.zeros(5), np.zeros(5))
    assert continued(bit, short, 200.0) is bit
    with pytest.raises(ValueError, match="reach"):
        continued(bit, PLAN, -1.0)
