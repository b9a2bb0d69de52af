# SPDX-License-Identifier: Apache-2.0
"""The link among real nodes: pressure alone feeds words, survey list and toolface; the tool is not subscribed to."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest

import running_graph
from mwd_sensors.core import gauge_burst
from mwd_sensors.simulator.mud_channel import MudChannel
from mwd_sensors.simulator.mud_line import WellGeometry
from mwd_sensors.simulator.pulse_tool import link_run, transmit
from mwd_sensors.telemetry import tool_configuration
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.receiver import pressure_files
from mwd_surface.receiver.pulse.pulse_receiver import decode
from mwd_surface.ros.topics import OF_TOOL
from running_graph import until

pytestmark = [pytest.mark.ros, pytest.mark.slow]

START_NS = 1_772_345_000_000_000_000
TOOL = ToolConfiguration(
    pulse_width_s=0.5,
    transmit_delay_s=30.0,
    survey_sequences=("Inc:12:P Azm:12:P DipA:12:P Grav:12:P MagF:12:P",),
    toolface_sequences=("aTFA:6:P",),
)
PLAY = """
import json, sys, time, rclpy
from mwd_msgs.msg import PressureBurst
from mwd_sensors.ros import qos
rclpy.init(); node = rclpy.create_node("gauge", namespace="w1")
out = node.create_publisher(PressureBurst, "rig/standpipe", qos.EVENT)
until = time.monotonic() + 30.0
while out.get_subscription_count() < 2 and time.monotonic() < until:
    rclpy.spin_once(node, timeout_sec=0.1)
# A node and each of its endpoints become known one after the other.
topics = []
while not {"/w1/link/attitude", "/w1/link/survey"} <= set(topics) and time.monotonic() < until:
    rclpy.spin_once(node, timeout_sec=0.1)
    if ("surface", "/w1") in node.get_node_names_and_namespaces():
        topics = [name for name, _ in node.get_subscriber_names_and_types_by_node("surface", "/w1")]
clients = [name for name, _ in node.get_client_names_and_types_by_node("surface", "/w1")]
with open(sys.argv[1], "rb") as file:
    size = int.from_bytes(file.read(4), "little")
    while message := file.read(size):
        out.publish(message)
        time.sleep(0.01)
rclpy.spin_once(node, timeout_sec=1.0)
print(json.dumps({"topics": topics, "clients": clients}))
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Seven minutes of pressure played to receiver and surface within some seconds."""
    folder = tmp_path_factory.mktemp("link")
    (folder / "tool.yaml").write_text(tool_configuration.text(TOOL))
    channel = MudChannel(well=WellGeometry(depth_m=1500.0), flow_off_s=((-100.0, 20.0),))
    heard = link_run(channel, transmit(TOOL, ((20.0, 260.0),), 3), 260.0, 3)
    messages = [
        gauge_burst.encode(START_NS + k * 10**9, 0.01, heard.pressure_pa[100 * k : 100 * k + 100]) for k in range(260)
    ]
    (folder / "gauge.bin").write_bytes(len(messages[0]).to_bytes(4, "little") + b"".join(messages))
    with running_graph.graph(folder) as graph:
        surface = graph.start(
            "surface", "w1", folder=folder / "data", record__name="run", page__port=0, link__source="mud_pulse"
        )
        receiver = graph.start("receiver", "w1", tool_file=folder / "tool.yaml")
        for name in (surface, receiver):
            until(lambda name=name: ": active" in graph.log(name), 90, f"{name} is active")
        played = subprocess.run(
            [sys.executable, "-c", PLAY, str(folder / "gauge.bin")],
            env=graph.environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=360,
        )
        assert played.returncode == 0, played.stderr
        until(lambda: "survey 1" in graph.log(surface), 30, "a survey")
        assert graph.end(receiver)[0] == 0
        assert graph.end(surface)[0] == 0
    return {"bag": folder / "data" / "w1" / "bags" / "run", "heard": heard, **json.loads(played.stdout)}


def test_the_surface_subscribes_to_nothing_of_the_tool_but_the_link(run):
    assert not {f"/w1/{topic}" for topic in OF_TOOL} & set(run["topics"])
    assert {"/w1/link/attitude", "/w1/link/survey", "/w1/link/word", "/w1/rig/standpipe"} <= set(run["topics"])
    assert not [name for name in run["clients"] if "/estimator/" in name or "/sonde/" in name or "take_survey" in name]


def test_words_of_the_recording_are_those_that_its_pressure_decodes_to(run):
    with Bag(run["bag"]) as bag:
        topic = bag.find_topic("mwd_msgs/msg/LinkWord", "link/word")
        live = {}
        for _, name, _, data in bag.messages([topic]):
            word = bag.decode(name, data)
            if word.revision == 1:
                live[int(word.frame), int(word.place)] = (word.name, int(word.raw), round(float(word.confidence), 9))
    read = pressure_files.read(run["bag"])
    again = decode(TOOL, read.time_s, read.pressure_pa)
    offline = {(w.frame, w.index): (w.name, w.raw, round(w.confidence, 9)) for w in again.words}
    assert len(live) >= 6
    assert live == {key: offline[key] for key in live}
    assert np.array_equal(read.pressure_pa[:100], run["heard"].pressure_pa[:100])


def test_the_survey_and_the_toolface_reach_the_list_and_the_graph(run):
    with Bag(run["bag"]) as bag:
        lists = [
            bag.decode(name, data)
            for _, name, _, data in bag.messages([bag.find_topic("mwd_msgs/msg/SurveyList", "surveys")])
        ]
        faces = [
            bag.decode(name, data)
            for _, name, _, data in bag.messages([bag.find_topic("mwd_msgs/msg/Toolface", "toolface")])
        ]
    assert lists[-1].records[0].survey.azimuth_method == "link"
    known = [face for face in faces if math.isfinite(face.sigma)]
    assert known
    assert all(face.sigma > 0.03 for face in known)
