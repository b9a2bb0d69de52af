# SPDX-License-Identifier: Apache-2.0
"""The state of a well takes the same memory after any time of stream: every history has a budget."""

import dataclasses
import types
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

from mwd_sensors.core import gauge_burst, wire
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.live_well import LiveWell, live_settings
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.settings import LinkSettings, LiveSettings, WellSettings
from mwd_surface.live.survey_book import SurveyBook
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext, WellOutlet
from mwd_surface.surveys.depth import DepthRules
from mwd_surface.surveys.survey_list import SurveyList

S = 10**9
BEGIN = 1_795_800_000 * S
# Short histories are full after minutes; their budgets are these settings.
SMALL = WellSettings(
    live=LiveSettings(history_seconds=60.0, trend_hours=0.1, log_length=10.0),
    depth=DepthRules(history=50),
)
LAYOUTS = {
    "rig/state": wire.RIG_STATE,
    "gravity": wire.GRAVITY,
    "attitude": wire.ATTITUDE,
    "dynamics": wire.DYNAMICS,
    "interference": wire.INTERFERENCE,
    "imu/temperature": wire.TEMPERATURE,
    "imu/mag": wire.MAG,
}
PLAIN = (str, bytes, int, float, complex, type(None), type, types.ModuleType, types.FunctionType, np.dtype, np.generic)


def elements(*roots):
    """Number of elements of all containers that can be reached."""
    seen, left, count = set(), list(roots), 0
    while left:
        one = left.pop()
        if isinstance(one, PLAIN) or id(one) in seen:
            continue
        seen.add(id(one))
        if isinstance(one, dict):
            count += len(one)
            left += [*one, *one.values()]
        elif isinstance(one, (list, tuple, set, frozenset, deque)):
            count += len(one)
            left += one
        elif hasattr(one, "__len__"):
            count += len(one)
        elif isinstance(one, types.MethodType):
            left.append(one.__self__)
        else:
            left += [getattr(one, name) for name in getattr(one, "__slots__", ()) if hasattr(one, name)]
            left.append(getattr(one, "__dict__", {}))
    return count


def well_of(settings):
    clock = WellClock(BEGIN)
    context = WellContext(clock, LiveState(live_settings(settings)), AlarmLog(lambda: clock.now_ns), WellOutlet())
    plan = PlanMonitor(context)
    book = SurveyBook(context, plan, SurveyList(well=settings.well, rules=settings.rules), settings.depth)
    # The messages that are not samples come as the objects that they are decoded to.
    waiting = {}
    well = LiveWell(context, settings, lambda _topic, data: waiting.pop(data), book=book, plan=plan)
    return well, waiting


def samples_at(layout, second):
    samples = layout.empty(1)
    samples["stamp_ns"] = BEGIN + second * S
    depth = 500.0 + second * 4e-2
    values = {"valid": 2047, "bit_depth": depth, "hole_depth": depth, "temperature": 60}
    for name, value in values.items():
        if name in samples.dtype.names:
            samples[name] = value
    return layout.encode(samples, "frame")[0].tobytes()


def time_of(stamp_ns):
    return SimpleNamespace(sec=stamp_ns // S, nanosec=stamp_ns % S)


def link_messages(second):
    """A word, a pass and the state of a link, and strokes of a pump, as their messages are decoded."""
    header, number = SimpleNamespace(stamp=time_of(BEGIN + second * S), frame_id=""), np.zeros(8)
    same = {
        "link": "mud",
        "header": header,
        "start": header.stamp,
        "reason": "",
        "ebn0_db": 9.0,
        "frame": second % 9999,
    }
    word = {"name": "inclination", "value": 0.5, "sigma": 0.1, "unit": "rad", "confidence": 1.0, "status": 1, "kind": 1}
    yield (
        "link/word",
        SimpleNamespace(
            **same, **word, place=second % 7, revision=0, pulses=number, alternatives=number, alternative_odds=number
        ),
    )
    yield "link/frame", SimpleNamespace(**same, kind=1, words=5, believed=5)
    ages = {f"{name}_age": 1.0 for name in ("toolface", "survey", "inclination", "azimuth")}
    figures = dict.fromkeys(("margin_db", "clock_error", "word_error", "goodput"), 0.0)
    yield (
        "link/quality",
        SimpleNamespace(**same, **ages, **figures, state=3, has_signal=True, mode="", words_done=1, words_expected=9),
    )
    yield "rig/strokes", SimpleNamespace(pump=[1], stamp=[header.stamp])


def beat(second):
    values = [SimpleNamespace(key="longest_callback_s", value="5.0" if second % 2 else "0.01")]
    return SimpleNamespace(name=f"/surface{second % 3}", message="active", level=b"\0", values=values, hardware_id="/")


def run(well, waiting, seconds):
    for second in seconds:
        arrived = BEGIN + second * S - S // 3
        for topic, layout in LAYOUTS.items():
            if topic in well.topics:
                well.put(topic, samples_at(layout, second), arrived)
        objects = [("heartbeat", beat(second)), *(link_messages(second) if well.live.parts.over_link else ())]
        for k, (topic, message) in enumerate(objects):
            key = f"{second} {k}".encode()
            waiting[key] = message
            well.put(topic, key, arrived)
        well.put("rig/standpipe", gauge_burst.encode(BEGIN + second * S, 0.01, np.full(100, 2e7)), arrived)
        # Alarms come and go, and what happens is logged, so often that the log of events is full soon.
        for part in "abc":
            well.context.alarm_log.log_event("survey", f"event {second} {part}")
        well.advance(BEGIN + second * S)
        well.state()


@pytest.mark.slow(5)
@pytest.mark.parametrize("source", ["direct", "mud"])
def test_the_state_of_a_well_holds_as_much_after_hours_of_stream_as_after_minutes(source):
    settings = dataclasses.replace(SMALL, link=LinkSettings(source))
    well, waiting = well_of(settings)
    run(well, waiting, range(1, 400))
    early = elements(well)
    assert early > 2000
    run(well, waiting, range(400, 900))
    # The depths are forgotten in blocks of a quarter of their history.
    assert abs(elements(well) - early) <= 3 * settings.depth.history


@pytest.mark.parametrize(
    ("topic", "field"), [("link/word", "status"), ("link/word", "kind"), ("link/quality", "state")]
)
def test_a_message_with_a_number_of_another_version_is_counted_and_those_behind_it_are_taken(topic, field):
    well, waiting = well_of(dataclasses.replace(SMALL, link=LinkSettings("mud")))
    sound, strange = (dict(link_messages(second)) for second in (1, 2))
    setattr(strange[topic], field, 99)
    for key, message in ((b"strange", strange[topic]), (b"sound", sound["link/quality"])):
        waiting[key] = message
        well.put(topic if key == b"strange" else "link/quality", key, BEGIN)
    well.advance(BEGIN + S)
    assert well.decoder.unreadable == 1
    assert not waiting
    assert well.state().link.words_expected == 9
