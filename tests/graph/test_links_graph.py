# SPDX-License-Identifier: Apache-2.0
"""Links among real nodes: pulses and EM at once to one list of surveys, and a wired tool at a serial port."""

import json
import math
import os
import pty
import sys
import time
import tty
from pathlib import Path

import pytest

import running_graph
from mwd_sensors.simulator.scenario import read
from mwd_sensors.simulator.serial_channel import transmit
from mwd_sensors.telemetry import tool_configuration
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.receiver import pressure_files
from mwd_surface.receiver.link import receivers
from mwd_surface.ros.topics import OF_TOOL
from running_graph import PLACE, messages_of

pytestmark = [pytest.mark.ros, pytest.mark.slow(4)]

SCENARIO = Path(__file__).parent / "scenarios" / "two_links.yaml"
WIRED = ToolConfiguration(
    code="serial", transmit_delay_s=0.0, survey_sequences=("Inc:12 Azm:12 Grav:12",), toolface_sequences=("aTFA:7",)
)


def final_words(bag, well, link):
    """Code and confidence of each final word of a link, by frame and place."""
    words = [word for word in messages_of(bag, f"/{well}/link/word") if word.link == link and word.revision]
    return {(int(w.frame), int(w.place)): (w.name, int(w.raw), round(float(w.confidence), 9)) for w in words}


def decoded_again(bag, tool):
    """The same of what `mwd decode` makes of the recording."""
    if tool.link == "serial":
        heard = pressure_files.read_bytes(bag, tool.serial.baud)
    else:
        heard = pressure_files.read(bag, link=tool.link)
    receiver = receivers.receiver_of(tool)
    for pump, times in heard.strokes.items():
        receiver.strokes(pump, times)
    words = receiver.push(heard.time_s, heard.pressure_pa).words + receiver.finish().words
    return {(w.frame, w.index): (w.name, w.raw, round(w.confidence, 9)) for w in words}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The scenario at five times its pace, and a wired tool of another well at a port; a surface for each."""
    folder = tmp_path_factory.mktemp("links")
    telemetry = read(SCENARIO).telemetry
    for name, tool in (("one", telemetry.tool), ("two", telemetry.second_tool), ("wired", WIRED)):
        (folder / f"{name}.yaml").write_text(tool_configuration.text(tool))
    files = {"tool_file": folder / "one.yaml", "second_tool_file": folder / "two.yaml"}
    data, sent = transmit(WIRED, 20.0, 3)
    master, slave = pty.openpty()
    tty.setraw(slave)
    with running_graph.graph(folder) as graph:
        common = {"folder": folder / "data", "record__name": "run", "page__port": 0}
        nodes = [
            graph.start("surface", "w1", link__source="best", **common),
            graph.start("receiver", "w1", **files, **PLACE),
            graph.start("estimator", "w1", **{f"transmit__{name}": file for name, file in files.items()}, **PLACE),
            graph.start("surface", "w2", link__source="serial", **common),
            graph.start("receiver", "w2", tool_file=folder / "wired.yaml", serial_port=os.ttyname(slave)),
        ]
        graph.active(*nodes)
        graph.start("sonde", "w1", scenario=SCENARIO, rate=5.0, wait_for_listener_s=60.0, exit_at_end=True)
        wells = ("w1", "w2")
        visitor = Path(__file__).with_name("open_names.py")
        graph.begin("visitor", sys.executable, visitor, *(f"/{well}/surface" for well in wells))
        for first in range(0, len(data), 16):
            os.write(master, data[first : first + 16])
            time.sleep(0.02)
        assert graph.wait("visitor", 90) == 0, graph.log("visitor")
        assert graph.wait("w1/sonde", 150) == 0
        time.sleep(1.0)
        logs = {name: graph.log(name) for name in nodes}
        opened = json.loads(graph.log("visitor").splitlines()[-1])
        for name in reversed(nodes):
            assert graph.end(name)[0] == 0, graph.log(name)
    os.close(master)
    bags = [folder / "data" / well / "bags" / "run" for well in wells]
    return {"bag": bags[0], "wired": bags[1], "tools": telemetry.tools, "sent": sent, "logs": logs, "open": opened}


@pytest.mark.parametrize("well", ["w1", "w2"])
def test_the_surface_subscribes_to_nothing_of_the_tool_but_the_link(run, well):
    opened = run["open"][f"/{well}/surface"]
    assert not set(OF_TOOL) & set(opened["subscribe"])
    assert {"link/attitude", "link/survey", "link/word"} <= set(opened["subscribe"])
    asked = opened["request"]
    assert not [name for name in asked if name.startswith(("estimator/", "sonde/")) or "take_survey" in name]


def test_the_survey_of_both_links_is_in_the_list_once_and_names_its_source(run):
    lists = messages_of(run["bag"], "/w1/surveys")
    (record,) = lists[-1].records
    assert record.survey.azimuth_method == "link"
    assert any(reason.startswith("received over") for reason in record.survey.reasons)
    words = messages_of(run["bag"], "/w1/link/word")
    assert {word.link for word in words if word.name == "Azm" and word.status == 0} == {"mud_pulse", "em"}


def test_the_toolface_of_the_link_is_published_with_at_least_the_sigma_of_its_bits(run):
    known = [face.sigma for face in messages_of(run["bag"], "/w1/toolface") if math.isfinite(face.sigma)]
    assert known
    assert min(known) > 0.99 * math.tau / 2**7 / math.sqrt(12.0)


@pytest.mark.parametrize("k", [0, 1], ids=["mud_pulse", "em"])
def test_words_of_the_recording_are_those_that_it_decodes_to(run, k):
    tool = run["tools"][k]
    live, again = final_words(run["bag"], "w1", tool.link), decoded_again(run["bag"], tool)
    assert len(live) >= 7
    assert live == {key: again[key] for key in live}


def test_strokes_are_recorded_beside_the_pressure(run):
    assert sum(len(burst.pump) for burst in messages_of(run["bag"], "/w1/rig/strokes")) > 200


def test_the_surface_records_nothing_of_the_tool(run):
    with Bag(run["bag"]) as bag:
        assert not {f"/w1/{topic}" for topic in OF_TOOL} & set(bag.topics)


def test_bytes_of_a_port_are_words_and_recorded_and_decode_to_the_same_words(run):
    live = final_words(run["wired"], "w2", "serial")
    assert [raw for _, raw, _ in live.values()] == [word.raw for word in run["sent"]]
    assert live == decoded_again(run["wired"], WIRED)


def test_nobody_complained(run):
    assert not [name for name, log in run["logs"].items() if "Traceback" in log or "anew" in log]
