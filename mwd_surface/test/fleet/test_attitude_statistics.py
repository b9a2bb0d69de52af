# SPDX-License-Identifier: Apache-2.0
"""Ten-second statistics of attitude: right, and the same however the samples come."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_surface.fleet.attitude_statistics import BIN_NS, AttitudeStatistics


def samples(n, seed=0):
    rng = np.random.default_rng(seed)
    attitude, gravity = wire.ATTITUDE.empty(n), wire.GRAVITY.empty(n)
    attitude["stamp_ns"] = gravity["stamp_ns"] = np.arange(n) * 100_000_000
    attitude["inclination"] = rng.uniform(0.2, 0.4, n)
    attitude["azimuth"] = rng.normal(0.0, 0.05, n) % math.tau
    attitude["sigma_inclination"] = 0.01
    attitude["sigma_azimuth"] = np.where(np.arange(n) % 3 == 0, np.nan, 0.02)
    attitude["status"] = np.where(np.arange(n) % 2 == 0, int(Status.STILL), int(Status.ROTATING | Status.CLIPPED))
    gravity["rotary_speed"] = math.tau
    gravity["non_gravity"] = 3.0
    return attitude, gravity


def rows_of(attitude, gravity):
    statistics = AttitudeStatistics()
    statistics.add(attitude, gravity)
    return statistics.rows()


def test_a_row_holds_the_statistics_of_its_ten_seconds():
    attitude, gravity = samples(250)
    rows = rows_of(attitude, gravity)
    assert [row["start_ns"] for row in rows] == [0, BIN_NS, 2 * BIN_NS]
    assert [row["samples"] for row in rows] == [100, 100, 50]
    inclination, row = np.degrees(attitude["inclination"][:100]), rows[0]
    assert row["inclination_deg"] == pytest.approx(inclination.mean())
    assert row["inclination_lowest_deg"] == pytest.approx(inclination.min())
    assert row["inclination_highest_deg"] == pytest.approx(inclination.max())
    # Azimuths on both sides of north have the mean north.
    assert abs((row["azimuth_deg"] + 180.0) % 360.0 - 180.0) < 2.0
    assert row["sigma_azimuth_deg"] == pytest.approx(math.degrees(0.02))
    assert row["rotary_speed_rpm"] == pytest.approx(60.0)
    assert row["non_gravity_mps2"] == pytest.approx(3.0)
    assert (row["share_still"], row["share_clipped"], row["share_gap"]) == (0.5, 0.5, 0.0)


def test_what_is_unknown_is_none_and_never_zero():
    attitude, gravity = samples(10)
    attitude["sigma_inclination"] = attitude["sigma_azimuth"] = np.nan
    (row,) = rows_of(attitude, gravity)
    angles = {name for name in row if name.endswith("_deg")}
    assert {name for name, value in row.items() if value is None} == angles


@given(st.lists(st.integers(0, 250), max_size=6).map(sorted))
def test_the_rows_do_not_depend_on_where_blocks_end(cuts):
    attitude, gravity = samples(250)
    pieces = AttitudeStatistics()
    for some in zip(np.split(attitude, cuts), np.split(gravity, cuts), strict=True):
        pieces.add(*some)
    for a, b in zip(rows_of(attitude, gravity), pieces.rows(), strict=True):
        assert a == pytest.approx(b)
