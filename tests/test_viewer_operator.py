# SPDX-License-Identifier: Apache-2.0
"""The page over a recording shows what people did while it was made: depths by hand, decisions, several legs."""

import concurrent.futures
import dataclasses
import logging
import math
import random
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="the messages of the surface are made with ROS")

import example_surveys as example
from mwd_msgs import msg
from rclpy.serialization import serialize_message

from mwd_sensors.core import wire
from mwd_sensors.ros.messages import make
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.exports.export import FORMATS
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.live_well import LiveWell, live_settings
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.nodes.survey_list_server import SurveyListServer
from mwd_surface.nodes.well_outlet import NodeOutlet
from mwd_surface.page.state_json import StateJson
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.ros.topics import type_name
from mwd_surface.runs.player import Player
from mwd_surface.surveys.leg_settings import LegSettings
from page_states import differences

S = 10**9
BEGIN = example.START
WELL = "/w1/"
SETTINGS = SurfaceSettings(
    well=example.WELL,
    leg=LegSettings(tie_on_depth=950.0, tie_on_inclination_deg=30.0, tie_on_north=0.0, tie_on_east=200.0),
)
SECONDS = 240


class Worker:
    """Runs a job at once."""

    def submit(self, job, callback, **_):
        done = concurrent.futures.Future()
        done.set_result(job())
        callback(done)


class Surface:
    """A surface that records what it hears and says, as its node does."""

    def __init__(self, folder, bag):
        self._bag, self._channels = bag, {}
        node = SimpleNamespace(
            add_publisher=self._publisher,
            add_service=lambda *_: None,
            frame=lambda name: name,
            get_logger=lambda: logging.getLogger("surface"),
            get_parameter=lambda _name: SimpleNamespace(value=False),
            count_publishers=lambda _topic: 0,
        )
        worker, clock = Worker(), WellClock(BEGIN)
        outlet = NodeOutlet(node, worker, folder / "slides.jsonl")
        log = outlet.alarm_log = AlarmLog(lambda: clock.now_ns)
        node.get_clock = lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=clock.now_ns))
        context = WellContext(clock, LiveState(live_settings(SETTINGS)), log, outlet)
        plan = PlanMonitor(context)
        shared = SurfaceContext(node, folder, context, worker, requests=None)
        self.surveys = outlet.surveys = SurveyListServer(shared, SETTINGS, plan=plan)
        self.well = LiveWell(
            context, SETTINGS, lambda _topic, message: message, book=self.surveys, plan=plan, full_name=f"{WELL}surface"
        )
        self.surveys.slide_sheet = self.well.slides.stretches
        self.surveys.on_depth_by_hand = self.well.on_depth_by_hand
        outlet.open()
        self.surveys.open()
        self.well.diagnostics.show_well(SETTINGS.well)
        self.surveys.show()

    def _publisher(self, kind, topic, _qos):
        def publish(message):
            self._write(topic, type_name(kind), serialize_message(message), self.well.next_arrival_ns)

        return SimpleNamespace(publish=publish)

    def _write(self, topic, kind, data, at_ns):
        if topic not in self._channels:
            self._channels[topic] = self._bag.topic(WELL + topic, kind)
        self._bag.write(self._channels[topic], data, at_ns)

    def hear(self, topic, kind, data, at_ns, message=None):
        self._write(topic, kind, data, at_ns)
        self.well.put(topic, data if message is None else message, at_ns)


