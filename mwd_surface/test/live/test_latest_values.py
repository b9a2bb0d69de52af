# SPDX-License-Identifier: Apache-2.0
"""Single values: no data, live, stale, withheld; streams with rate, age and losses."""

import pytest

from mwd_surface.live.latest_values import Freshness, LatestValues, Quantity


def made():
    return LatestValues({"pressure": Quantity("Pa", "rig")}, {"rig": 1.0, "sonde": 0.5})


def test_a_value_counts_for_two_periods_of_its_stream():
    values = made()
    assert values.value("pressure", 5.0).state == Freshness.NO_DATA
    values.put("pressure", 2.0e7, None, 5.0)
    cell = values.value("pressure", 6.9)
    assert (cell.value, cell.unit, cell.state) == (2.0e7, "Pa", Freshness.LIVE)
    assert cell.age == pytest.approx(1.9)
    assert values.value("pressure", 7.1).state == Freshness.STALE
    assert values.value("pressure", 4.0).age == 0.0


def test_a_withheld_value_keeps_its_number_and_says_why_once():
    values = made()
    values.put("pressure", 1.0, 0.1, 0.0)
    assert values.withhold("pressure", "sensor off")
    assert not values.withhold("pressure", "sensor off")
    cell = values.value("pressure", 0.0)
    assert (cell.value, cell.state, cell.reason) == (1.0, Freshness.STALE, "sensor off")
    values.put("pressure", 2.0, 0.1, 1.0)
    assert values.value("pressure", 1.0).state == Freshness.LIVE


def test_a_value_is_new_only_at_the_very_time_it_came():
    values = made()
    values.put("pressure", 3.0, None, 1.0)
    assert (values.updated("pressure", 1.0), values.updated("pressure", 1.1), values.last("pressure")) == (
        3.0,
        None,
        3.0,
    )


def test_a_stream_nobody_knows_is_named_with_those_there_are():
    with pytest.raises(ValueError, match="'mud' is not one of rig, sonde"):
        made().arrived("mud", 1, 0.0)


def test_the_rate_is_that_of_whole_seconds_and_falls_to_zero_in_silence():
    values = made()
    for k in range(60):
        values.arrived("sonde", 10, 100.0 + k * 0.1)
    row = values.streams(106.0)["sonde"]
    assert (row.rate, row.state) == (pytest.approx(100.0), Freshness.LIVE)
    assert values.streams(120.0)["sonde"].rate == 0.0
    assert values.streams(120.0)["rig"].state == Freshness.NO_DATA
