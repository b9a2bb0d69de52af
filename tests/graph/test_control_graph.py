# SPDX-License-Identifier: Apache-2.0
"""Real nodes and the ROS controller of docs/rig/control.md: control taken, held, contested, lost with its process."""

import re
import signal
import subprocess
import sys

import pytest

import running_graph
from project import ROOT
from running_graph import until

PAGE = ROOT / "docs" / "rig" / "control.md"
STEERED = ROOT / "tests" / "graph" / "scenarios" / "steered.yaml"
pytestmark = [pytest.mark.ros, pytest.mark.slow(3)]

# Somebody who sends without a lease of his own, to the authority and past it.
INTRUDER = """
import sys, time, rclpy
from mwd_msgs.msg import ControlState, RigCommand, SealedCommand
from mwd_surface.ros.controller import Controller
rclpy.init()
node = rclpy.create_node("intruder", namespace=sys.argv[1])
past = node.create_publisher(RigCommand, "rig/command", 10)
unsigned = node.create_publisher(SealedCommand, "control/command", 10)
me, heard, seen = Controller(node, "first"), [], []
node.create_subscription(SealedCommand, "control/command", heard.append, 10)
node.create_subscription(ControlState, "control/state", seen.append, 10)
while not me.ready or past.get_subscription_count() < 2 or not heard or not seen or not seen[-1].lease:
    rclpy.spin_once(node, timeout_sec=0.05)
lease, replayed = seen[-1].lease, heard[-1]
for priority in (0, 255):  # under the owner's name
    asked = me.ask(priority=priority)
    rclpy.spin_until_future_complete(node, asked)
    print("asked:", asked.result().permission, asked.result().message, flush=True)
me.lease = lease
for k in range(1, 11):
    command = dict(mode=RigCommand.ROTATE, rotary_speed=9.0, valid_for=5.0)
    past.publish(RigCommand(lease=1, sequence=k, **command))
    unsigned.publish(SealedCommand(command=RigCommand(lease=lease, sequence=100 + k, **command)))
    unsigned.publish(replayed)
    me.send(RigCommand(lease=lease, sequence=200 + k, **command))
    time.sleep(0.1)
me.lease = lease
released = me.release()
rclpy.spin_until_future_complete(node, released)
print("released:", released.result().success, released.result().message, flush=True)
"""


def program(name, goes_on="time.monotonic() < end"):
    """The ROS controller of the page, under a name and for as long as an expression holds."""
    text = re.search(r"```python\n(.*?)```", PAGE.read_text().split("\n## ROS\n")[1], re.DOTALL).group(1)
    assert "while time.monotonic() < end:" in text
    return text.replace('"my_controller"', f'"{name}"').replace("time.monotonic() < end", goes_on)


@pytest.fixture(scope="module")
def contested(tmp_path_factory):
    """What the controllers said, and the recording."""
    folder = tmp_path_factory.mktemp("contested")
    with running_graph.graph(folder) as graph:

        def run(name, text):
            script, log = folder / f"{name}.py", folder / f"{name}.txt"
            script.write_text(text)
            with log.open("wb") as out:
                graph.running[name] = subprocess.Popen(
                    [sys.executable, str(script), "/w1"], env=graph.environment, stdout=out, stderr=subprocess.STDOUT
                )
            return log

        settings = {"folder": folder / "data", "page__port": 0, "record__name": "run"}
        settings |= {"control__enabled": True, "control__grant": "automatic", "control__speed_rate_rpm_s": 60.0}
        surface = graph.start("surface", "w1", **settings)
        until(lambda: ": active" in graph.log(surface), 90, "the surface is active")
        sonde = graph.start("sonde", "w1", scenario=STEERED, rate=1.0, wait_for_listener_s=60.0)
        until(lambda: "scenario steered" in graph.log(sonde), 90, "the scenario begins")
        enough = folder / "enough"
        first = run("first", program("first", f"not __import__('os').path.exists({str(enough)!r})"))
        until(lambda: "first has control" in graph.log(surface), 60, "the first has control")
        second = run("second", program("second"))
        until(lambda: "first has control" in second.read_text(), 60, "the second is refused")
        intruder = run("intruder", INTRUDER)
        until(lambda: graph.running["intruder"].poll() is not None, 60, "the intruder is done")
        enough.touch()
        until(lambda: "second has control" in graph.log(surface), 60, "the second has its turn")
        until(lambda: "driller controls" in second.read_text(), 60, "the second is done")
        third = run("third", program("third", "True"))
        until(lambda: "third has control" in graph.log(surface), 60, "the third has control")
        graph.running["third"].send_signal(signal.SIGKILL)
        until(lambda: "third is silent" in graph.log(surface), 30, "its death is noticed")
        facts = {"first": first.read_text(), "second": second.read_text(), "third": third.read_text()}
        facts |= {"intruder": intruder.read_text(), "log": graph.log(surface), "rig": graph.log(sonde)}
        graph.end(surface)
        graph.end(sonde)
        facts["bag"] = folder / "data" / "w1" / "bags" / "run"
        yield facts


def test_the_controller_of_the_page_rotates_the_string_and_gives_back(contested):
    said = re.search(r"acknowledged (\d+) asked ([\d.]+) achieved ([\d.]+)", contested["first"])
    assert int(said.group(1)) == 1
    assert float(said.group(2)) == pytest.approx(3.14159, abs=1e-3)
    assert float(said.group(3)) == pytest.approx(3.14159, abs=0.05)
    assert "the driller controls top drive and pumps" in contested["first"]


def test_a_second_controller_waits_its_turn_and_neither_overwrites_the_other(contested):
    assert "no control: first has control" in contested["second"]
    assert "lost control" not in contested["first"] + contested["second"]
    assert "acknowledged 1" in contested["second"]


def test_nobody_but_the_owner_is_obeyed_whatever_he_has_read(contested):
    said = contested["intruder"].splitlines()
    assert [line[:8] for line in said] == ["asked: 0", "asked: 0", "released"]
    assert all("first is the name of another controller" in line for line in said[:2])
    assert "only first can give it back" in said[2]
    assert "a message on control/command was refused: seal: " in contested["log"]
    assert "rig/command not obeyed: lease: 1 has ended" in contested["rig"]
    from mwd_msgs.msg import RigCommand
    from rclpy.serialization import deserialize_message

    from mwd_surface.bags.bag_reader import Bag

    with Bag(contested["bag"]) as bag:
        sent = [deserialize_message(message[3], RigCommand) for message in bag.messages(["/w1/rig/command"])]
    obeyed = [command.rotary_speed for command in sent if command.lease > 1]
    assert len(obeyed) > 10
    assert max(obeyed) < 6.5  # the driller had 60 r/min, the first asks for 30, the intruder for 86


def test_a_killed_controller_ends_in_the_declared_reaction(contested):
    assert "third is silent" in contested["log"]
    assert "top drive and pumps are back with the driller" in contested["log"].split("third is silent")[1]


def test_the_whole_story_is_in_the_recording(contested):
    from mwd_surface.bags.bag_reader import Bag

    with Bag(contested["bag"]) as bag:
        for topic in ("control/command", "control/state", "rig/command", "rig/acknowledge"):
            assert bag.topics[f"/w1/{topic}"].count > 10, topic
        assert bag.topics["/w1/steering/advice"].count > 0
