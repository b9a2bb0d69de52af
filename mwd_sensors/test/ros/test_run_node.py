# SPDX-License-Identifier: Apache-2.0
"""Nodes that cannot start or have no clock say why in one sentence."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

from mwd_sensors.ros.diagnostics import WARN, clock_diagnostics
from mwd_sensors.ros.refused_entity import security_refusal

SECURE = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}


@pytest.mark.slow
@pytest.mark.fault_case(94)
def test_a_secured_node_without_keystore_ends_with_one_sentence():
    words = [sys.executable, "-P", "-c", "from mwd_sensors.nodes.sonde import main; raise SystemExit(main([]))"]
    environment = {**os.environ, **SECURE}
    environment.pop("ROS_SECURITY_KEYSTORE", None)
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("security is enforced and there is no keystore")
    assert "Traceback" not in done.stderr


@pytest.mark.fault_case(94)
def test_what_a_secured_node_lacks_is_named_and_an_unsecured_one_keeps_its_own_error(tmp_path):
    assert security_refusal({}, "any") == ""
    assert security_refusal({**SECURE, "ROS_SECURITY_STRATEGY": "Permissive"}, "any") == ""
    assert "not a folder" in security_refusal({**SECURE, "ROS_SECURITY_KEYSTORE": str(tmp_path / "none")}, "any")
    held = {**SECURE, "ROS_SECURITY_KEYSTORE": str(tmp_path)}
    assert "plugins" in security_refusal(held, "This Fast DDS version doesn't have the security libraries")
    denied = security_refusal(held, "rt/well_1/imu/mag topic not found in allow rule\nat line 7")
    assert "refused: rt/well_1/imu/mag topic not found in allow rule; " in denied
    assert "--enclave" in denied


DENIED = """
import dataclasses, os, sys
from mwd_msgs.action import NorthSeek
from rclpy.impl.implementation_singleton import rclpy_implementation as middleware
from std_msgs.msg import String
from std_srvs.srv import Trigger
from mwd_sensors.core.settings import setting
from mwd_sensors.ros import qos, run_node
from mwd_sensors.ros.lifecycle_node import GraphNode
@dataclasses.dataclass(frozen=True)
class Settings:
    gain: float = setting(1.0, "Gain")
KIND, ENFORCED = sys.argv[1], sys.argv[2] == "enforced"
def refuse(*_args): raise middleware.RCLError("could not create it, at file.cpp:1\\nmore")
class Secured(GraphNode):
    def configure(self):
        # The middleware of the tests has no security plugins: it would refuse a secured node as a whole.
        if ENFORCED: os.environ.update(ROS_SECURITY_ENABLE="true", ROS_SECURITY_STRATEGY="Enforce")
        setattr(middleware, KIND, refuse)
        if KIND == "Publisher": self.add_publisher(String, "spoken", qos.EVENT)
        if KIND == "Subscription": self.add_subscription(String, "/heard", print, qos.EVENT)
        if KIND == "Service": self.add_service(Trigger, "~/served", print)
        if KIND == "Client": self.add_client(Trigger, "asked")
        if KIND == "ActionServer": self.add_action_server(NorthSeek, "sought", print, print)
    def activate(self): print("active")
def made():
    node = Secured("secured", Settings(), namespace="/w1")
    if not ENFORCED: node.create_timer(0.5, node.request_stop)
    return node
