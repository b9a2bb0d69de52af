# SPDX-License-Identifier: Apache-2.0
"""Real nodes in a real control loop, and how soon a controller notices that the MWD is hung or dead."""

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import running_graph
from mwd_surface.rig.status import FILE_NAME, read_status
from running_graph import PLACE, samples_of, until

HERE = Path(__file__).parent
WANTED_DEG = 60.0
RATE = 3.0  # s of the run in a second
UNSTEERED = 12.0  # s of the run before the controller comes
HELD = 20.0  # s of the run
NOTICED = 3.0  # s
pytestmark = [pytest.mark.ros, pytest.mark.slow(6)]


class Controller:
    """The controller node as a process; `lines`: time and words of what it has printed."""

    def __init__(self, graph):
        words = [sys.executable, str(HERE / "toolface_hold_node.py"), "--ros-args", "-r", "__ns:=/w1"]
        words += ["-p", f"wanted_deg:={WANTED_DEG}"]
        self.path = graph.folder / "controller.log"
        with self.path.open("wb") as log:
            graph.running["controller"] = subprocess.Popen(
                words, env=graph.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT
            )

    @property
    def lines(self):
        rows = [line.partition(" ") for line in self.path.read_text().splitlines() if line[:1].isdigit()]
        return [(float(at), words) for at, _, words in rows]

    @property
    def readings(self):
        """Stamp and degrees off of what it received, one a second of the run."""
        rows = [words.split() for _, words in self.lines if words.startswith("at ")]
        return np.array([(float(row[1]), float(row[3])) for row in rows]).reshape(-1, 2)

    def held(self):
        """Stamps between which it has, for the first time, found the toolface where it should be for long enough."""
        stamps, off = self.readings.T
        for out in [-1, *np.flatnonzero(np.abs(off) > 5.0)]:
            if stamps[out + 1 :].size and stamps[-1] - stamps[out + 1] > HELD:
                ends = np.flatnonzero(stamps > stamps[out + 1] + HELD)[0]
                if np.abs(off[out + 1 : ends]).max() <= 5.0:
                    return stamps[out + 1], stamps[ends]
        return None

    def notices(self, words, since):
        """Seconds from a moment to the first such line after it."""
        found = until(lambda: [at for at, reported in self.lines if reported == words and at > since], 15, words)
        return found[0] - since


@pytest.fixture(scope="module")
def steered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("steered")
    with running_graph.graph(folder) as graph:
        settings = {"folder": folder / "data", "page__port": 0, "record__name": "run"}
        settings |= {"rig__wits0_server__enabled": True, "rig__wits0_server__port": 0}
        settings |= {"control__enabled": True, "control__grant": "automatic", "control__heartbeat_s": 5.0}
        settings["control__left_turn_deg"] = 30.0
        surface = graph.start("surface", "w1", **settings)
        estimator = graph.start("estimator", "w1", **{k.replace(".", "__"): v for k, v in PLACE.items()})
        for name in (surface, estimator):
            until(lambda name=name: ": active" in graph.log(name), 90, f"{name} is active")
        scenario = HERE / "scenarios" / "steered.yaml"
        sonde = graph.start("sonde", "w1", scenario=scenario, rate=RATE, wait_for_listener_s=60.0)
        until(lambda: "scenario steered" in graph.log(sonde), 60, "the scenario begins")
        time.sleep(UNSTEERED / RATE)
        controller, facts = Controller(graph), {}
        until(lambda: [words for _, words in controller.lines if words == "steers"], 60, "the controller steers")
        facts["held"] = until(controller.held, 150, "the toolface is held")

        status_file = folder / "data" / "w1" / FILE_NAME
        facts["rig"], facts["asked"] = read_status(status_file), time.time()
        hung = graph.running[estimator]
        os.kill(hung.pid, signal.SIGSTOP)
        stopped = time.monotonic()
        facts["hung"] = controller.notices("deadline missed", stopped)
        # Only once the controller has let go, or there would be nothing for it to take up again.
        until(lambda: [at for at, words in controller.lines if words[:7] == "refuses" and at > stopped], 15, "lets go")
        os.kill(hung.pid, signal.SIGCONT)
        until(lambda: [at for at, words in controller.lines if words == "steers" and at > stopped], 15, "steers again")
        graph.end(surface)
        facts["rig gone"] = not status_file.exists()
        facts["bag"] = folder / "data" / "w1" / "bags" / "run"

        settings["record__name"], ended = "again", time.monotonic()
        surface = graph.start("surface", "w1", **settings)
        until(lambda: [at for at, words in controller.lines if words == "steers" and at > ended], 60, "a new surface")
        graph.running[surface].kill()
        killed = time.monotonic()
        facts["dead"] = controller.notices("liveliness lost", killed)
        time.sleep(0.5)
        facts["words after"] = [words for at, words in controller.lines if at > killed]
        graph.end(estimator)
        graph.end(sonde)
        facts["reported"] = controller.path.read_text() + graph.log(sonde)
        yield facts


def test_the_toolface_is_held_within_10_degrees_of_the_wanted_one(steered):
    truth = samples_of(steered["bag"], "/w1/truth")
    stamps = truth["stamp_ns"] * 1e-9
    error = np.degrees((truth["gravity_toolface"] - math.radians(WANTED_DEG) + math.pi) % math.tau - math.pi)
    unsteered = stamps < stamps[0] + UNSTEERED / 2.0
    assert np.abs(np.diff(error[unsteered][::100])).max() > 30.0
    begins, ends = steered["held"]
    held = np.abs(error[(stamps > begins) & (stamps < ends)])
    assert len(held) > 1300
    assert held.max() < 10.0


def test_set_points_answers_and_the_owner_are_in_the_recording(steered):
    from mwd_surface.bags.bag_reader import Bag

    with Bag(steered["bag"]) as bag:
        for topic in ("control/command", "control/state", "rig/command", "rig/acknowledge"):
            assert bag.topics[f"/w1/{topic}"].count > 20, topic


def test_the_controller_has_control_while_it_steers(steered):
    assert "has control" in steered["reported"]


def test_a_hung_estimator_is_noticed_by_its_missed_deadline(steered):
    assert steered["hung"] < NOTICED


def test_a_killed_surface_is_noticed_by_its_lost_liveliness(steered):
    assert steered["dead"] < NOTICED
    assert "refuses: no toolface yet" in steered["words after"]
    assert "steers" not in steered["words after"]


def test_the_state_of_the_rig_interfaces_lies_in_the_folder_while_the_graph_lives(steered):
    assert steered["rig"].alive(steered["asked"])
    (wits,) = steered["rig"].interfaces
    assert (wits.name, wits.state) == ("wits0_server", "listening")
    assert steered["rig gone"]


def test_nobody_complained(steered):
    assert "Traceback" not in steered["reported"]
    assert "not obeyed" not in steered["reported"]
