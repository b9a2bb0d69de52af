"""From recording to emulator to serial line to probe node to recorder: the same samples to the bit."""

import subprocess
import sys

import numpy as np
import pytest

import running_graph
from mwd_sensors.drivers.readings import FIELDS
from mwd_sensors.simulator.scenario import read
from mwd_surface.runs import simulate
from running_graph import samples_of, until

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SCENARIO = """
name: probe
seed: 8
date: 2026-03-01T06:00:00
schedule: [{kind: drill, seconds: 6.0, rpm: 120.0, rop_m_h: 20.0}]
"""


def command(graph, name, *words):
    """Start a command of `mwd`, with its log."""
    with (graph.folder / f"{name}.log").open("w") as log:
        graph.running[name] = subprocess.Popen(
            [sys.executable, "-P", "-m", "mwd_surface.cli", *words],
            env=graph.environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )


@pytest.mark.parametrize("protocol", ["binary", "ascii"])
def test_a_probe_on_a_serial_line_gives_the_samples_of_the_recording(tmp_path, protocol):
    (tmp_path / "scenario.yaml").write_text(SCENARIO)
    sent, link = tmp_path / "sent", tmp_path / "line"
    simulate.record(read(tmp_path / "scenario.yaml"), sent)
    with running_graph.graph(tmp_path) as graph:
        surface = graph.start("surface", folder=tmp_path / "data", serve_page=False, record__name="got")
        until(lambda: ": active" in graph.log(surface), 90, "the surface node is active")
        settings = [f"port:={link}", f"protocol:={protocol}", "clock:=unit", "wait_for_listener_s:=60.0"]
        command(graph, "probe", "node", "probe", "--ros-args", *(w for s in settings for w in ("-p", s)))
        until(lambda: "trying again" in graph.log("probe"), 60, "the probe node looks for its line")
        command(graph, "emulator", "emulate", str(sent), "--protocol", protocol, "--link", str(link), "--wait")
        assert graph.wait("emulator", 90) == 0
        until(lambda: "was lost" in graph.log("probe"), 20, "the node sees that the line is gone")
        for name in ("probe", surface):
            assert graph.end(name)[0] == 0
    (got,) = (tmp_path / "data").rglob("got")
    for topic, fields in FIELDS.items():
        expected, mine = samples_of(sent, f"/{topic}"), samples_of(got, f"/{topic}")
        assert np.array_equal(mine["stamp_ns"], expected["stamp_ns"])
        for field in fields:
            assert mine[field].tobytes() == expected[field].tobytes()
