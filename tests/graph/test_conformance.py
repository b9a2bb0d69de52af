# SPDX-License-Identifier: Apache-2.0
"""`mwd rig conformance` against the surface node, over ROS, OPC UA and Modbus: every misuse is refused."""

import asyncio
import concurrent.futures
import json
import re
import shutil
import subprocess
import sys

import pytest

import running_graph
from running_graph import until

pytestmark = [pytest.mark.ros, pytest.mark.slow(60)]
INTERFACES = {"operator": ("ROS", "OPC UA", "Modbus"), "automatic": ("Modbus",)}
HEARTBEAT_S = 2.0


async def certified(folder):
    """A client's own certificate and its key."""
    from asyncua.crypto.cert_gen import setup_self_signed_certificate
    from cryptography.x509.oid import ExtendedKeyUsageOID

    key, certificate = folder / "client.pem", folder / "client.der"
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    names = {"commonName": "conformance"}
    await setup_self_signed_certificate(key, certificate, "urn:mwd:conformance", "localhost", uses, names)
    return certificate, key


def conformance(grant, folder):
    """Output of the command for our own surface node: with a person over every interface, without one over Modbus."""
    opcua = folder / "data" / "w1" / "opcua"
    (opcua / "trusted").mkdir(parents=True)
    certificate, key = asyncio.run(certified(folder))
    shutil.copy(certificate, opcua / "trusted")
    settings = {"folder": folder / "data", "page__port": 0, "well__name": "well", "control__enabled": True}
    settings |= {"control__grant": grant, "control__mwd_lost_sliding": "keep", "control__heartbeat_s": HEARTBEAT_S}
    for name in ("opcua", "modbus"):
        settings |= {f"rig__{name}__{key}": value for key, value in (("enabled", True), ("port", 0))}
        settings[f"rig__{name}__allow_control"] = True
    with running_graph.graph(folder) as graph:
        surface = graph.start("surface", "w1", **settings)
        until(lambda: ": active" in graph.log(surface), 90, "the surface is active")
        status = folder / "data" / "w1" / "rig_status.json"

        def addresses():
            found = status.read_text() if status.exists() else ""
            return re.search(r"opc\.tcp://[^\"]+", found), re.search(r"127\.0\.0\.1:\d+(?=\")", found)

        where = until(lambda: all(addresses()) and addresses(), 60, "the interfaces listen")
        words = ["--modbus", where[1].group(), "--heartbeat", HEARTBEAT_S, "--json"]
        if grant == "operator":
            words += ["--ros", "/w1", "--opcua", where[0].group(), "--certificate", certificate, "--key", key]
            words += ["--server-certificate", opcua / "own.der"]
        done = subprocess.run(
            [sys.executable, "-P", "-m", "mwd_surface.cli", "rig", "conformance", *map(str, words)],
            env=graph.environment,
            capture_output=True,
            text=True,
            timeout=900,
            check=False,
        )
        assert graph.end(surface)[0] == 0
    assert done.stdout, done.stderr
    return done


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Outputs for both settings. The two graphs run at the same time: they wait for heartbeats that do not come."""
    folders = [tmp_path_factory.mktemp(grant) for grant in INTERFACES]
    with concurrent.futures.ThreadPoolExecutor() as pool:
        return dict(zip(INTERFACES, pool.map(conformance, INTERFACES, folders), strict=True))


@pytest.fixture(params=INTERFACES)
def table(request, runs):
    """Interfaces of a run, exit status of the command, and its results."""
    done = runs[request.param]
    return INTERFACES[request.param], done.returncode, json.loads(done.stdout.splitlines()[-1])


def test_our_own_authority_keeps_the_contract_over_every_interface(table):
    interfaces, status, results = table
    assert {r["interface"] for r in results} == set(interfaces)
    failed = [f"{r['interface']}: {r['case']}: {r['observed']}" for r in results if r["passed"] is False]
    assert (failed, status) == ([], 0)


def test_most_misuses_can_be_tried_over_every_interface(table):
    for interface in table[0]:
        results = [r for r in table[2] if r["interface"] == interface]
        tried = [r["case"] for r in results if r["passed"] is not None]
        assert len(tried) > 45, interface
        assert len(set(tried)) == len(tried)
