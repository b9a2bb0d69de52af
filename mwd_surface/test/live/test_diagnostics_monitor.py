# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of the estimator as the surface reads them, and what others may write under its name."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from mwd_sensors.core.wire import OVER
from mwd_surface.live.diagnostics_monitor import DiagnosticsMonitor
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_state import WellState

FIELD = {"total": "5.1e-05", "dip": "1.2", "declination": "0.05", "convergence": "0.0", "gravity": "9.81"}


def monitor(link="direct"):
    """A monitor of a surface that follows a link, and what it shows of fields and progress."""
    fields, progress = [], []

    def show(_now, **parts):
        fields.extend([parts["reference_given"]] if "reference_given" in parts else [])
        progress.extend([parts["survey_progress"]] if "survey_progress" in parts else [])

    live = SimpleNamespace(parts=WellState(over_link=False), show=show)
    context = SimpleNamespace(clock=WellClock(10**18), live=live, alarm_log=None)
    return DiagnosticsMonitor(context, "/w/surface", link), fields, progress


def said(name, node="estimator", level=DiagnosticStatus.OK, **values):
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    status = DiagnosticStatus(name=f"/w/{node}: {name}", hardware_id="/w", level=level, message="said", values=pairs)
    return DiagnosticArray(status=[status])


def test_the_field_and_the_progress_of_a_survey_are_read():
    found, fields, progress = monitor()
    found.on_diagnostics(said("reference field", **FIELD))
    found.on_diagnostics(said("survey", elapsed_s="3.5", remaining_s="26.5"))
    assert (fields[-1].total, fields[-1].gravity) == (5.1e-5, 9.81)
    assert (progress[-1].active, progress[-1].elapsed, progress[-1].remaining) == (True, 3.5, 26.5)


@pytest.mark.fault_case(3)
@pytest.mark.parametrize("foreign", ["", "fifty", "nan", "inf", "5,1e-05", "0x10"])
def test_values_that_are_no_numbers_give_no_field_and_no_times(foreign):
    found, fields, progress = monitor()
    found.on_diagnostics(said("reference field", **FIELD))
    found.on_diagnostics(said("reference field", **{**FIELD, "dip": foreign}))
    assert fields[-1] is None
    found.on_diagnostics(said("survey", elapsed_s=foreign, remaining_s="20"))
    assert (progress[-1].elapsed, progress[-1].remaining) == (0.0, 20.0)


def test_the_end_of_a_simulation_lasts_until_its_node_begins_anew():
    found, _, _ = monitor()
    found._alarm_log = SimpleNamespace(log_event=lambda *_: None)

    def scenario(node, *values):
        found.on_diagnostics(said("scenario", node, **dict(values)))

    scenario("sonde", ("imu/data_raw", "3"))
    assert found.over_at is None
    scenario("sonde", OVER)
    ended = found._clock.now
    found._clock.now_ns += 10**9
    scenario("sonde", OVER)
    assert found.over_at == ended
    scenario("estimator")
    assert found.over_at is not None
    scenario("sonde")
    assert found.over_at is None


@pytest.mark.parametrize(
    ("followed", "alarming"),
    [
        ("direct", {"link", "link em", "link mud_pulse"}),
        ("mud_pulse", {"link em"}),
        ("best", set()),
    ],
)
def test_a_link_raises_one_alarm_here_or_where_the_surface_follows_it(followed, alarming):
    raised = {}
    found, _, _ = monitor(followed)
    found._alarm_log = SimpleNamespace(set_alarms=lambda _prefix, causes: raised.update(causes))
    for name in ("link", "link em", "link mud_pulse", "serial line"):
        found.on_diagnostics(said(name, "receiver", DiagnosticStatus.ERROR))
        found.update(found._clock.now)
    assert set(raised) == {f"node.w/receiver.{name}" for name in {*alarming, "serial line"}}
