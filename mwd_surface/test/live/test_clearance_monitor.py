# SPDX-License-Identifier: Apache-2.0
"""Offset wells while drilling: alarms by level, cleared again, and compared only when something has changed."""

import concurrent.futures
import dataclasses
from types import SimpleNamespace

import example_surveys as example
import pytest
from example_alarms import active

from mwd_surface.live.alarms import AlarmLog, Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.plan_monitor import ClearanceMonitor
from mwd_surface.live.well_clock import WellClock
from mwd_surface.page.state_json import StateJson

NEAR = "wells: [{name: A-3, file: beside.csv, north_m: -20.0}]"
FAR = NEAR.replace("-20.0", "-2000.0")


class Worker:
    """Does the work at once; counts it."""

    def __init__(self):
        self.jobs = 0

    def run(self, work, done):
        self.jobs += 1
        job = concurrent.futures.Future()
        job.set_result(work())
        done(job)


@pytest.fixture
def folder(tmp_path):
    rows = "\n".join(f"{30 * k},{max(0.0, 4.0 * (k - 11))},79" for k in range(30))
    (tmp_path / "beside.csv").write_text(f"md_m,inc_deg,azi_grid_deg\n{rows}\n")
    return tmp_path


def surveys(folder):
    return example.surveys(dataclasses.replace(example.WELL, offset_wells=str(folder / "wells.yaml")))


def monitor():
    context = SimpleNamespace(clock=WellClock(), live=LiveState(), alarm_log=AlarmLog(lambda: 1), outlet=Worker())
    return ClearanceMonitor(context, SimpleNamespace(plan=None)), context


def compared(folder, wells=NEAR, beside=str):
    """A monitor that has compared, its alarms and its context; `beside` changes the list of the offset well."""
    (folder / "wells.yaml").write_text(wells)
    (folder / "beside.csv").write_text(beside((folder / "beside.csv").read_text()))
    watched, context = monitor()
    watched.update(surveys(folder), 642.5)
    return watched, active(context.alarm_log), context


def test_a_well_too_near_stops_drilling_and_stands_on_the_page(folder):
    _, alarms, context = compared(folder)
    alarm = alarms["clearance.separation"]
    assert alarm.severity == Severity.CRITICAL
    assert "A-3 is " in alarm.text
    assert "stop drilling" in alarm.remedy
    (shown,) = context.live.at(1.0).clearance
    assert shown.name == "A-3"
    assert shown.md[0] >= 630.0


@pytest.mark.slow
def test_the_alarm_goes_with_its_cause(folder):
    watched, _, context = compared(folder)
    (folder / "wells.yaml").write_text(FAR)
    watched.update(surveys(folder), 642.5)
    assert active(context.alarm_log) == {}
    watched.update(example.surveys(), 642.5)
    assert context.live.at(1.0).clearance == ()


@pytest.mark.slow
def test_wells_are_compared_again_when_the_bit_has_moved_or_the_list_changed(folder):
    (folder / "wells.yaml").write_text(NEAR)
    watched, context = monitor()
    same = surveys(folder)
    for depth in (642.5, 642.9, 648.0, 648.5):
        watched.update(same, depth)
    assert context.outlet.jobs == 2
    watched.update(surveys(folder), 648.5)
    assert context.outlet.jobs == 3
    nothing, context = monitor()
    nothing.update(example.surveys(), 642.5)
    assert context.outlet.jobs == 0


def test_a_file_that_cannot_be_used_is_an_alarm(folder):
    watched, alarms, context = compared(folder, NEAR.replace("beside", "lost"))
    alarm = alarms["clearance.wells"]
    assert alarm.severity == Severity.WARNING
    assert "lost.csv" in alarm.text
    (folder / "wells.yaml").unlink()
    watched.update(surveys(folder), 642.5)
    assert "No such file" in active(context.alarm_log)["clearance.wells"].text


def test_an_assumption_is_a_remark_of_the_page_and_no_alarm(folder):
    _, alarms, context = compared(folder, FAR, lambda text: text.replace("azi_grid_deg", "azi_deg"))
    assert alarms == {}
    table = StateJson().snapshot(context.live.at(1.0))["sections"]["clearance"]
    assert any("north of its azimuths" in text for text in table["remarks"])


def test_a_hole_that_was_not_compared_is_an_alarm(folder):
    def deep(text):
        lines = text.splitlines()
        rows = "\n".join(f"{line},{270 + 30 * k},0,0" for k, line in enumerate(lines[11:14]))
        return f"{lines[0]},tvd_m,ns_m,ew_m\n{rows}\n"

    _, alarms, _ = compared(folder, FAR, deep)
    assert "not compared" in alarms["clearance.wells"].text
