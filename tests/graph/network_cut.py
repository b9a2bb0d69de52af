# SPDX-License-Identifier: Apache-2.0
"""
Sonde and estimator on one machine, surface on another, the cable between them cut and mended; run by `unshare -rn`.

The machines are network namespaces joined by a pair of virtual interfaces. Prints what the surface's list holds, what
the estimator took, and what its page said, as JSON.
"""

import contextlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import rclpy
from mwd_msgs.msg import Survey
from rclpy.qos import DurabilityPolicy, QoSProfile

import running_graph
from mwd_surface.surveys.survey_store import decoded

HERE, THERE = "10.9.0.1", "10.9.0.2"

CUT_S = float(sys.argv[2])
STORY = """
name: cut
place: {latitude_deg: 38.3, longitude_deg: 109.6}
well: {stations: [[0.0, 30.0, 40.0], [200.0, 36.0, 47.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}
schedule:
"""
STORY += (
    20
    * """
  - {kind: drill, seconds: 6.0, rpm: 120.0, rop_m_h: 20.0}
  - {kind: still, seconds: 20.0, pumps: false}
"""
)


def run(*words: str) -> None:
    """Run a command of the system."""
    subprocess.run(words, check=True)


@contextlib.contextmanager
def other_machine():
    """Make the other namespace and the pair of interfaces; yields the words that run a command over there."""
    with subprocess.Popen(["unshare", "-n", "sleep", "infinity"]) as there:
        over = ["nsenter", "-t", str(there.pid), "-n"]
        try:
            own = Path("/proc/self/ns/net").readlink()
            running_graph.until(
                lambda: Path(f"/proc/{there.pid}/ns/net").readlink() != own, 10.0, "the other namespace"
            )
            run("ip", "link", "set", "lo", "up")
            run("ip", "link", "add", "here", "type", "veth", "peer", "name", "there", "netns", str(there.pid))
            run("ip", "addr", "add", f"{HERE}/24", "dev", "here")
            run("ip", "link", "set", "here", "up")
            run(*over, "ip", "addr", "add", f"{THERE}/24", "dev", "there")
            run(*over, "ip", "link", "set", "there", "up")
            run(*over, "ip", "link", "set", "lo", "up")
            yield over
        finally:
            there.kill()


def main() -> None:
    """Play it."""
    folder = Path(sys.argv[1])
    (folder / "story.yaml").write_text(STORY)
    # The namespaces share a memory that a real network would not.
    os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    with other_machine() as over, running_graph.graph(folder) as graph:
        del graph.environment["FASTRTPS_DEFAULT_PROFILES_FILE"]
        os.environ |= graph.environment
        rclpy.init()
        node, taken = rclpy.create_node("watcher"), {}
        qos = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(Survey, "/w1/survey", lambda got: taken.setdefault(got.uuid, time.monotonic()), qos)
        surface = graph.start("surface", "w1", before=over, folder=folder / "data", page__port=0)
        estimator = graph.start("estimator", "w1", **running_graph.PLACE)
        sonde = graph.start("sonde", "w1", scenario=folder / "story.yaml", rate=6.0, wait_for_listener_s=60.0)

        def watched(true, within, what):
            def look():
                rclpy.spin_once(node, timeout_sec=0.05)
                return true()

            return running_graph.until(look, within, what)

        def listed():
            files = list((folder / "data").rglob("surveys.json"))
            return [record.survey.uuid for record in decoded(files[0].read_bytes()).records] if files else []

        watched(lambda: len(listed()) >= 1, 180.0, "the first survey in the list")
        run("ip", "link", "set", "here", "down")
        cut, before = time.monotonic(), listed()
        watched(lambda: time.monotonic() - cut > CUT_S and taken and max(taken.values()) > cut, 180.0, "a survey")
        during, lonely = [uuid for uuid, when in taken.items() if when > cut], listed()
        run("ip", "link", "set", "here", "up")
        mended = time.monotonic()
        watched(lambda: max(taken.values()) > mended, 120.0, "a survey after the cut")
        watched(lambda: set(taken) <= set(listed()), 60.0, "all surveys in the list")
        alive = all(process.poll() is None for process in graph.running.values())
        statuses = [graph.end(name)[0] for name in (sonde, estimator, surface)]
        logs = "".join(graph.log(name) for name in (sonde, estimator, surface))
        rclpy.shutdown()
        report = {"before": before, "during": during, "lonely": lonely, "after": listed(), "taken": list(taken)}
        print(json.dumps(report | {"alive": alive, "statuses": statuses, "traceback": "Traceback" in logs}))


if __name__ == "__main__":
    main()
