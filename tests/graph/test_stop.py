# SPDX-License-Identifier: Apache-2.0
"""Every node of the graph ends when it is asked: while it starts, under full load, beside a peer that was killed."""

import signal
from pathlib import Path

import pytest

from running_graph import EXECUTABLES, PLACE, Graph, graph, until

pytestmark = [pytest.mark.ros, pytest.mark.slow(10)]


def hears_signals(running: Graph, name: str) -> bool:
    """Whether a process has asked to be told of SIGTERM."""
    status = Path(f"/proc/{running.running[name].pid}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


def test_a_node_that_is_starting_ends_with_status_0(tmp_path):
    with graph(tmp_path) as running:
        # Nodes that record do so here, not in the home of who runs the tests.
        kept = {"surface:page__port": 0}
        for name in [running.start(node, **kept, **{"surface:folder": tmp_path / node}) for node in EXECUTABLES]:
            until(lambda name=name: hears_signals(running, name), 120.0, f"{name} to hear signals")
            status, _ = running.end(name, within=60.0)
            assert (name, status, "Traceback" in running.log(name)) == (name, 0, False)


def test_a_node_under_full_load_ends_in_order_beside_peers_that_were_killed(tmp_path):
    with graph(tmp_path) as running:
        names = [
            running.start("surface", folder=str(tmp_path), page__port=0, record__name="run"),
            running.start("estimator", **PLACE),
            running.start("sonde", rate=0.0, wait_for_listener_s=60.0),
        ]
        for name, words in zip(names, ("recording to", "active", "scenario default"), strict=True):
            until(lambda name=name, words=words: words in running.log(name), 240.0, f"{name} to work")
        running.end(names[1], signal.SIGKILL)
        assert running.end(names[2], within=60.0)[0] == 0
        assert running.end(names[0], signal.SIGTERM, within=60.0)[0] == 0
        assert not any("Traceback" in running.log(name) for name in names)
