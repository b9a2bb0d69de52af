# SPDX-License-Identifier: Apache-2.0
"""Log channels while drilling: whatever comes as a sample, the surface goes on, and refused samples raise an alarm."""

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace

import pytest
from example_alarms import active

from mwd_sensors.core import wire
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.log_monitor import LogMonitor
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.survey_book import SurveyBook
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext, WellOutlet
from mwd_surface.logs.depth_log import DepthLog
from mwd_surface.logs.log_journal import LogJournal
from mwd_surface.logs.tool_health import HealthLedger
from mwd_surface.surveys.depth import DepthRules
from mwd_surface.surveys.survey_list import SurveyList

S = 10**9
T0 = 10**18


def message(at_s=50.0, **more):
    sample = LogSample(T0 + round(at_s * S), "gamma", "gAPI", 10.0, 10.0, 80.0, 5.0, sensor_to_bit=10.0)
    return dataclasses.replace(sample, **more).to_message(lambda _, fields: SimpleNamespace(**fields))


def monitored(*source, journal=None):
    """A monitor of a well with a bit that stands at 1000 m; its alarms, its live state and its book."""
    alarms, live, book = AlarmLog(lambda: 1), LiveState(), SimpleNamespace(logs=DepthLog(), health=HealthLedger())
    book.journal = journal
    for at in range(101):
        book.logs.add_depth(T0 + at * S, 1000.0)
    return LogMonitor(SimpleNamespace(live=live, alarm_log=alarms), book, *source), alarms, live, book


@pytest.mark.parametrize("offset", [math.inf, -math.inf, -1e9, 1e9])
def test_a_sensor_that_cannot_be_there_raises_an_alarm_that_ends_and_the_log_goes_on(offset):
    monitor, alarms, live, _ = monitored()
    monitor.on_sample(message(sensor_to_bit=offset))
    monitor.update(1.0)
    (text,) = (alarm.text for alarm in active(alarms).values())
    assert "sensor" in text
    monitor.on_sample(message())
    monitor.update(2.0)
    assert [len(curve.depth) for curve in live.at(2.0).logs] == [1]
    assert active(alarms)
    monitor.update(100.0)
    assert not active(alarms)


@pytest.mark.parametrize(
    ("source", "link", "used"),
    [
        ("em", "mud_pulse", False),
        ("mud_pulse", "mud_pulse", True),
        ("best", "em", True),
        ("em", "", True),
        ("direct", "em", True),
        ("serial", "em", False),
    ],
)
def test_a_surface_of_one_link_uses_no_sample_of_another(source, link, used):
    monitor, _, _, book = monitored(source)
    monitor.on_sample(message(link=link))
    monitor.update(1.0)
    assert (book.logs.channels == ("gamma",)) is used
    assert (book.health.health().stamp_ns > 0) is used


def test_a_full_disk_raises_one_alarm_while_the_rig_data_go_on_and_ends_with_its_cause(tmp_path):
    journal = LogJournal(tmp_path / "surveys" / "journal")
    monitor, alarms, _, book = monitored(journal=journal)
    rig = wire.RIG_STATE.empty(1)
    rig["valid"] = wire.RIG_VALID["flow_rate"]
    # A disk that refuses each line, and a folder that is gone.
    journal.close()
    journal._file = Path("/dev/full").open("wb")  # noqa: SIM115
    (tmp_path / "surveys").rename(tmp_path / "away")
    for second in range(40):
        rig["stamp_ns"] = T0 + second * S
        monitor.on_rig_state(rig, 100.0)
        monitor.on_sample(message(second))
        monitor.update(float(second))
        assert [alarm.id for alarm in active(alarms).values()] == ["log.journal"]
    assert book.health.health().stamp_ns > T0
    (tmp_path / "away").rename(tmp_path / "surveys")
    for second in range(40, 80):
        rig["stamp_ns"] = T0 + second * S
        monitor.on_rig_state(rig, 100.0)
        monitor.update(float(second))
    assert not active(alarms)
    journal.close()
    assert len((tmp_path / "surveys" / "journal").read_bytes().splitlines()) >= 25


def test_a_depth_set_by_hand_places_the_samples_of_its_time():
    clock = WellClock(T0)
    context = WellContext(clock, LiveState(), AlarmLog(lambda: clock.now_ns), WellOutlet())
    book = SurveyBook(context, PlanMonitor(context), SurveyList(), DepthRules())
    for at in (45, 55):
        book.set_depth_by_hand(T0 + at * S, 500.0)
    book.logs.add([LogSample(T0 + 50 * S, "gamma", "gAPI", 10.0, 10.0, 80.0, 5.0, sensor_to_bit=10.0)])
    (curve,) = book.logs.curves()
    assert curve.depth.tolist() == pytest.approx([490.05])
