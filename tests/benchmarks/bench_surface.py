# SPDX-License-Identifier: Apache-2.0
"""What the surface node costs, what of fast input it records, and its memory over a long replay."""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import aiohttp
import numpy as np
import yaml

import running_graph
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.page.page_server import PageServer
from mwd_surface.page.settings import PageSettings
from project import SCENARIOS
from running_graph import PLACE, until

TICK = os.sysconf("SC_CLK_TCK")
PAGE_SIZE = os.sysconf("SC_PAGE_SIZE")


def processor_seconds(pid: int) -> float:
    """Time of a process on the processors, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def resident_mb(pid: int) -> float:
    """Memory of a process, MB."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_SIZE / 1e6


def written_scenario(folder: Path, seconds: float) -> Path:
    """A well of three minutes of rotation, a slide and a connection again and again, at a bit's usual pace."""
    default = SCENARIOS / "default.yaml"
    table = yaml.safe_load(default.read_text(encoding="utf-8"))
    turn = [
        {"kind": "drill", "seconds": 180.0, "rpm": 120.0, "rop_m_h": 40.0},
        {"kind": "slide", "seconds": 60.0, "rop_m_h": 30.0, "toolface_deg": 30.0},
        {"kind": "connection", "seconds": 60.0},
    ]
    table["name"] = "long"
    table["schedule"] = [{"kind": "still", "seconds": 20.0, "pumps": False}, *(turn * round(max(1, seconds / 300.0)))]
    path = folder / "long.yaml"
    path.write_text(yaml.safe_dump(table), encoding="utf-8")
    return path


@contextmanager
def watching(address: str) -> Iterator[list[int]]:
    """A browser's talk with the page, in a thread; counts states and bytes."""
    counts, ended = [0, 0], threading.Event()

    async def talk() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{address}live") as socket:
            while not ended.is_set():
                reported = await socket.receive()
                if reported.type != aiohttp.WSMsgType.TEXT:
                    return
                counts[0] += 1
                counts[1] += len(reported.data)

    thread = threading.Thread(target=lambda: asyncio.run(talk()), daemon=True)
    thread.start()
    try:
        yield counts
    finally:
        ended.set()
        thread.join(5.0)


def started(graph: running_graph.Graph, **extras: object) -> tuple[str, str, str]:
    """Names of surface and estimator, and the page's address."""
    surface = graph.start("surface", "w1", page__port=0, record__name="run", **extras)
    estimator = graph.start("estimator", "w1", **{k.replace(".", "__"): v for k, v in PLACE.items()})
    for name in (surface, estimator):
        until(lambda name=name: ": active" in graph.log(name), 120, f"{name} is active")
    return surface, estimator, graph.log(surface).split("page: ")[1].split()[0]


def live(folder: Path, seconds: float) -> list[str]:
    """Share of a core at 100 Hz of both units, real time."""
    with running_graph.graph(folder) as graph:
        surface, estimator, address = started(graph, folder=folder / "live")
        sonde = graph.start("sonde", "w1", scenario=written_scenario(folder, seconds), wait_for_listener_s=60.0)
        until(lambda: "active" in graph.log(sonde), 60, "the sonde is active")
        with watching(address) as counts:
            until(lambda: counts[0] > 20, 60, "the page is fed")
            # The first survey's report brings the drawing library in; that is once a survey, not all the time.
            until(lambda: "report of" in graph.log(surface), 120, "the first report")
            pid = graph.running[surface].pid
            rows = [("page open, recorder on", *share(pid, seconds, counts, address))]
        rows.append(("nobody watches, recorder on", *share(pid, seconds / 2, [0, 0], address)))
        for name in (sonde, estimator, surface):
            graph.end(name)
    head = [
        "| 100 Hz, both units, all recorded | % of a core | messages/s recorded | states/s | kB/s to the page |",
        "|---|---|---|---|---|",
    ]
    return [*head, *("| " + " | ".join([what, *(f"{v:.1f}" for v in figures)]) + " |" for what, *figures in rows)]


def recorded(address: str) -> int:
    """Messages written so far."""
    with urllib.request.urlopen(f"{address}state.json", timeout=10) as answer:  # noqa: S310  (loopback)
        recorder = json.loads(answer.read())["sections"]["recorder"]
    return int(recorder["messages"]) if recorder else 0


def share(pid: int, seconds: float, counts: list[int], address: str) -> tuple[float, float, float, float]:
    """Per cent of a core, messages recorded, states and kB to the page a second."""
    written = recorded(address)
    began, used, states, size = time.monotonic(), processor_seconds(pid), *counts
    while time.monotonic() - began < seconds:
        time.sleep(0.5)
    took = time.monotonic() - began
    cpu = 100.0 * (processor_seconds(pid) - used) / took
    given = (counts[0] - states) / took, (counts[1] - size) / took / 1e3
    return cpu, (recorded(address) - written) / took, *given


PUBLISHER = """
import sys, time, rclpy
from sensor_msgs.msg import Imu, MagneticField
from mwd_sensors.core import wire
from mwd_sensors.ros import qos
rclpy.init()
node, seconds = rclpy.create_node("publisher", namespace="w1"), float(sys.argv[1])
kinds = [(Imu, "imu/data_raw", wire.IMU, 1), (MagneticField, "imu/mag", wire.MAG, 10)]
kinds += [(Imu, "gyro/data_raw", wire.IMU, 10)]
outs = [(node.create_publisher(kind, topic, qos.STREAM), layout, every) for kind, topic, layout, every in kinds]
while any(out.get_subscription_count() == 0 for out, _, _ in outs):
    time.sleep(0.05)
time.sleep(1.0)
began, k, sent = time.monotonic(), 0, 0
while k < 2000 * seconds:
    for k in range(k, min(round(2000 * seconds), round((time.monotonic() - began) * 2000))):
        for out, layout, every in outs:
            if k % every == 0:
                sample = layout.empty(1)
                sample["stamp_ns"] = time.time_ns()
                out.publish(layout.encode(sample, wire.SONDE_FRAME)[0].tobytes())
                sent += 1
        k += 1
    time.sleep(0.002)
print(sent)
"""


