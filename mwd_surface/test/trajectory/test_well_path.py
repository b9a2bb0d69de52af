# SPDX-License-Identifier: Apache-2.0
"""The well path and its projection to the bit: straight, or on the arc of the last interval, and marked."""

import math

import numpy as np
import pytest

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.trajectory.well_path import path_of, projected

MD = np.array([0.0, 100.0, 130.0, 160.0, 190.0])
INC, AZI = np.radians([0.0, 0.0, 3.0, 6.0, 10.0]), np.radians([0.0, 0.0, 30.0, 35.0, 40.0])


def made():
    kind = ("tie-on", *("survey",) * 4)
    return path_of("main", North.GRID, 0.5, (MD, INC, AZI), mc.path(MD, INC, AZI), kind, (0, 1, 2, 3, 4))


def test_a_straight_projection_keeps_the_last_direction_and_is_marked():
    path = projected(made(), 210.0, "straight")
    assert path.kind[-1] == "projected"
    assert path.sequence[-1] == 0
    np.testing.assert_allclose(path.positions[-1] - path.positions[-2], 20.0 * mc.tangent(INC[-1], AZI[-1]))
    assert path.dogleg_severity[-1] == pytest.approx(0.0, abs=1e-12)


def test_a_curved_projection_goes_on_along_the_arc_of_the_last_interval():
    path = projected(made(), 220.0, "curve")
    assert path.dogleg_severity[-1] == pytest.approx(path.dogleg_severity[-2])
    three = mc.path(path.md[[-3, -1]], path.inclination[[-3, -1]], path.azimuth[[-3, -1]], path.positions[-3])
    np.testing.assert_allclose(path.positions[-1], three[-1], atol=1e-9)


def test_a_bit_that_is_not_deeper_changes_nothing_and_one_that_is_nowhere_is_refused():
    path = made()
    assert projected(path, 150.0, "straight") is path
    with pytest.raises(ValueError, match="bit_depth: must be finite"):
        projected(path, math.nan, "straight")


def test_any_depth_of_the_path_has_a_place_on_its_arcs():
    path = made()
    inc, _, position = path.at(145.0)
    assert INC[2] < inc < INC[3]
    np.testing.assert_allclose(path.at(160.0)[2], path.positions[3], atol=1e-9)
    assert np.linalg.norm(position - path.positions[2]) == pytest.approx(15.0, abs=0.01)
    with pytest.raises(ValueError, match="outside the stations"):
        path.at(191.0)
