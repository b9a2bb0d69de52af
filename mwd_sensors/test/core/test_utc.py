# SPDX-License-Identifier: Apache-2.0
"""Times of files are UTC, whatever the machine's zone, over a leap second and a change of its clock."""

import datetime as dt
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core.utc import moment, stamp_ns

NEW_YEAR = 1_483_228_800 * 10**9  # 2017-01-01


@pytest.fixture(params=["UTC", "America/New_York", "Asia/Kolkata"])
def zone(request, monkeypatch):
    monkeypatch.setenv("TZ", request.param)
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("zone")
@pytest.mark.fault_case(92)
@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("2016-12-31T23:59:59Z", -1.0),
        ("2016-12-31T23:59:60Z", 0.0),
        ("2016-12-31T23:59:60.25+00:00", 0.25),
        ("2017-01-01T01:00:00+01:00", 0.0),
        ("2017-01-01 00:00:00", 0.0),
        ("2017-01-01", 0.0),
        # Written within the hour that New York skips and the one that it has twice.
        ("2017-03-12T02:30:00", 70 * 86400.0 + 9000.0),
        ("2017-11-05T01:30:00", 308 * 86400.0 + 5400.0),
    ],
)
def test_a_time_is_utc_in_every_zone(text, seconds):
    assert stamp_ns(moment(text)) == NEW_YEAR + round(seconds * 1e9)


@pytest.mark.parametrize("text", ["", "noon", "2017-13-01", "9999-12-31T23:59:60Z", "0001-01-01T00:00:00+14:00"])
def test_what_is_no_time_is_a_value_error(text):
    with pytest.raises(ValueError, match=r"."):
        moment(text)


@given(st.datetimes(timezones=st.just(dt.UTC)))
def test_a_time_that_is_written_and_read_is_the_same(at):
    assert moment(at.isoformat()) == at
    assert dt.datetime(1970, 1, 1, tzinfo=dt.UTC) + dt.timedelta(microseconds=stamp_ns(at) // 1000) == at
