# SPDX-License-Identifier: Apache-2.0
"""Each node is killed in a running graph: the others go on, the page says what is missing, and all comes back."""

import contextlib
import json
import os
import signal
import time
import urllib.request
from pathlib import Path

import pytest

import running_graph
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.runs import launch_plan
from mwd_surface.runs.supervise import Order, Supervisor
from running_graph import LOOK, PLACE, until

pytestmark = [pytest.mark.ros, pytest.mark.slow(8)]
WELL = "w1"
# Few samples: the processes are tested here, and most of their time goes by the number of messages.
STORY = """
name: crashes
rate_hz: 25
precision: null
place: {latitude_deg: 38.3, longitude_deg: 109.6}
well: {stations: [[0.0, 30.0, 40.0], [2000.0, 36.0, 47.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}
schedule:
  - {kind: still, seconds: 20.0, pumps: false}
  - {kind: drill, seconds: 10.0, rpm: 120.0, rop_m_h: 2160.0}
cycles: 200
"""
PATIENCE_S = 180.0
STANDSTILL_S = 1.0


class Well:
    """A supervised graph and its page."""

    def __init__(self, folder: Path, environment: dict[str, str], page: int) -> None:
        self.folder, self._page = folder, page
        self.reports: list[str] = []
        self.supervisor = Supervisor(environment, self.reports.append)
        story = folder / "story.yaml"
        story.write_text(STORY)
        parameters = {
            "surface": {"folder": str(folder / "data"), "page.port": page, "record.name": "run"},
            "estimator": PLACE,
            "sonde": {"scenario": str(story), "rate": 3.0, "wait_for_listener_s": 60.0},
        }
        for node, given in parameters.items():
            words = launch_plan.node_words(node, WELL, given)
            self.supervisor.start(Order(node, words, folder / f"{node}.log"))

    def sections(self):
        """Tables of the page; None while it does not answer."""
        self.supervisor.watch()
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self._page}/state.json", timeout=5) as answer:
                return json.load(answer)["sections"] or None
        except (OSError, ValueError):
            return None

    def shows(self, true, what):
        """Wait until the page shows what is true of its tables; return them."""

        def look():
            sections = self.sections()
            return sections if sections is not None and true(sections) else None

        return until(look, PATIENCE_S, what, LOOK)

    @contextlib.contextmanager
    def standing_still(self, *nodes):
        """Halt the processes of nodes for the length of the block."""
        pids = [self.supervisor.pid(node) for node in nodes]
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        try:
            yield
        finally:
            for pid in pids:
                os.kill(pid, signal.SIGCONT)

    def kill(self, node):
        """Kill the process of a node as the system does when memory is short."""
        os.kill(self.supervisor.pid(node), signal.SIGKILL)


def surveys(sections):
    return [row["sequence"] for row in sections["surveys"]["rows"]]


def attitude(sections):
    return sections["attitude"]["inclination"]["state"]


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What the page showed as the nodes were killed one after the other."""
    folder = tmp_path_factory.mktemp("crashes")
    facts = {}
    with running_graph.graph(folder) as graph, launch_plan.page_port(None) as page:
        well = Well(folder, graph.environment, page)
        try:
            first = well.shows(lambda s: surveys(s) and attitude(s) == "live", "a survey")
            well.kill("sonde")
            facts["without sonde"] = well.shows(lambda s: attitude(s) == "stale", "a stale attitude")
            well.shows(lambda s: attitude(s) == "live", "the sonde is back")
            before = well.shows(lambda s: len(surveys(s)) > len(surveys(first)), "a survey of the new sonde")
            well.kill("estimator")
            facts["before estimator"] = before
            facts["without estimator"] = well.shows(lambda s: attitude(s) == "stale", "a stale attitude")
            well.shows(lambda s: attitude(s) == "live", "the estimator is back")
            facts["after estimator"] = well.shows(
                lambda s: len(surveys(s)) > len(surveys(facts["without estimator"])), "a survey of the new estimator"
            )
            # The others stand still for a moment meanwhile, as on a busy machine.
            with well.standing_still("sonde", "estimator"):
                well.kill("surface")
                time.sleep(STANDSTILL_S)
            until(lambda: well.sections() is None, PATIENCE_S, "no page", LOOK)
            facts["after surface"] = well.shows(
                # The recorder is not known before the first state of the well.
                lambda s: attitude(s) == "live" and (s["recorder"] or {}).get("state") == "recording",
                "the surface is back",
            )
            until(
                lambda: "recovered in run" in (folder / "surface.log").read_text(), PATIENCE_S, "a recovered recording"
            )
        finally:
            killed = well.supervisor.stop((("sonde", "estimator"), ("surface",)))
        facts |= {"reports": well.reports, "killed": killed}
        facts["logs"] = {node: (folder / f"{node}.log").read_text() for node in ("surface", "estimator", "sonde")}
        facts["bags"] = folder / "data" / WELL / "bags"
        yield facts


@pytest.mark.fault_case(57)
def test_without_its_sonde_the_page_shows_old_values_as_old_and_the_sonde_comes_back(seen):
    without = seen["without sonde"]
    assert without["attitude"]["inclination"]["value"] is not None
    assert without["attitude"]["inclination"]["age"] >= 1.0
    assert without["recorder"]["state"] == "recording"
    assert "sonde is started again" in seen["reports"]


@pytest.mark.fault_case(58)
def test_without_its_estimator_the_survey_list_stays_and_numbers_go_on(seen):
    before, without = seen["before estimator"]["surveys"], seen["without estimator"]["surveys"]
    assert [row["sequence"] for row in without["rows"]][: len(before["rows"])] == surveys(seen["before estimator"])
    assert without["since"] >= before["since"]
    after = surveys(seen["after estimator"])
    assert len(after) == len(set(after))
    assert max(after) > max(surveys(seen["without estimator"]))


@pytest.mark.fault_case(59)
def test_after_a_kill_the_surface_recovers_its_recording_and_begins_another(seen):
    assert set(surveys(seen["after estimator"])) <= set(surveys(seen["after surface"]))
    folders = sorted(path for path in seen["bags"].iterdir() if path.is_dir())
    assert len(folders) == 2
    for folder in folders:
        with Bag(folder) as bag:
            assert f"/{WELL}/attitude" in bag.topics
            assert not [note for note in bag.notes if "damaged" in note]


@pytest.mark.fault_case(60)
def test_a_graph_that_was_killed_part_by_part_ends_in_order(seen):
    assert seen["killed"] == []
    assert not [node for node, log in seen["logs"].items() if "Traceback" in log]
