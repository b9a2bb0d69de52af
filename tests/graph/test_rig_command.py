# SPDX-License-Identifier: Apache-2.0
"""What the simulated rig says of commands: obeyed, of an old lease, refused with a reason, or not meant for it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import running_graph

HERE = Path(__file__).parent
pytestmark = pytest.mark.ros

SCRIPT = """
import json, sys, rclpy
from mwd_msgs.msg import RigCommand
from rclpy.parameter import Parameter
from mwd_sensors.nodes.sonde import SondeNode
rclpy.init()
reported = []
for scenario in sys.argv[1:]:
    node = SondeNode(parameter_overrides=[Parameter("scenario", value=scenario)])
    node.autostart()
    number = [0]
    def after(lease=7, **fields):
        number[0] += 1
        node._rig_commands.obey(RigCommand(valid_for=3.0, lease=lease, sequence=number[0], **fields))
        found = [f for f in node.diagnostics() if f.name == "rig command"]
        reported.append([f.message for f in found] + [dict(f.values) for f in found])
    after(mode=RigCommand.HOLD)
    node._start()
    after(mode=RigCommand.ROTATE, rotary_speed=6.0)
    after(mode=RigCommand.ROTATE, rotary_speed=1000.0)
    after(mode=RigCommand.ORIENT, turn=-1.0)
    after(mode=RigCommand.HOLD, lease=6)
    after(mode=RigCommand.HOLD, lease=0)
    after(mode=RigCommand.RELEASE, lease=8)
    node.trigger_shutdown()
    node.destroy_node()
rclpy.shutdown()
print(json.dumps(reported))
"""


@pytest.fixture(scope="module")
def reported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("commanded")
    with running_graph.graph(folder) as graph:
        scenarios = [str(HERE / "scenarios" / name) for name in ("steered.yaml", "short.yaml")]
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, *scenarios],
            env=graph.environment,
            capture_output=True,
            text=True,
            timeout=360,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        lines = json.loads(done.stdout.splitlines()[-1])
        return {"steered": lines[:7], "short": lines[7:]}


def test_a_rig_that_obeys_says_what_it_does_and_why_not(reported):
    words = [message for message, _ in reported["steered"]]
    assert words[0] == "the scenario has not started"
    assert words[1] == "rotating"
    assert words[2].startswith("rotary_speed: must be within")
    assert words[3] == "turning to an angle"
    assert reported["steered"][3][1] == {"taken": "2", "refused": "2"}


def test_a_rig_obeys_no_older_lease_and_nobody_without_one(reported):
    words = [message for message, _ in reported["steered"]]
    assert words[4] == "lease: 6 has ended; 7 is in force"
    assert "only the control authority" in words[5]
    assert words[6] == ""


def test_a_rig_that_takes_no_commands_says_how_it_would(reported):
    assert all("steering: {}" in message for message, _ in (reported["short"][k] for k in (1, 2, 3, 4, 6)))
    assert reported["short"][6][1] == {"taken": "0", "refused": "7"}
