# SPDX-License-Identifier: Apache-2.0
"""A downlink among real nodes: a command makes the tool's pulses narrower, and the receiver follows it."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

import running_graph
from mwd_sensors.simulator.scenario import read
from mwd_sensors.telemetry import tool_configuration
from mwd_sensors.telemetry.downlink import COMMANDS, DownlinkFrame, frame_of
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.downlink.machine import DownlinkState
from mwd_surface.runs import launch_plan
from running_graph import until

pytestmark = [pytest.mark.ros, pytest.mark.slow(17)]

RATE = 4.0
SCENARIO = Path(__file__).parents[2] / "bags" / "scenarios" / "telemetry_downlink.yaml"
RPM = math.pi / 30.0
PULSE_WIDTH = COMMANDS.index("pulse_width")


def shorter(folder):
    """Write the scenario with a quarter of the samples and a survey that is taken and sent sooner; return its path."""
    story = yaml.safe_load(SCENARIO.read_text())
    story["rate_hz"], story["schedule"][0]["seconds"] = 25, 20.0
    story["telemetry"]["tool"]["transmit_delay_s"] = 15.0
    (folder / "story.yaml").write_text(yaml.safe_dump(story))
    return folder / "story.yaml"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("downlink")
    scenario = shorter(folder)
    story = read(scenario)
    tool_file = folder / "tool.yaml"
    tool_file.write_text(tool_configuration.text(story.telemetry.tool))
    reference = {key.replace(".", "__"): value for key, value in launch_plan.reference_parameters(story).items()}
    surface_words = {key.replace(".", "__"): value for key, value in story.surface.items()}
    with running_graph.graph(folder) as graph:
        surface = graph.start(
            "surface",
            "w1",
            folder=folder / "data",
            record__name="run",
            page__port=0,
            link__source="mud_pulse",
            downlink__tool_file=tool_file,
            **surface_words,
        )
        receiver = graph.start("receiver", "w1", tool_file=tool_file, **reference)
        estimator = graph.start("estimator", "w1", transmit__tool_file=tool_file, **reference)
        for name in (surface, receiver, estimator):
            until(lambda name=name: ": active" in graph.log(name), 120, f"{name} is active")
        sonde = graph.start("sonde", "w1", scenario=scenario, rate=RATE, wait_for_listener_s=20.0)
        # Asked for while the tool sends its first survey, which proves the tool's table before the command is granted.
        answers = graph.commands(
            "downlink send pulse_width 0.4 --name Ann",
            "downlink send pulse_width 0.5 --name Ann",
            "downlink grant 1",
            "downlink grant 9 --name Bo",
        )
        until(lambda: "survey 1 received" in graph.log(receiver), 120, "a survey over the link")
        answers += graph.commands("downlink grant 1 --name Bo", "downlink send survey_now --name Ann")
        until(
            lambda: any(f"1: {word}" in graph.log(surface) for word in ("confirmed", "unconfirmed", "aborted")),
            240,
            "the answer",
        )
        # A machine that stands still for a second is six seconds of this rig: whoever watches it must then abort.
        assert "1: confirmed" in graph.log(surface), graph.log(surface)
        assert graph.end(sonde)[0] == 0
        for name in (estimator, receiver, surface):
            assert graph.end(name)[0] == 0
    messages = {}
    with Bag(folder / "data" / "w1" / "bags" / "run") as bag:
        for kind, topic in (("LinkWord", "link/word"), ("DownlinkState", "downlink/state"), ("RigState", "rig/state")):
            found = bag.find_topic(f"mwd_msgs/msg/{kind}", topic)
            messages[kind] = [bag.decode(name, data) for _, name, _, data in bag.messages([found])]
    return {"answers": answers, "log": graph.log(surface), **messages}


def stamp(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def begin(word):
    return word.start.sec + 1e-9 * word.start.nanosec


def test_the_terminal_refuses_asks_and_grants_in_words(run):
    wrong, sent, nobody, other, granted, second = run["answers"]
    assert wrong[0] == 1
    assert "can be 0.3, 0.5, 0.8 s" in wrong[1]
    assert sent[0] == 0
    assert "waits for permission" in sent[1]
    assert second[0] == 1
    assert "only one can run" in second[1]
    assert nobody[0] == 1
    assert "named person" in nobody[1]
    assert other[0] == 1
    assert "request 9 was replaced; the present request is 1" in other[1]
    assert granted[0] == 0


def test_every_step_is_in_the_recording_and_in_the_journal(run):
    states = [DownlinkState(message.state) for message in run["DownlinkState"]]
    steps = [state for k, state in enumerate(states) if k == 0 or state != states[k - 1]]
    ordered = (
        DownlinkState.IDLE,
        DownlinkState.DRAFT,
        DownlinkState.PENDING,
        DownlinkState.GRANTED,
        DownlinkState.ARMED,
        DownlinkState.RUNNING,
        DownlinkState.SENT,
    )
    assert tuple(steps) == (*ordered, DownlinkState.CONFIRMED)
    for word in ("granted (Bo)", "running", "sent", "confirmed"):
        assert f"downlink: 1: {word}" in run["log"]


def test_the_rig_went_down_to_the_lowest_level_and_came_back(run):
    speed = np.array([message.rotary_speed for message in run["RigState"]]) / RPM
    drilling = speed[np.argmax(speed > 109.0) :]
    assert drilling.min() == pytest.approx(66.0, abs=1.0)
    assert drilling[-1] == pytest.approx(110.0, abs=0.5)


def test_the_receiver_reads_on_by_the_new_pulse_width(run):
    confirmed = next(message for message in run["DownlinkState"] if message.state == DownlinkState.CONFIRMED)
    echoes = [word for word in run["LinkWord"] if word.name == "DLnk" and word.raw and word.revision]
    told = [word for word in echoes if frame_of(word.raw) == DownlinkFrame(confirmed.counter, PULSE_WIDTH, 1)]
    # The tool's table is proven before the command: the first words by the new width are believed at once.
    last = run["LinkWord"][run["LinkWord"].index(told[0]) :]
    last = sorted((word for word in last if word.revision and begin(word) >= begin(told[0])), key=begin)
    # The graph may end when the tool's answer is confirmed, before the azimuth is received.
    assert [(word.name, word.status) for word in last][:2] == [("DLnk", 0), ("Inc", 0)]
    before = next(word for word in run["LinkWord"] if word.name == "Inc")
    # Some metres of hole were drilled between the surveys.
    assert last[1].value == pytest.approx(before.value, abs=math.radians(1.0))
    # A word of 13 bits takes 52 TU of half a pulse width.
    assert stamp(last[1]) - begin(last[1]) == pytest.approx(0.25 * 52.0, rel=0.1)