def fast(folder: Path, seconds: float) -> list[str]:
    """What of a 2 kHz inertial unit and two 200 Hz sensors is recorded."""
    with running_graph.graph(folder) as graph:
        surface = graph.start("surface", "w1", page__port=0, record__name="run", folder=folder)
        until(lambda: ": active" in graph.log(surface), 120, "the surface is active")
        pid = graph.running[surface].pid
        began, used = time.monotonic(), processor_seconds(pid)
        words = [sys.executable, "-c", PUBLISHER, str(seconds)]
        done = subprocess.run(words, env=graph.environment, capture_output=True, text=True, check=True)
        cpu = 100.0 * (processor_seconds(pid) - used) / (time.monotonic() - began)
        time.sleep(1.0)
        graph.end(surface)
    topics = ("/w1/imu/data_raw", "/w1/imu/mag", "/w1/gyro/data_raw")
    with Bag(folder / "w1" / "bags" / "run") as bag:
        written = sum(bag.topics[topic].count for topic in topics)
    head = [
        "| 2 kHz inertial unit, 200 Hz magnetometer and gyro | sent | recorded | % of a core |",
        "|---|---|---|---|",
    ]
    return [*head, f"| {seconds:.0f} s | {done.stdout.strip()} | {written} | {cpu:.1f} |"]


def replayed(folder: Path, seconds: float, rate: float) -> list[str]:
    """Memory while a long recording is played fast into estimator and surface."""
    mwd = [sys.executable, "-P", "-m", "mwd_surface.cli"]
    scenario, bag = written_scenario(folder, seconds), folder / "long"
    words = [*mwd, "simulate", str(scenario), "-o", str(bag), "--namespace", "/w1"]
    subprocess.run(words, check=True, capture_output=True)
    with running_graph.graph(folder) as graph:
        surface, estimator, address = started(graph, folder=folder / "replay")
        pid = graph.running[surface].pid
        words = [*mwd, "replay", str(bag), "--sensors", "--rate", str(rate), "--wait", "60"]
        found: list[tuple[float, float]] = []
        with watching(address) as counts, (folder / "replay.log").open("wb") as log:
            player = subprocess.Popen(words, env=graph.environment, stdout=log, stderr=log)
            until(lambda: counts[0] > 30, 120, "the page is fed")
            began, used = time.monotonic(), processor_seconds(pid)
            while player.poll() is None:
                found.append(((time.monotonic() - began) * rate, resident_mb(pid)))
                time.sleep(2.0)
            took = time.monotonic() - began
        cpu = (processor_seconds(pid) - used) / took
        for name in (estimator, surface):
            graph.end(name)
    end = found[-1][0]
    tenth, half = (next(mb for at, mb in found if at >= share * end) for share in (0.1, 0.5))
    return [
        f"| replay of {end / 60:.0f} min at {rate:g}x, page open, recorder on | |",
        "|---|---|",
        f"| memory after a tenth, half, all of it | {tenth:.1f}, {half:.1f}, {found[-1][1]:.1f} MB |",
        f"| most | {max(mb for _, mb in found):.1f} MB |",
        f"| % of a core | {100 * cpu:.1f} |",
    ]


def latency(count: int = 300) -> list[str]:
    """From a state handed to the page's server until a watcher has it, in ms."""
    took = []

    async def talk(server: PageServer) -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{server.address}live") as socket:
            await socket.receive()
            for k in range(count):
                began = time.perf_counter()
                server.push({"now": 0.0, "sections": {"a": {"k": k}}, "revisions": {"a": k}})
                while json.loads((await socket.receive()).data)["sections"].get("a", {}).get("k") != k:
                    pass
                took.append(1e3 * (time.perf_counter() - began))

    server = PageServer(PageSettings(port=0))
    server.start()
    try:
        asyncio.run(talk(server))
    finally:
        server.stop()
    half, most = np.quantile(took, (0.5, 0.99))
    return [
        "| from a state to its watcher, ms | median | 99 % | limit |",
        "|---|---|---|---|",
        f"| {count} states | {half:.0f} | {most:.0f} | 200 |",
    ]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--live", type=float, default=20.0, help="seconds of live measurement")
    parser.add_argument("--replay", type=float, default=300.0, help="seconds of recording to replay; 3600 for the hour")
    parser.add_argument("--fast", type=float, default=10.0, help="seconds of 2 kHz input")
    parser.add_argument("--rate", type=float, default=10.0, help="how fast it is replayed")
    options = parser.parse_args()
    print("\n".join(latency()) + "\n", flush=True)
    with tempfile.TemporaryDirectory() as name:
        # Each in a folder of its own: logs of nodes of the same name must not be mixed up.
        one, two, three = (Path(name) / word for word in ("live", "replay", "fast"))
        if options.live > 0.0:
            one.mkdir()
            print("\n".join(live(one, options.live)), flush=True)
        if options.fast > 0.0:
            three.mkdir()
            print("\n" + "\n".join(fast(three, options.fast)), flush=True)
        if options.replay > 0.0:
            two.mkdir()
            print("\n" + "\n".join(replayed(two, options.replay, options.rate)), flush=True)


if __name__ == "__main__":
    main()
