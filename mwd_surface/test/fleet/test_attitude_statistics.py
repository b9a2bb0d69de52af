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


def test_a_row_holds_the_statistics_of_its_ten_seconds():
    attitude, gravity = samples(250)
    statistics = AttitudeStatistics()
    statistics.add(attitude, gravity)
    rows = statistics.rows()
    assert [row["start_ns"] for row in rows] == [0, BIN_NS, 2 * BIN_NS]
    assert [row["samples"] for row in rows] == [100, 100, 50]
    first = attitude[:100]
    assert rows[0]["inclination_deg"] == pytest.approx(math.degrees(first["inclination"].mean()))
    assert rows[0]["inclination_lowest_deg"] == pytest.approx(math.degrees(first["inclination"].min()))
    assert rows[0]["inclination_highest_deg"] == pytest.approx(math.degrees(first["inclination"].max()))
    assert rows[0]["sigma_azimuth_deg"] == pytest.approx(math.degrees(0.02))
    assert rows[0]["rotary_speed_rpm"] == pytest.approx(60.0)
    assert rows[0]["non_gravity_mps2"] == pytest.approx(3.0)
    assert (rows[0]["share_still"], rows[0]["share_clipped"], rows[0]["share_gap"]) == (0.5, 0.5, 0.0)


def test_the_mean_azimuth_around_north_is_north():
    attitude, gravity = samples(100)
    statistics = AttitudeStatistics()
    statistics.add(attitude, gravity)
    (row,) = statistics.rows()
    assert abs((row["azimuth_deg"] + 180.0) % 360.0 - 180.0) < 2.0


def test_what_is_unknown_is_none_and_never_zero():
    attitude, gravity = samples(10)
    attitude["sigma_inclination"] = attitude["sigma_azimuth"] = np.nan
    statistics = AttitudeStatistics()
    statistics.add(attitude, gravity)
    (row,) = statistics.rows()
    unknown = {name for name, value in row.items() if value is None}
    assert unknown == {
        "inclination_deg",
        "inclination_lowest_deg",
        "inclination_highest_deg",
        "sigma_inclination_deg",
        "azimuth_deg",
        "sigma_azimuth_deg",
    }


@given(st.lists(st.integers(0, 250), max_size=6).map(sorted))
def test_the_rows_do_not_depend_on_where_blocks_end(cuts):
    attitude, gravity = samples(250)
    whole, pieces = AttitudeStatistics(), AttitudeStatistics()
    whole.add(attitude, gravity)
    for start, stop in zip([0, *cuts], [*cuts, 250], strict=True):
        pieces.add(attitude[start:stop], gravity[start:stop])
    for a, b in zip(whole.rows(), pieces.rows(), strict=True):
        assert a == pytest.approx(b)