def rig_data(second, step):
    samples = wire.RIG_STATE.empty(1)
    samples["stamp_ns"] = BEGIN + second * S + step * S // 5
    samples["valid"] = 2047
    samples["bit_depth"] = samples["hole_depth"] = 1000.0 + 0.5 * (second + step / 5)
    samples["rotary_speed"] = 10.0 * (second // 40 % 2)
    return wire.RIG_STATE.encode(samples, "rig_floor")[0].tobytes()


def attitude(second, step):
    samples = wire.ATTITUDE.empty(1)
    samples["stamp_ns"] = BEGIN + second * S + step * S // 5
    samples["inclination"], samples["azimuth"], samples["gravity_toolface"] = 0.5, 1.2, 0.01 * second
    for name in ("inclination", "azimuth", "gravity_toolface"):
        samples[f"sigma_{name}"] = 0.01
    samples["north"] = 3
    return wire.ATTITUDE.encode(samples, "sonde_link")[0].tobytes()


def judged(surface, action, number):
    """Accept or reject a survey as a person does."""
    usual = {"operator_name": "Ann", "reason": "seen", "measured_depth": math.nan, "replace": False}
    answer = SimpleNamespace(success=None, message="")
    getattr(surface.surveys, action)(SimpleNamespace(sequence=number, value=0, **usual), answer)
    assert answer.success, answer.message


def with_leg(surface, **leg):
    settings = dataclasses.replace(SETTINGS, leg=dataclasses.replace(SETTINGS.leg, **leg))
    surface.surveys.change_settings(settings.well, settings.rules, settings.leg, None)


def with_depth(surface, bit_depth):
    answer = SimpleNamespace(success=None, message="")
    assert surface.surveys.set_depth(SimpleNamespace(operator_name="Ann", bit_depth=bit_depth), answer).success


# By second of the run: what a person does a moment later, between two cells of the page.
DONE = {
    45: lambda surface: with_depth(surface, 1030.0),
    46: lambda surface: with_depth(surface, 1032.5),
    75: lambda surface: judged(surface, "reject", 1),
    100: lambda surface: with_leg(surface, name="ST1", kick_off_depth=1010.0),
    130: lambda surface: judged(surface, "accept", 1),
    160: lambda surface: with_leg(surface, name="ST2", kick_off_depth=990.0, parent="main"),
    200: lambda surface: surface.surveys._alarm_log.acknowledge("", "Ann"),
    215: lambda surface: with_leg(surface, name="main"),
}


@pytest.mark.slow(9)
def test_a_recording_shows_depths_by_hand_decisions_and_legs_as_the_page_did(tmp_path, monkeypatch):
    # The surface writes the report anew at each change of the list. No part of a report is compared here, and drawing
    # it takes longer than all the rest.
    monkeypatch.setitem(FORMATS, "html", FORMATS["csv"])
    rng = random.Random(5)
    moments = sorted(BEGIN + rng.randrange(2 * S, SECONDS * S) for _ in range(4))
    # And just before and after what a person did.
    moments = sorted([*moments, *(BEGIN + second * S + ms * 1_000_000 for second in DONE for ms in (320, 410))])
    states, left = {}, list(moments)
    with BagWriter(tmp_path / "bag") as bag:
        surface = Surface(tmp_path, bag)
        page = StateJson(SETTINGS.live)

        clock, shown = surface.well.clock, [surface.well.state()]

        def until(now_ns):
            for end_ns in [*(one for one in left if one <= now_ns), now_ns]:
                before_ns = clock.now_ns
                surface.well.advance(end_ns)
                # As the page of the node: a new state with each cell.
                if clock.now_ns > before_ns:
                    shown[0] = surface.well.state()
                if end_ns in left:
                    left.remove(end_ns)
                    states[end_ns] = page.snapshot(shown[0])

        for second in range(SECONDS):
            for step in range(5):
                at_ns = BEGIN + second * S + step * S // 5 + 30_000_000
                surface.hear("rig/state", "mwd_msgs/msg/RigState", rig_data(second, step), at_ns)
                surface.hear("attitude", "mwd_msgs/msg/Attitude", attitude(second, step), at_ns)
                if step == 2 and second % 25 == 20:
                    number = second // 25 + 1
                    found = example.survey(number, 30.0 + number, 40.0, stamp_ns=BEGIN + (second - 10) * S)
                    message = found.to_message(make)
                    kind = type_name(msg.Survey)
                    surface.hear("survey", kind, serialize_message(message), at_ns + 1, message)
                if step == 1 and second in DONE:
                    until(BEGIN + second * S + 340_000_000)
                    DONE[second](surface)
                until(BEGIN + second * S + (step + 1) * S // 5)
        surveys, drilled = surface.surveys.surveys, sum(one.length for one in surface.well.slides.stretches())
    # The hole grows by half a metre a second; a corrected depth drills nothing.
    assert 0.3 * SECONDS < drilled <= 0.5 * SECONDS
    assert [leg.name for leg in surveys.legs] == ["main", "ST1", "ST2"]
    assert {record.leg for record in surveys.records} == {"main", "ST1", "ST2"}
    with Bag(tmp_path / "bag") as bag:
        player = Player(bag, WELL, SETTINGS)
        for moment in rng.sample(moments, len(moments)):
            player.seek((moment - bag.start_ns) * 1e-9)
            viewed = StateJson(SETTINGS.live).snapshot(player.state())
            found = differences(states[moment]["sections"], viewed["sections"])
            assert not found, f"{(moment - BEGIN) * 1e-9:.3f} s: " + "\n".join(found[:20])
        player.seek(player.length_s)
        assert player.well.book.surveys.legs == surveys.legs
        # A recording that began, or was split, after a sidetrack has the sidetrack in its settings.
        leg = dataclasses.replace(SETTINGS.leg, name="ST1", kick_off_depth=1010.0)
        player = Player(bag, WELL, dataclasses.replace(SETTINGS, leg=leg))
        player.seek(player.length_s)
        assert player.well.book.surveys.legs == surveys.legs
