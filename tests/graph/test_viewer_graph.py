# SPDX-License-Identifier: Apache-2.0
"""The page of `mwd run` and, over its recording, that of the viewer: the same, with what an operator did."""

import json
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from mwd_surface.bags.bag_reader import Bag
from mwd_surface.live.said import SAID
from mwd_surface.page.state_json import StateJson
from mwd_surface.runs.player import Player, namespace_of, recorded_surface
from mwd_surface.trajectory.plan import read_plan
from page_states import differences
from project import SCENARIOS
from running_graph import until

pytestmark = [pytest.mark.ros, pytest.mark.slow(18)]

TOKEN = "look-twice-first"  # noqa: S105
# The ellipses are computed in the background, on a busy machine for seconds.
EXCEPT = ("path.ellipses",)
# Pace of each scenario, and its samples in a second: most of the time of the nodes goes by the number of messages. In
# the gate, what a page shows over a link is compared without nodes, by `test_viewer_is_live.py`.
RUNS = {"demo": (2, 50), "telemetry_deep": (10, 25)}
STATES, EVERY_S = 20, 0.5


def get(address, name):
    with urllib.request.urlopen(f"{address}{name}", timeout=20.0) as answer:  # noqa: S310
        return json.load(answer)


def operate(address, name, **given):
    request = urllib.request.Request(  # noqa: S310
        f"{address}command/{name}",
        json.dumps(given).encode(),
        {"Content-Type": "application/json", "Authorization": f"Bearer {TOKEN}"},
        method="POST",
    )
    try:
        with urllib.request.urlopen(request, timeout=30.0) as answer:  # noqa: S310
            return json.load(answer)
    except urllib.error.HTTPError as refused:
        return json.load(refused)


@pytest.fixture(scope="module", params=["demo", pytest.param("telemetry_deep", marks=pytest.mark.nightly)])
def run(request, tmp_path_factory):
    """States of the page of a run, and its recording."""
    folder = tmp_path_factory.mktemp(request.param)
    (rate, rate_hz), story = RUNS[request.param], folder / f"{request.param}.yaml"
    story.write_text((SCENARIOS / story.name).read_text() + f"rate_hz: {rate_hz}\n")
    words = [str(story), "--rate", str(rate), "--no-rig", "--token", TOKEN, "-o", str(folder / "out")]
    command = [sys.executable, "-P", "-m", "mwd_surface.cli", "run", *words]
    states = []
    with (folder / "log").open("w") as log:
        graph = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        until(lambda: "page at" in (folder / "log").read_text(), 300, "the page")
        address = re.search(r"page at (\S+)", (folder / "log").read_text())[1]
        until(lambda: get(address, "state.json")["sections"]["rig"]["bit_depth"]["value"], 120, "rig data")
        depth = get(address, "state.json")["sections"]["rig"]["bit_depth"]["value"]
        answer = operate(address, "set_depth", bit_depth=depth + 8.0, operator_name="Ann")
        assert answer["ok"], answer
        while len(states) < STATES:
            states.append(get(address, "state.json"))
            for alarm in states[-1]["sections"]["alarms"]["rows"][:1]:
                operate(address, "acknowledge_alarm", id=alarm["id"], operator_name="Ann")
            time.sleep(EVERY_S)
    finally:
        graph.send_signal(signal.SIGINT)
        ended = graph.wait(120)
    assert (ended, "Traceback" in (folder / "log").read_text()) == (0, False)
    (bag,) = (folder / "out/well_1/bags").glob("well_1_*")
    return bag, states


def test_the_viewer_shows_what_the_page_showed(run):
    path, states = run
    compared = 0
    with Bag(path) as bag:
        assert bag.complete
        named = recorded_surface(bag).plan
        plan = read_plan(Path(named.file), given=named.given()) if named.file else None
        player = Player(bag, namespace_of(bag), plan=plan)
        page = StateJson(player.well.live.settings)
        for state in states:
            at_s = state["state_at"] - player.well.clock.seconds(bag.start_ns)
            if not 2.0 <= at_s <= player.length_s:
                continue
            player.seek(at_s)
            viewed = page.snapshot(player.state())
            compared += 1
            found = differences(state["sections"], viewed["sections"], except_for=EXCEPT)
            assert not found, f"{at_s:.2f} s: " + "\n".join(found[:20])
        assert compared >= 15
        events = [row["text"] for row in viewed["sections"]["events"]["rows"]]
        assert any(text.endswith("by Ann") and text.startswith("bit depth") for text in events)


# Alarms of the machine that recorded, which are in a recording only as the surface said them.
OF_THE_MACHINE = ("recorder.", "recording.", "surveys.", "slides.", "page.", "control.", "downlink.", "disk.", "queue.")


def standing(state, at_least_s):
    """Alarms that have stood for so long, s, by their id: severity, and text without its figures."""
    return {
        a.id: (a.severity, re.sub(r"[\d.]+", "#", a.text))
        for a in state.alarms.rows
        if a.active and not a.id.startswith(OF_THE_MACHINE) and a.last_ns - a.raised_ns >= at_least_s * 1e9
    }


def test_what_the_viewer_evaluates_is_what_the_surface_said(run):
    path, _ = run
    with Bag(path) as bag:
        said = Player(bag, namespace_of(bag))
        evaluated = Player(bag, namespace_of(bag), said=SAID - {"alarms", "events", "surveys", "trajectory"})
        for share in (0.3, 0.5, 0.7, 0.9):
            for player in (said, evaluated):
                player.seek(share * player.length_s)
            first, second = (player.state() for player in (said, evaluated))
            listed = [
                [(r.survey.uuid, r.in_use, r.measured_depth) for r in state.surveys.records]
                for state in (first, second)
            ]
            assert listed[0] == listed[1]
            # One that has just come may have come a second sooner or later.
            assert standing(first, 3.0).items() <= standing(second, 0.0).items()
            assert standing(second, 3.0).items() <= standing(first, 0.0).items()
        assert evaluated.well.not_evaluated() == ("recording and disk",)
        assert first.alarms.not_evaluated == ()
