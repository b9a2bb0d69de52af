# SPDX-License-Identifier: Apache-2.0
"""The table of supervision: each row raises its alarm after its time, keeps it, and clears it."""

import pytest

from mwd_surface.live.supervision import TABLE, Supervision


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.alarm)
def test_a_row_is_raised_when_its_limit_is_passed_for_its_time_and_cleared_after_the_same_time(row):
    supervision = Supervision()
    beyond, within = {row.alarm: 1.5 * row.limit}, {row.alarm: 0.5 * row.limit}
    assert supervision.judge(within, 0.0) == {}
    if row.persistence_s:
        assert supervision.judge(beyond, 1.0) == {}
        assert supervision.judge(beyond, 0.9 + row.persistence_s) == {}
    standing = supervision.judge(beyond, 1.0 + row.persistence_s)
    severity, text, remedy = standing[row.alarm]
    assert severity == row.severity
    assert remedy
    assert "{" not in text
    assert supervision.judge({row.alarm: 2.0 * row.limit}, 50.0) == standing
    if row.persistence_s:
        assert supervision.judge(within, 60.0) == standing
    assert supervision.judge(within, 60.0 + row.persistence_s) == {}


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.alarm)
def test_a_short_excess_and_a_reading_that_is_not_there_raise_nothing(row):
    supervision = Supervision()
    if row.persistence_s:
        supervision.judge({row.alarm: 2.0 * row.limit}, 0.0)
    assert supervision.judge({row.alarm: row.limit}, 0.5 * row.persistence_s) == {}
    assert supervision.judge({}, 1000.0) == {}


def test_every_row_says_what_follows_and_has_an_alarm_of_its_own():
    assert len({row.alarm for row in TABLE}) == len(TABLE)
    assert all(row.action and row.degraded and row.remedy for row in TABLE)
