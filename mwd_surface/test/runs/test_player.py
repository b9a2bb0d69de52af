# SPDX-License-Identifier: Apache-2.0
"""A recording as the page shows it: the state of each moment, whatever the way to it."""

import contextlib
import json
import math
import signal
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.settings import changed, values
from mwd_sensors.simulator.scenario import parse, read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.cli import app
from mwd_surface.live.settings import PlanSettings, WellSettings
from mwd_surface.page.state_json import StateJson
from mwd_surface.processing import process
from mwd_surface.processing.run_output import OutputSettings
from mwd_surface.runs import simulate
from mwd_surface.runs.player import Player, namespace_of, recorded_surface
from mwd_surface.surveys.recorded_settings import SURFACE
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import plan_of
from running_graph import until

pytestmark = pytest.mark.slow

SCENARIO = """
name: viewed
seed: 3
date: 2026-03-01T06:00:00
well: {stations: [[0.0, 30.0, 40.0], [600.0, 60.0, 40.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}
schedule: [{kind: drill, seconds: 30.0, rpm: 120.0, rop_m_h: 7200.0}]
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording without estimates, and the same with them."""
    folder = tmp_path_factory.mktemp("viewed")
    (folder / "scenario.yaml").write_text(SCENARIO)
    simulate.record(read(folder / "scenario.yaml"), folder / "bag", "w1")
    with Bag(folder / "bag") as bag:
        assert namespace_of(bag) == ""
        process.process(bag, folder / "out", EstimatorSettings(), wanted=OutputSettings(format="mcap"))
    return folder / "bag", folder / "out" / "merged"


def shown(player):
    """Inclination and depth of the bit as the page has them."""
    sections = StateJson().snapshot(player.state())["sections"]
    return sections["attitude"]["inclination"], sections["rig"]["bit_depth"]


def test_a_moment_is_the_same_played_to_or_sought(recorded):
    with Bag(recorded[1]) as bag:
        assert namespace_of(bag) == "/w1/"
        played, sought = (Player(bag, "/w1/") for _ in range(2))
        for _ in range(130):
            played.advance(0.17)
        sought.seek(played.at_s)
        assert played.at_s == pytest.approx(22.1)
        assert [one["value"] for one in shown(played)] == [one["value"] for one in shown(sought)]
        inclination, depth = shown(played)
        assert depth["value"] == deepest(recorded[1], 22.1)
        assert inclination["state"] == "live"
        played.seek(5.0)
        assert shown(played)[1]["value"] == deepest(recorded[1], 5.0)
        played.advance(1000.0)
        assert played.at_s == played.length_s


def deepest(path, at_s):
    """Depth of the bit that was logged last before a moment."""
    with Bag(path) as bag:
        end_ns = bag.start_ns + round(at_s * 1e9) + 1
        parts = [block["/w1/rig/state"][1] for block in bag.blocks(["/w1/rig/state"], end_ns=end_ns)]
    return float(parts[-1]["bit_depth"][-1])


def test_the_path_goes_to_the_bit_and_is_compared_with_the_plan(recorded):
    settings = WellSettings(well=Well(sensor_to_bit=3.0, section_azimuth_deg=40.0))
    with Bag(recorded[1]) as bag:
        player = Player(bag, "/w1/", settings, plan_of([0.0, 600.0], [0.0, 0.0], [0.0, 0.0], name="straight"))
        for at in (20.0, 5.0):
            player.seek(at)
            sections = StateJson().snapshot(player.state())["sections"]
            assert sections["well"]["sensor_to_bit"] == 3.0
            assert sections["plan"]["name"] == "straight"
            assert sections["path"]["measured_depth"][-1] == pytest.approx(deepest(recorded[1], at))
            assert sections["offset"]["up"] is not None
            assert sections["streams"]["sonde"]["state"] == "live"


def test_a_recording_without_settings_says_that_the_well_is_assumed_and_what_is_not_evaluated(recorded, tmp_path):
    with Bag(recorded[1]) as bag, BagWriter(tmp_path / "bare") as bare:
        channels = {}
        for at, topic, kind, data in bag.messages():
            if topic not in channels:
                channels[topic] = bare.topic(topic, kind)
            bare.write(channels[topic], data, at)
    with Bag(tmp_path / "bare") as bag:
        player = Player(bag, "/w1/")
        player.seek(20.0)
        sections = StateJson().snapshot(player.state())["sections"]
    assert sections["well"]["given"] is False
    missing = sections["alarms"]["not_evaluated"]
    assert {"sensors and nodes", "heartbeats", "recording and disk"} <= set(missing)
    assert "rig data and depth" not in missing
    assert "attitude and surveys" not in missing
    assert sections["control"]["since"] is None


def test_a_way_to_a_moment_that_takes_long_stops_and_goes_on(recorded):
    with Bag(recorded[1]) as bag:
        player = Player(bag, "/w1/")
        assert not player.seek(29.0, patience_s=0.0)
        assert player.at_s < 29.0
        player.seek(29.0)
        assert player.at_s == 29.0
        assert player.seek(3.0)
        assert player.clipped(1e9) == player.length_s


