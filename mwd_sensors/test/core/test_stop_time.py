# SPDX-License-Identifier: Apache-2.0
"""Time that is left to a process that is to end."""

import pytest

from mwd_sensors.core import stop_time
from mwd_sensors.core.stop_time import StopTime


@pytest.fixture
def schedule(tmp_path, monkeypatch):
    """File that tells how long a thread waited, and a clock that stands still."""
    file = tmp_path / "schedstat"
    file.write_text("0 5000000000 0\n")
    monkeypatch.setattr(stop_time, "Path", lambda _: file)
    monkeypatch.setattr(stop_time.time, "monotonic", lambda: 100.0)
    return file


def test_waiting_for_a_processor_counts_up_to_a_limit(schedule):
    allowed = StopTime(15.0, 60.0)
    assert allowed.left() == 15.0
    schedule.write_text("0 12000000000 0\n")
    assert allowed.left() == 22.0
    schedule.write_text("0 100000000000 0\n")
    assert allowed.left() == 60.0


def test_a_wait_that_can_no_longer_be_read_still_counts(schedule):
    allowed = StopTime(15.0, 60.0)
    schedule.write_text("0 12000000000 0\n")
    allowed.left()
    schedule.unlink()
    assert allowed.left() == 22.0


def test_where_the_system_does_not_tell_nothing_is_added(tmp_path, monkeypatch):
    monkeypatch.setattr(stop_time, "Path", lambda _: tmp_path / "none")
    allowed = StopTime(15.0, 60.0)
    assert 14.0 < allowed.left() <= 15.0