sys.exit(run_node.run_nodes([made], []))
"""
KINDS = [
    ("Publisher", "publish /w1/spoken"),
    ("Subscription", "subscribe /heard"),
    ("Service", "reply /w1/secured/served"),
    ("Client", "request /w1/asked"),
    ("ActionServer", "execute /w1/sought"),
]


@pytest.mark.slow
@pytest.mark.fault_case(94)
@pytest.mark.parametrize(("kind", "words"), KINDS)
def test_a_secured_node_without_a_permission_names_it_and_ends_instead_of_running_without_it(kind, words):
    program = [sys.executable, "-c", DENIED, kind, "enforced"]
    done = subprocess.run(program, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines()[-1].startswith(f"this node may not {words}: could not create it")
    assert "mwd security" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_node_without_security_stays_unconfigured_and_names_what_was_refused():
    program = [sys.executable, "-c", DENIED, "Publisher", "open"]
    done = subprocess.run(program, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (0, "")
    assert "cannot configure: this node may not publish /w1/spoken: could not create it" in done.stderr
    assert "mwd security" not in done.stderr


@pytest.mark.fault_case(45)
def test_a_node_on_simulated_time_says_that_it_waits_for_the_clock():
    (waiting,) = clock_diagnostics(True, 0)
    assert (waiting.level, waiting.message) == (WARN, "waiting for /clock")
    assert "use_sim_time" in waiting.remedy
    assert clock_diagnostics(True, 1) == clock_diagnostics(False, 0) == []


START = """
import os, sys
from pathlib import Path
from mwd_sensors.ros import run_node
from mwd_sensors.core.settings import SettingsError
def make():
    Path("made").mkdir(); Path("made/file").write_text("x")
    print(os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"])
    raise SettingsError("enough")
sys.exit(run_node.run_node(make, []))
"""


@pytest.mark.parametrize(("given", "seen"), [(None, "LOCALHOST"), ("SUBNET", "SUBNET")])
def test_a_node_started_by_any_means_stays_on_this_machine_unless_told_and_keeps_its_files_private(
    tmp_path, given, seen
):
    environment = {k: v for k, v in os.environ.items() if k != "ROS_AUTOMATIC_DISCOVERY_RANGE"}
    environment |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": given} if given else {}
    done = subprocess.run(
        [sys.executable, "-c", START], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.stdout.strip(), done.stderr.strip(), done.returncode) == (seen, "enough", 2)
    assert (tmp_path / "made").stat().st_mode & 0o777 == 0o750
    assert (tmp_path / "made" / "file").stat().st_mode & 0o777 == 0o640


FAILING = """
import dataclasses, functools, os, signal, sys
from rclpy.parameter import Parameter
from mwd_sensors.core.settings import setting
from mwd_sensors.ros import run_node
from mwd_sensors.ros.lifecycle_node import GraphNode
@dataclasses.dataclass(frozen=True)
class Settings:
    gain: float = setting(1.0, "Gain")
class Failing(GraphNode):
    # Fails at the place whose name it has.
    changeable = ("gain",)
    def fail_at(self, where):
        if where == self.get_name(): raise KeyError(where)
    def configure(self): self.add_timer(0.05, lambda: self.fail_at("timer"))
    def diagnostics(self): self.fail_at("diagnostics"); return ()
    def on_settings_changed(self, settings): self.fail_at("parameters")
    def deactivate(self): self.fail_at("end")
class Other(GraphNode):
    # The failing nodes have had their turn several times when this one ends the process.
    def configure(self): self.ticks = 0; self.add_timer(0.1, self.tick)
    def tick(self):
        self.ticks += 1
        if self.ticks == 1: print(made["parameters"].set_parameters([Parameter("gain", value=2.0)])[0].successful)
        if self.ticks == 25: os.kill(os.getpid(), signal.SIGINT)
    def deactivate(self): print("ended in order")
made = {}
def failing(where): made[where] = Failing(where, Settings()); return made[where]
nodes = [functools.partial(failing, where) for where in sys.argv[1:]]
sys.exit(run_node.run_nodes([*nodes, lambda: Other("other", Settings())], []))
"""


@pytest.mark.slow(2)
def test_what_nodes_raise_anywhere_leaves_the_others_of_their_process_alone():
    places = ["timer", "diagnostics", "parameters", "end"]
    done = subprocess.run([sys.executable, "-c", FAILING, *places], capture_output=True, text=True, check=False)
    assert (done.stdout.split("\n")[:2], done.returncode) == (["True", "ended in order"], 0)
    assert all(f"KeyError: '{where}'" in done.stderr for where in places[:3]), done.stderr