def test_a_recording_of_a_single_message_is_played(recorded, tmp_path):
    with Bag(recorded[0]) as bag, BagWriter(tmp_path / "one") as writer:
        log_ns, topic, _, data = next(bag.messages(["/w1/rig/state"]))
        writer.write(writer.topic(topic, bag.topics[topic].type_name), data, log_ns)
    with Bag(tmp_path / "one") as bag:
        player = Player(bag, "/w1/")
        assert player.length_s == 0.0
        assert not player.seek(0.0)
        assert shown(player)[1] is not None


def ask(address, given):
    body = json.dumps(given).encode()
    request = urllib.request.Request(f"{address}replay", body, {"Content-Type": "application/json"}, method="POST")  # noqa: S310
    try:
        with urllib.request.urlopen(request, timeout=30.0) as answer:  # noqa: S310
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def state(address):
    with urllib.request.urlopen(f"{address}state.json", timeout=30.0) as answer:  # noqa: S310
        return json.load(answer)


def shown_at(address, at):
    """The state of the page where it shows that moment, else None."""
    shown = state(address)
    return shown if shown["server"].get("replay", {}).get("at") == at else None


@contextlib.contextmanager
def viewed(folder, *words):
    """The address of the page over a recording."""
    command = [sys.executable, "-P", "-m", "mwd_surface.cli", "view", *words, "--paused", "--start", "3"]
    with (folder / "log").open("w") as log:
        viewer = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        until(lambda: "page at" in (folder / "log").read_text(), 300, "the page")
        yield (folder / "log").read_text().partition("page at ")[2].partition(";")[0]
    finally:
        viewer.send_signal(signal.SIGINT)
        assert viewer.wait(60) == 0


def test_results_of_a_recording_are_viewed_as_they_were_made(tmp_path, monkeypatch):
    def play(player, _asked, _server):
        # To the end: a survey is shown from when it was given, not from its own time on.
        player.seek(1e6)
        seen.append(StateJson().snapshot(player.state())["sections"])

    monkeypatch.setattr("mwd_surface.commands.view._play", play)
    story = "{name: s, well: {stations: [[0.0, 30.0, 40.0]]}, schedule: [{kind: still, seconds: 14.0}]}"
    simulate.record(parse(story), tmp_path / "bag")
    seen = []
    for form in ("csv", "mcap"):
        results = str(tmp_path / form)
        app(["process", str(tmp_path / "bag"), "-o", results, "-f", form], standalone_mode=False)
        app(["view", results, "--paused"], standalone_mode=False)
    assert len(seen) == 2
    for sections in seen:
        assert sections["attitude"]["inclination"]["value"] == pytest.approx(math.radians(30.0), abs=0.01)
        (survey,) = sections["surveys"]["rows"]
        assert survey["verdict"] == "accepted"


def test_the_page_of_a_recording_is_played_paused_and_wound(recorded, tmp_path):
    with viewed(tmp_path, str(recorded[0])) as address:
        before = until(lambda: state(address) if "replay" in state(address)["server"] else None, 20, "the recording")
        replay = before["server"]["replay"]
        assert (replay["at"], replay["playing"], replay["rate"]) == (3.0, False, 1.0)
        assert replay["length"] == pytest.approx(30.0, abs=0.2)
        assert ask(address, {"seek": 20.0}) == 200
        after = until(lambda: shown_at(address, 20.0), 20, "the moment")
        assert after["now"] - before["now"] == pytest.approx(17.0)
        assert after["sections"]["rig"]["bit_depth"]["value"] == deepest(recorded[1], 20.0)
        assert ask(address, {"playing": True, "rate": 5}) == 200
        until(lambda: state(address)["server"]["replay"]["at"] > 25.0, 20, "it plays")
        assert ask(address, {"rate": 1e9}) == 400
        assert ask(address, {"sek": 1}) == 400


@given(
    st.one_of(st.none(), st.floats(0.0, 360.0)),
    st.one_of(st.none(), st.floats(-180.0, 180.0)),
    st.floats(1.0, 5000.0),
    st.sampled_from(["", "plan.csv"]),
    st.sampled_from(["inclination", "dip_up", "dip_down"]),
)
def test_the_plan_and_the_convention_of_a_recording_are_those_of_its_settings(azimuth, angle, length, file, word):
    plan = PlanSettings(file=file, opening_azimuth_deg=azimuth, opening_angle_deg=angle, length_m=length)
    settings = changed(WellSettings(plan=plan), {"well.convention": word})
    table = {name: str(value) for name, value in values(settings).items()}
    with tempfile.TemporaryDirectory() as folder:
        with BagWriter(Path(folder) / "bag") as bag:
            bag.add_metadata(SURFACE, table)
            bag.write(bag.topic("/text", "std_msgs/msg/String"), b"\0\1\0\0\1\0\0\0\0", 1, 1)
        with Bag(Path(folder) / "bag") as bag:
            assert recorded_surface(bag).plan == settings.plan
            assert (
                recorded_surface(bag).well.angles.points
                == {"inclination": "", "dip_up": "up", "dip_down": "down"}[word]
            )
