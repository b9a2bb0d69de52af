# SPDX-License-Identifier: Apache-2.0
"""The surface node among real nodes: what its recording carries beside the messages, and the live Foxglove server."""

import asyncio
import json
import struct
import subprocess
import sys
from pathlib import Path

import aiohttp
import numpy as np
import pytest
from mcap.reader import make_reader

import running_graph
from mwd_sensors.core import wire
from mwd_sensors.simulator.scenario import read
from mwd_surface.runs import simulate
from running_graph import PLACE, samples_of, until

SCENARIO = Path(__file__).parent / "scenarios" / "short.yaml"
pytestmark = [pytest.mark.ros, pytest.mark.slow(5)]


async def watch(address, topic, count):
    """Stamps and bytes of some messages of a topic, as a Foxglove viewer gets them, and the times it was told."""
    found, times = [], []
    async with (
        asyncio.timeout(60.0),
        aiohttp.ClientSession() as session,
        session.ws_connect(address.replace("ws:", "http:"), protocols=["foxglove.sdk.v1"]) as talk,
    ):
        while len(found) < count:
            reported = await talk.receive()
            if reported.type == aiohttp.WSMsgType.TEXT:
                for channel in json.loads(reported.data).get("channels", []):
                    if channel["topic"] == topic:
                        one = {"id": 1, "channelId": channel["id"]}
                        await talk.send_json({"op": "subscribe", "subscriptions": [one]})
            elif reported.type == aiohttp.WSMsgType.BINARY and reported.data[0] == 1:
                found.append((struct.unpack_from("<Q", reported.data, 5)[0], reported.data[13:]))
            elif reported.type == aiohttp.WSMsgType.BINARY and reported.data[0] == 2:
                times += struct.unpack_from("<Q", reported.data, 1)
            else:
                assert reported.type == aiohttp.WSMsgType.BINARY, reported
    return found, times


def is_reported(log):
    """Whether a report was made after the last survey."""
    return log.rfind("report of") > log.rfind("survey: survey")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short run with everything switched on."""
    folder = tmp_path_factory.mktemp("surface")
    with running_graph.graph(folder) as graph:
        extras = {"foxglove__enabled": True, "foxglove__port": 0, "page__port": 0}
        graph.environment["MWD_PAGE_TOKEN"] = "a-long-secret"  # noqa: S105
        surface = graph.start("surface", "w1", folder=folder / "data", record__name="run", **extras)
        estimator = graph.start("estimator", "w1", **{k.replace(".", "__"): v for k, v in PLACE.items()})
        for name in (surface, estimator):
            until(lambda name=name: ": active" in graph.log(name), 90, f"{name} is active")
        sonde = graph.start("sonde", "w1", scenario=SCENARIO, rate=2.0, wait_for_listener_s=60.0)
        address = until(lambda: graph.log(surface).partition("foxglove: ")[2].split()[:1], 20, "the address")[0]
        watched, times = asyncio.run(watch(address, "/w1/imu/data_raw", 200))
        assert times == []
        until(lambda: "survey 1" in graph.log(surface), 90, "a survey")
        # Once no survey can come any more: the recording encloses no report of a list that has changed since.
        assert graph.end(sonde)[0] == 0
        assert graph.end(estimator)[0] == 0
        until(lambda: is_reported(graph.log(surface)), 60, "the report of the whole list")
        assert graph.end(surface)[0] == 0
        (file,) = (folder / "data" / "w1" / "bags" / "run").glob("*.mcap")
        yield {"file": file, "watched": watched}


def test_a_foxglove_viewer_gets_the_very_bytes_that_are_recorded(run):
    with run["file"].open("rb") as stream:
        recorded = {m.data for _, _, m in make_reader(stream).iter_messages(["/w1/imu/data_raw"])}
    assert len(run["watched"]) >= 200
    assert all(data in recorded for _, data in run["watched"])


def test_the_recording_carries_versions_and_the_parameters_of_every_node_but_no_secret(run):
    with run["file"].open("rb") as stream:
        tables = {m.name: m.metadata for m in make_reader(stream).iter_metadata()}
    assert {"mwd", "parameters/surface", "parameters/estimator", "parameters/sonde"} <= set(tables)
    assert tables["parameters/estimator"]["place.lat_deg"] == "38.3"
    assert tables["parameters/surface"]["foxglove.enabled"] == "True"
    assert not any("a-long-secret" in value for table in tables.values() for value in table.values())


def test_the_surveys_and_their_report_are_enclosed_when_it_ends(run):
    with run["file"].open("rb") as stream:
        enclosed = {a.name: a for a in make_reader(stream).iter_attachments()}
    assert {"surveys_definitive.csv", "surveys_raw.csv", "survey_report.html"} <= set(enclosed)
    assert enclosed["survey_report.html"].data.startswith(b"<!DOCTYPE html>")


def test_a_foxglove_viewer_of_a_simulated_clock_is_told_it_and_gets_stamps_of_it(tmp_path):
    bag = tmp_path / "bag"
    simulate.record(read(SCENARIO), bag, "w1")
    extras = {"use_sim_time": True, "foxglove__enabled": True, "foxglove__port": 0, "serve_page": False}
    with running_graph.graph(tmp_path) as graph:
        surface = graph.start("surface", "w1", folder=tmp_path / "data", **extras)
        until(lambda: ": active" in graph.log(surface), 90, "the surface is active")
        words = [sys.executable, "-P", "-m", "mwd_surface.cli", "replay", str(bag), "--loop", "--wait", "60"]
        with (tmp_path / "replay.log").open("w") as log:
            graph.running["replay"] = subprocess.Popen(
                words, env=graph.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
        address = until(lambda: graph.log(surface).partition("foxglove: ")[2].split()[:1], 60, "the address")[0]
        found, times = asyncio.run(watch(address, "/w1/imu/data_raw", 300))
        assert graph.end("replay")[0] == 0
        assert graph.end(surface)[0] == 0
    recorded = samples_of(bag, "/w1/imu/data_raw")["stamp_ns"]
    stamps = [wire.IMU.decode(data)["stamp_ns"][0] for _, data in found]
    assert np.isin(stamps, recorded).all()
    # A message is handed over within the time of the recording; the wall is half a year or more away from it.
    assert times
    for given in (times, [stamp for stamp, _ in found]):
        assert recorded[0] - 10**9 < min(given) <= max(given) < recorded[-1] + 10**9
