# SPDX-License-Identifier: Apache-2.0
"""
Sonde and estimator, and a surface on a network of its own that is cut and mended.

Prints what the surface's list holds and what the estimator took, as JSON.
"""

import json
import os
import sys
import time
from pathlib import Path

import rclpy
from mwd_msgs.msg import Survey
from rclpy.qos import DurabilityPolicy, QoSProfile

import running_graph
from lossy_network import LossyNetwork
from mwd_surface.surveys.survey_store import decoded

CUT_S = float(sys.argv[2])
# Few samples: the network is tested here, and most of the time of the nodes goes by the number of messages.
STORY = """
name: cut
rate_hz: 25
precision: null
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


def main() -> None:
    """Play it."""
    folder = Path(sys.argv[1])
    (folder / "story.yaml").write_text(STORY)
    network = LossyNetwork(folder)
    with running_graph.graph(folder) as graph:
        graph.environment = network.environment(graph.environment)
        # This process heard of its environment too late to be preloaded into; it talks by UDP as the nodes do.
        os.environ |= {name: value for name, value in graph.environment.items() if name != "LD_PRELOAD"}
        rclpy.init()
        node, taken = rclpy.create_node("watcher"), {}
        qos = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(Survey, "/w1/survey", lambda got: taken.setdefault(got.uuid, time.monotonic()), qos)
        surface = graph.start("surface", "w1", folder=folder / "data", page__port=0)
        # Its network is its own from here on: the others get one that nothing disturbs.
        del graph.environment["LD_PRELOAD"]
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
        network.disturb(1.0)
        cut, before = time.monotonic(), listed()
        watched(lambda: time.monotonic() - cut > CUT_S and taken and max(taken.values()) > cut, 180.0, "a survey")
        during, lonely = [uuid for uuid, when in taken.items() if when > cut], listed()
        network.disturb(0.0)
        mended = time.monotonic()
        watched(lambda: max(taken.values()) > mended, 120.0, "a survey after the cut")
        watched(lambda: set(taken) <= set(listed()), 60.0, "all surveys in the list")
        alive = all(process.poll() is None for process in graph.running.values())
        statuses = [graph.end(name)[0] for name in (sonde, estimator)]
        # A survey may have been taken since.
        watched(lambda: set(taken) == set(listed()), 60.0, "the list of the surveys taken")
        statuses.append(graph.end(surface)[0])
        logs = "".join(graph.log(name) for name in (sonde, estimator, surface))
        rclpy.shutdown()
        report = {"before": before, "during": during, "lonely": lonely, "after": listed(), "taken": list(taken)}
        print(json.dumps(report | {"alive": alive, "statuses": statuses, "traceback": "Traceback" in logs}))


if __name__ == "__main__":
    main()
