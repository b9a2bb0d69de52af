# SPDX-License-Identifier: Apache-2.0
"""The live Foxglove server of a surface node whose clock is simulated."""

import asyncio
import json
import struct
from pathlib import Path

import aiohttp
import numpy as np
import pytest

import running_graph
from mwd_sensors.core import wire
from mwd_sensors.simulator.scenario import read
from mwd_surface.runs import simulate
from running_graph import MWD, samples_of, until

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


def test_a_foxglove_viewer_of_a_simulated_clock_is_told_it_and_gets_stamps_of_it(tmp_path):
    bag = tmp_path / "bag"
    simulate.record(read(SCENARIO), bag, "w1")
    extras = {"use_sim_time": True, "foxglove__enabled": True, "foxglove__port": 0, "serve_page": False}
    with running_graph.graph(tmp_path) as graph:
        surface = graph.start("surface", "w1", folder=tmp_path / "data", **extras)
        graph.active(surface)
        graph.begin("replay", *MWD, "replay", bag, "--loop", "--wait", 60)
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
