# SPDX-License-Identifier: Apache-2.0
"""A node ends when it is asked, whatever it does at that moment, and says where it hung if it has to be cut off."""

import os
import signal
import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.slow

pytest.importorskip("rclpy")

NODE = """
import concurrent.futures, ctypes, dataclasses, os, subprocess, sys, threading, time
from mwd_sensors.ros import run_node, stop_signals
from mwd_sensors.ros.lifecycle_node import GraphNode
moment, run_node.STOP_PATIENCE, rivals = sys.argv[1], float(sys.argv[2]), []

def hang():
    print("now", flush=True)
    while True:
        ctypes.CDLL(None).usleep(100_000_000)  # in native code, as a compiler and the middleware are

def hold_the_lock():
    ctypes.PyDLL(None).usleep(100_000_000)  # in native code that does not release the interpreter

def share_the_processor():
    # Before the node is asked to end: how long a process takes to start, the node would not wait for the processor.
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    words = [sys.executable, "-c", "import signal; signal.alarm(40)\\nwhile True: pass"]
    return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

def compute(seconds):
    until = time.thread_time() + seconds
    while time.thread_time() < until:
        pass
    for rival in rivals:
        rival.kill()

@dataclasses.dataclass(frozen=True)
class Settings:
    pass

class Node(GraphNode[Settings]):
    def __init__(self):
        if moment == "make":
            hang()
        super().__init__("awkward", Settings())

    def configure(self):
        if moment == "configure":
            hang()
        if moment == "background":
            concurrent.futures.ThreadPoolExecutor(1).submit(time.sleep, 100.0)
        for _ in range(3):
            self.add_timer(1e-6 if moment == "busy" else 0.05, self.work)

    def work(self):
        if moment == "callback":
            hang()
        if moment == "compute" and not rivals:
            rivals.append(share_the_processor())
        if moment == "exit":
            self.request_stop()
        print("now", flush=True)
        if moment == "busy":
            time.sleep(0.02)

    def deactivate(self):
        if moment == "deactivate":
            hang()
        if moment == "lock":
            hold_the_lock()
        if moment == "compute":
            compute(0.6 * run_node.STOP_PATIENCE)

if moment == "idle":
    Node.add_timer = lambda *_: threading.Timer(1.0, print, ["now"], {"flush": True}).start()
sys.exit(run_node.run_node(Node, []))
"""


def asked_to_end(
    moment: str, *numbers: signal.Signals, patience: float = 60.0, environment: dict[str, str]
) -> tuple[int, str, float]:
    """
    Start a node, send the signals when it has come to that moment.

    Returns its exit status, what it wrote, and for how long it ran from then on, s.
    """
    with subprocess.Popen(
        [sys.executable, "-P", "-c", NODE, moment, str(patience)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            seen = []
            while (line := process.stdout.readline()) and line != "now\n":
                seen.append(line)
            asked = time.monotonic()
            for number in numbers:
                process.send_signal(number)
            status = process.wait(50)
            return status, "".join(seen) + process.stdout.read(), time.monotonic() - asked
        finally:
            process.kill()


@pytest.fixture
def environment(tmp_path) -> dict[str, str]:
    """Variables of the node."""
    return {**os.environ, "ROS_LOG_DIR": str(tmp_path)}


@pytest.mark.parametrize(("moment", "number"), [("make", signal.SIGINT), ("configure", signal.SIGTERM)])
def test_a_node_that_hangs_in_native_code_while_it_starts_ends_when_asked(moment, number, environment):
    status, output, _ = asked_to_end(moment, number, environment=environment)
    assert (status, output.splitlines()[-1]) == (0, "stopped while it was starting")


@pytest.mark.parametrize(
    ("moment", "numbers"),
    [
        ("idle", (signal.SIGINT, signal.SIGTERM)),
        ("idle", (signal.SIGTERM, signal.SIGINT)),
        ("busy", (signal.SIGINT, signal.SIGTERM)),
        ("background", (signal.SIGTERM, signal.SIGINT)),
        ("exit", ()),
    ],
)
def test_a_node_ends_in_order_however_often_and_whenever_it_is_asked(moment, numbers, environment):
    status, output, _ = asked_to_end(moment, *numbers * 20, environment=environment)
    assert (status, "Traceback" in output, "Thread" in output) == (0, False, False)


# The system counts the waiting for a processor, but not for a machine that others have as well: a second run decides.
@pytest.mark.ros
def test_a_node_that_waits_for_a_processor_is_not_taken_for_one_that_hangs(environment):
    status, output, seconds = asked_to_end("compute", signal.SIGINT, patience=3.0, environment=environment)
    assert (status, "Thread" in output) == (0, False)
    assert seconds > 3.0


# Both say that they are there: the callback hangs at once, the deactivation when it is asked to end.
@pytest.mark.parametrize(("moment", "place"), [("callback", "in work"), ("deactivate", "in deactivate")])
def test_a_node_that_hangs_is_cut_off_and_says_where(moment, place, environment):
    status, output, _ = asked_to_end(moment, signal.SIGTERM, patience=0.5, environment=environment)
    assert status == 1
    assert " s after the request to stop; what its threads do:" in output
    assert "Timeout" not in output
    assert "in hang" in output
    assert place in output


def test_a_node_that_hangs_and_holds_the_interpreter_is_cut_off_too(environment):
    status, output, _ = asked_to_end("lock", signal.SIGTERM, patience=0.5, environment=environment)
    assert (status, "in hold_the_lock" in output) == (1, True)
