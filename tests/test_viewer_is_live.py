# SPDX-License-Identifier: Apache-2.0
"""The page over a recording is the page of the run: every kind of input, at moments sought in any order."""

import dataclasses
import json
import random

import pytest

pytest.importorskip("rclpy", reason="the messages of a receiver are made with ROS")

from rclpy.serialization import deserialize_message

from link_recording import receiver_messages
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings as settings_tables
from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.live_well import CELL_NS, LiveWell, live_settings
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.settings import LinkSettings
from mwd_surface.live.survey_book import SurveyBook
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext, WellOutlet
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.page.state_json import StateJson
from mwd_surface.processing import process
from mwd_surface.processing.run_output import MERGED, OutputSettings
from mwd_surface.ros.topics import TOPICS
from mwd_surface.runs import simulate
from mwd_surface.runs.launch_plan import reference_parameters, surface_parameters
from mwd_surface.runs.player import Player, namespace_of
from mwd_surface.surveys.leg_settings import arranged
from mwd_surface.surveys.recorded_settings import SURFACE
from mwd_surface.surveys.survey_list import SurveyList
from page_states import differences, exact
from project import ROOT

# In the gate one of each kind of link (EM beside pulses, in two links) and detector, and a tool that drills and fails;
# a tool without faults is seen through real nodes by `test_viewer_graph.py`. The other scenarios differ from these in
# motion, hole, ground, noise and steel.
SCENARIOS = (
    *("faults", "coil_link", "gamma_landing", "telemetry_downlink"),
    *("telemetry_serial", "telemetry_siren", "telemetry_two_links"),
)
OTHERS = (
    *("default", "demo", "near_polar", "s3_rotation", "sliding", "tumble", "vertical"),
    *("telemetry_em_clay", "telemetry_shallow"),
)
WELL = "/w1/"
DIRECT_S, LINK_S = 45.0, 110.0  # of each run: at rest, drilling, and over a link a survey's words
MOMENTS = 5


def short(story, seconds):
    """A scenario that ends after a given number of seconds."""
    phases, left = [], seconds
    for phase in story.schedule:
        phases.append(dataclasses.replace(phase, seconds=min(phase.seconds, left)))
        left -= phases[-1].seconds
        if left <= 0.0:
            break
    return dataclasses.replace(story, schedule=tuple(phases), cycles=1)


@pytest.fixture(
    scope="module", params=[*SCENARIOS, *(pytest.param(name, marks=pytest.mark.nightly) for name in OTHERS)]
)
def recorded(request, tmp_path_factory):
    """Path of a recording of a scenario with what the page needs, and how the surface was set."""
    folder = tmp_path_factory.mktemp(request.param)
    story = read(ROOT / f"bags/scenarios/{request.param}.yaml")
    over_link = story.telemetry is not None
    story = short(story, LINK_S if over_link else DIRECT_S)
    simulate.record(story, folder / "raw", WELL)
    surface = settings_tables.changed(SurfaceSettings(), {**surface_parameters(story), "well.name": "w1"})
    with Bag(folder / "raw") as bag:
        if not over_link:
            process.process(bag, folder / "out", EstimatorSettings(), wanted=OutputSettings(format="mcap"))
            return folder / "out" / MERGED, surface
        place = settings_tables.changed(EstimatorSettings(), reference_parameters(story)).place
        heard = receiver_messages(bag, WELL, story.telemetry.tools, place)
        kept = ("rig/state", "rig/standpipe", "rig/strokes")
        messages = [(at, topic, kind, data) for at, topic, kind, data in bag.messages() if topic[len(WELL) :] in kept]
    surface = dataclasses.replace(surface, link=LinkSettings("best"))
    parameters = {name: str(value) for name, (value, _) in settings_tables.flat(surface).items()}
    with BagWriter(folder / "link") as bag:
        channels = {}
        for at, topic, kind, data in sorted([*messages, *heard], key=lambda one: one[0]):
            channel = channels.setdefault(topic, None)
            if channel is None:
                channel = channels[topic] = bag.topic(topic, kind)
            bag.write(channel, data, at)
        bag.add_metadata(SURFACE, parameters)
    return folder / "link", surface


def content(state):
    """The parts of a state, exact; without the counts of changes, which are those of a session."""
    return {name: value for name, value in exact(state) if name != "changes"}


def live_states(bag, surface, moments):
    """Return the states of a surface, and of its page, that receives a recording in uneven pieces as if live."""
    clock = WellClock(bag.start_ns - 1)
    outlet = WellOutlet()
    outlet.is_simulated = lambda: f"{WELL}truth" in bag.topics
    context = WellContext(clock, LiveState(live_settings(surface)), AlarmLog(lambda: clock.now_ns), outlet)
    plan = PlanMonitor(context)
    begun = arranged(SurveyList(well=surface.well, rules=surface.rules), surface.leg)
    book = SurveyBook(context, plan, begun, surface.depth)

    def decoded(topic, data):
        return deserialize_message(data, TOPICS[topic][0])

    well = LiveWell(context, surface, decoded, book=book, plan=plan, full_name=f"{WELL}surface")
    well.diagnostics.show_well(surface.well)
    plan.show_plan()
    book.show()
    page, states, rng = StateJson(surface.live), {}, random.Random(7)
    waiting = [(at, name.removeprefix(WELL), data) for at, name, _, data in bag.messages()][::-1]
    now_ns, moments = bag.start_ns, list(moments)
    while moments:
        now_ns = min(now_ns + rng.randrange(5_000_000, 130_000_000), moments[0])
        arrived = []
        while waiting and waiting[-1][0] <= now_ns:
            arrived.append(waiting.pop())
        # Streams are taken together, after the events that came meanwhile.
        for at, topic, data in sorted(arrived, key=lambda one: one[1]):
            if topic in well.topics:
                well.put(topic, data, at)
        well.advance(now_ns)
        if now_ns == moments[0]:
            state = well.state()
            states[moments.pop(0)] = content(state), page.snapshot(state)
    return states


@pytest.mark.slow(3)
def test_the_viewer_shows_what_the_live_page_showed(recorded):
    path, surface = recorded
    with Bag(path) as bag:
        assert namespace_of(bag) == WELL
        rng = random.Random(3)
        spans = sorted(rng.uniform(1.0, bag.duration_s) for _ in range(MOMENTS))
        moments = [bag.start_ns + round(at * 1e9) for at in spans]
        states = live_states(bag, surface, moments)
        player = Player(bag, WELL, None if SURFACE in bag.metadata() else surface)
        order = [*moments]
        rng.shuffle(order)
        for moment in order:
            player.seek((moment - bag.start_ns) * 1e-9)
            viewed = StateJson(surface.live).snapshot(player.state())
            state, live = states[moment]
            assert content(player.state()) == state
            assert viewed["now"] == live["now"]
            found = differences(live["sections"], viewed["sections"])
            assert not found, f"{(moment - bag.start_ns) * 1e-9:.2f} s: " + "\n".join(found[:20])
            # Nothing changes while it is paused.
            again = StateJson(surface.live).snapshot(player.state())
            assert json.dumps(again) == json.dumps(viewed)
        assert player.well.clock.now_ns % CELL_NS == 0
