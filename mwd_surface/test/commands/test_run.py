# SPDX-License-Identifier: Apache-2.0
"""`mwd run` as people use it: real nodes, a page, a recording, a table, and nothing left behind."""

import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from invoked_command import invoke
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.cli import app
from mwd_surface.runs.supervise import Supervisor

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")
pytestmark = pytest.mark.ros

SCENARIO = (
    "name: brief\nrate_hz: 50\nschedule: [{kind: still, seconds: 18.0}]\n"
    "well: {stations: [[0.0, 40.0, 70.0]], bit_m: 103.0, plan: [[0.0, 0.0, 0.0], [200.0, 40.0, 70.0]]}\n"
    "interference: {axial_nt: 1500.0}\nsurface: {advisory.toolface_deg: 40.0, leg.tie_on_depth: 50.0}\n"
)


@pytest.fixture
def start(tmp_path):
    (tmp_path / "brief.yaml").write_text(SCENARIO)
    started = []
    environment = {k: v for k, v in os.environ.items() if k != "ROS_DOMAIN_ID"} | {"COLUMNS": "120"}

    def begin(*words):
        command = [sys.executable, "-m", "mwd_surface.cli", "run", str(tmp_path / "brief.yaml"), *map(str, words)]
        pipe = subprocess.PIPE
        process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, cwd=tmp_path, env=environment)
        started.append(process)
        return process

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def nodes_of(process):
    """Processes that name this one as their supervisor."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            if folder.name.isdigit() and f"MWD_SUPERVISOR={process.pid}\0" in (folder / "environ").read_text():
                found.append(int(folder.name))
        except OSError:
            continue
    return found


def line_with(process, words):
    # Line by line: what is read ahead would be lost to `communicate`.
    while line := process.stdout.readline():
        if words in line:
            return line
    raise AssertionError(process.stderr.read())


@pytest.mark.slow(35)
@pytest.mark.fault_case(56)
def test_two_wells_run_side_by_side_and_end_with_their_tables(start, tmp_path):
    first = start("--well", "a", "--rate", 2)
    second = start("--well", "pad/b", "--rate", 2, "-o", tmp_path / "mine")
    pages = [re.search(r"http://\S+", line_with(process, "http://"))[0] for process in (first, second)]
    assert pages[0] != pages[1]
    rigs = [re.findall(r"127\.0\.0\.1:(\d+)", line_with(process, "rig: WITS")) for process in (first, second)]
    assert rigs[0]
    assert not set(rigs[0]) & set(rigs[1])
    for port in (int(port) for ports in rigs for port in ports):
        socket.create_connection(("127.0.0.1", port), 5.0).close()
    for page in pages:
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(page, timeout=30.0) as answer:
            assert b"<html" in answer.read().lower()
    for process, folder, well in ((first, None, "a"), (second, tmp_path / "mine", "pad/b")):
        out, err = process.communicate(timeout=300)
        assert process.returncode == 0, err
        assert "Traceback" not in out + err
        assert "surveys against the truth" in out, out + err
        assert re.search(r"^ 1 +100\.0 .* accept", out, re.MULTILINE), out
        bag = Path(re.search(r"recording: (\S+)", out)[1])
        bag = bag if bag.is_absolute() else tmp_path / bag
        assert folder is None or folder in bag.parents
        with Bag(bag) as opened:
            assert opened.complete
            topics = [
                name for name in opened.topics if not name.startswith(("/diagnostics", "/tf", "/parameter_events"))
            ]
            assert all(name.startswith(f"/{well}/") for name in topics), topics
            # That the bits are those that went live is shown with the nodes themselves, in tests/.
            counts = {name: opened.topics[f"/{well}/{name}"].count for name in ("imu/data_raw", "attitude", "truth")}
            assert min(counts.values()) > 0.9 * max(counts.values()), counts
        assert nodes_of(process) == []
    for port in (int(port) for ports in rigs for port in ports):
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", port), 5.0)


@pytest.mark.slow(8)
def test_nothing_is_left_when_the_command_itself_is_killed(start):
    process = start("--no-rig")
    line_with(process, "http://")
    nodes = nodes_of(process)
    process.kill()
    process.wait()
    end = time.monotonic() + 60.0
    while nodes_of(process) and time.monotonic() < end:
        time.sleep(0.1)
    assert nodes
    assert nodes_of(process) == []


@pytest.mark.parametrize(("words", "sentence"), [(("--well", "7 b"), "--well"), (("--rate", -1), "--rate")])
def test_a_wrong_word_is_refused_before_anything_starts(tmp_path, monkeypatch, words, sentence):
    (tmp_path / "brief.yaml").write_text(SCENARIO)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Supervisor, "start", lambda *_: pytest.fail("a node was started"))
    with pytest.raises(ValueError, match=sentence):
        invoke(app, "run", "brief.yaml", *words)


@pytest.mark.slow(5)
def test_a_method_that_does_not_exist_ends_the_run_and_no_node_stays(start):
    process = start("--no-rig", "--method", "s4")
    _, err = process.communicate(timeout=240)
    assert process.returncode == 1
    assert "s4" in err
    assert "Traceback" not in err
    assert nodes_of(process) == []


# A magnetometer that fails for a while in a tool whose gyros go on with the azimuth.
FAILING = (
    "name: brief\nrate_hz: 50\n"
    "schedule: [{kind: still, seconds: 14.0}, {kind: drill, seconds: 13.0, rpm: 60.0, rop_m_h: 360.0}, "
    "{kind: still, seconds: 14.0}]\n"
    "well: {stations: [[0.0, 40.0, 70.0], [150.0, 40.0, 70.0]], bit_m: 103.0, "
    "plan: [[0.0, 0.0, 0.0], [200.0, 40.0, 70.0]]}\n"
    "precision: {grade: tactical_north}\nfaults: [{component: mag, fault: 'off', start_s: 19.0, seconds: 5.0}]\n"
    "surface: {advisory.toolface_deg: 40.0, leg.tie_on_depth: 50.0, leg.tie_on_inclination_deg: 40.0, "
    "leg.tie_on_azimuth_deg: 70.0, leg.tie_on_north: 10.0, leg.tie_on_east: 30.0, leg.tie_on_vertical_depth: 40.0}\n"
)
_GONE_S = 6.0  # longer than what the table of supervision allows for any input


@pytest.mark.slow(25)
def test_after_the_end_of_a_scenario_with_a_fault_no_alarm_stands_and_an_interrupt_ends_everything(start, tmp_path):
    (tmp_path / "brief.yaml").write_text(FAILING)
    process = start("--rate", 2, "--no-record", "--no-rig", "--hold")
    page = re.search(r"http://\S+", line_with(process, "http://"))[0]
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    over_at = None
    while over_at is None or time.monotonic() - over_at < _GONE_S:
        with opener.open(f"{page}state.json", timeout=30.0) as answer:
            shown = json.load(answer)["sections"]
        over_at = over_at or (time.monotonic() if shown.get("well", {}).get("over") else None)
        assert process.poll() is None
        time.sleep(0.5)
    assert shown["plan"]["name"] == "brief.csv"
    assert shown["toolface"]["advisory"]["toolface"] == pytest.approx(math.radians(40.0))
    assert shown["path"]["measured_depth"][:1] == [50.0]
    raised = [event["source"] for event in shown["events"]["rows"] if event["kind"] == "raised"]
    assert any("sensors" in source for source in raised), "the fault raised no alarm"
    assert shown["streams"]["sonde"]["state"] != "live"
    assert shown["alarms"]["rows"] == []
    assert shown["alarms"]["not_evaluated"] == []
    assert len(nodes_of(process)) >= 2
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, out + err
    assert "Traceback" not in out + err
    assert nodes_of(process) == []
    with pytest.raises(OSError):
        opener.open(page, timeout=2.0)
