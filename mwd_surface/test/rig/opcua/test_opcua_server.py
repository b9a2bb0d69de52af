# SPDX-License-Identifier: Apache-2.0
"""OPC UA as clients see it: found by name, with units and times, nothing to write, commands only for the trusted."""

import asyncio
import contextlib
import dataclasses
import datetime as dt
import itertools
import json
import math
import shutil
import socket
import subprocess
from pathlib import Path

import asyncua
import pytest
from example_rig import attitude, certified, started, values
from waiting import eventually

from mwd_estimation.core.status import Status
from mwd_surface.live.alarms import Alarm, Severity
from mwd_surface.rig.interface import InterfaceError
from mwd_surface.rig.opcua import access
from mwd_surface.rig.opcua.access import OpcuaSettings
from mwd_surface.rig.opcua.address_space import NAMESPACE, VARIABLES
from mwd_surface.rig.opcua.server import OpcuaServer

pytestmark = pytest.mark.slow

PEERS = Path(__file__).parents[2] / "peers"

ua = asyncua.ua


@pytest.fixture(scope="module")
def served():
    """One server for the tests that only read; its address space takes a second to load."""
    with started(OpcuaServer(OpcuaSettings(port=0), "Well 1")) as server:
        yield server


BEATS = itertools.count(1)
START_NS = 1_778_767_020 * 10**9


def publish(server, table):
    """Publish with a heartbeat of its own, and wait until that is written."""
    table = dataclasses.replace(table, heartbeat=next(BEATS))
    server.publish(table)
    eventually(lambda: any(v.startswith(f"{table.heartbeat} (") for k, v in server.status().last if k == "Heartbeat"))


run = asyncio.run


async def well_of(client):
    """The well, and the index of its namespace."""
    index = await client.get_namespace_index(NAMESPACE)
    return await client.nodes.objects.get_child(f"{index}:Well 1"), index


async def found(client, name):
    """A variable by its names alone, as D-WIS wants it."""
    well, index = await well_of(client)
    return await well.get_child(f"{index}:{name}")


def test_a_variable_is_found_by_name_and_tells_value_unit_and_time(served):
    table = values()
    publish(served, table)

    async def look():
        async with asyncua.Client(served.address) as client:
            node = await found(client, "Inclination")
            value = await node.read_data_value()
            unit = await (await node.get_child("0:EngineeringUnits")).read_value()
            level = await node.get_access_level()
            return value, unit, level

    value, unit, level = run(look())
    assert value.Value.Value == table.survey.value("inclination")
    assert value.StatusCode.is_good()
    assert value.SourceTimestamp.timestamp() == pytest.approx(table.survey.result.stamp_ns * 1e-9, abs=1e-5)
    assert (unit.UnitId, unit.DisplayName.Text) == (4405297, "rad")
    assert level == {ua.AccessLevel.CurrentRead, ua.AccessLevel.HistoryRead}


def test_the_well_has_a_type_whose_variables_it_has_and_numbers_have_units_by_type(served):
    async def look():
        async with asyncua.Client(served.address) as client:
            well, index = await well_of(client)
            kind = client.get_node(await well.read_type_definition())
            declared = {(await node.read_browse_name()).Name for node in await kind.get_variables()}
            owned = {(await node.read_browse_name()).Name for node in await well.get_variables()}
            azimuth, mode = await found(client, "Azimuth"), await found(client, "ToolfaceMode")
            kinds = [(await node.read_type_definition()).Identifier for node in (azimuth, mode)]
            # What a client shows that only browses.
            browsed = {one.NodeId: one.TypeDefinition.Identifier for one in await well.get_references()}
            kinds += [browsed[node.nodeid] for node in (azimuth, mode)]
            (shown,) = [one for one in await client.nodes.objects.get_references() if one.NodeId == well.nodeid]
            kinds += [shown.TypeDefinition == kind.nodeid]
            namespaces = client.get_node(ua.ObjectIds.Server_Namespaces)
            # The name is an address with slashes, which a path of names would be cut at.
            metadata = await namespaces.get_child([ua.QualifiedName(NAMESPACE, index)])
            uri = await (await metadata.get_child("0:NamespaceUri")).read_value()
            (endpoint, *_) = await client.get_endpoints()
            return declared, owned, kinds, uri, endpoint.Server.ProductUri

    declared, owned, kinds, uri, product = run(look())
    assert declared == owned == {variable.name for variable in VARIABLES}
    assert kinds == [*(ua.ObjectIds.AnalogUnitType, ua.ObjectIds.BaseDataVariableType) * 2, True]
    assert (uri, product) == (NAMESPACE, "urn:mwd:surface")


def test_every_value_is_confirmed_within_seconds_by_its_server_timestamp(served):
    async def stamps():
        async with asyncua.Client(served.address) as client:
            node = await found(client, "NorthReference")
            first = (await node.read_data_value()).ServerTimestamp
            await asyncio.sleep(1.2)
            await asyncio.to_thread(publish, served, values())
            return first, (await node.read_data_value()).ServerTimestamp

    first, last = run(stamps())
    assert last > first


def test_the_history_of_a_survey_variable_is_the_accepted_surveys(served):
    async def read():
        async with asyncua.Client(served.address) as client:
            node = await found(client, "Azimuth")
            return await node.read_raw_history(
                dt.datetime(2000, 1, 1, tzinfo=dt.UTC), dt.datetime(2100, 1, 1, tzinfo=dt.UTC)
            )

    table = values()
    for surveys in (table.surveys, table.surveys[:-1]):
        publish(served, dataclasses.replace(table, surveys=surveys))
        history = run(read())
        assert [value.Value.Value for value in history] == [survey.value("azimuth") for survey in surveys]
        assert [value.SourceTimestamp.timestamp() for value in history] == pytest.approx(
            [survey.result.stamp_ns * 1e-9 for survey in surveys], abs=1e-5
        )


def test_alarms_are_conditions_that_a_late_client_asks_for(served):
    class Handler:
        def __init__(self):
            self.events = []

        def event_notification(self, event):
            self.events.append(event)

    alarm = Alarm("survey.azimuth", Severity.CRITICAL, "steel nearby", "move the sensor", START_NS, START_NS)
    seen = dataclasses.replace(alarm, acknowledged=True, acknowledged_by="Ann")

    async def follow():
        async with asyncua.Client(served.address) as client:
            well, _ = await well_of(client)
            early, late = Handler(), Handler()
            subscription = await client.create_subscription(50, early)
            await subscription.subscribe_events(well, ua.ObjectIds.AlarmConditionType)
            for alarms in ((alarm,), (dataclasses.replace(alarm, count=2),), (seen,)):
                await asyncio.to_thread(publish, served, dataclasses.replace(values(), alarms=alarms))
            again = await client.create_subscription(50, late)
            await again.subscribe_events(well, ua.ObjectIds.AlarmConditionType)
            condition = client.get_node(ua.ObjectIds.ConditionType)
            identifier = ua.Variant(again.subscription_id, ua.VariantType.UInt32)
            await condition.call_method(ua.NodeId(ua.ObjectIds.ConditionType_ConditionRefresh), identifier)
            await asyncio.to_thread(publish, served, values())
            async with asyncio.timeout(10.0):
                while len(early.events) < 3 or len(late.events) < 2:
                    await asyncio.sleep(0.05)
            return early.events, late.events

    early, late = run(follow())
    facts = [
        (e.ConditionName, e.Severity, *(getattr(e, f"{state}State/Id") for state in ("Active", "Acked")), e.Retain)
        for e in early
    ]
    assert facts == [
        ("survey.azimuth", 900, True, False, True),
        ("survey.azimuth", 900, True, True, True),
        ("survey.azimuth", 900, False, True, False),
    ]
    assert early[0].Message.Text == "steel nearby; move the sensor"
    assert [e.Retain for e in late] == [True, False]


def test_a_history_that_hangs_or_fails_does_not_hold_up_the_values():
    async def hang(_surveys):
        await asyncio.sleep(3600.0)

    async def fail(_surveys):
        raise RuntimeError("no memory")

    for show in (hang, fail):
        with started(OpcuaServer(OpcuaSettings(port=0), "Well 1")) as server:
            server._history.show = show
            for _ in range(3):
                publish(server, values())
            if show is fail:
                eventually(lambda s=server: dict(s.status().counts)["errors of history and conditions"] > 0)


def test_status_codes_follow_the_state_and_a_last_usable_value_is_still_published(served):
    async def read(name):
        async with asyncua.Client(served.address) as client:
            return await (await found(client, name)).read_data_value(False)

    codes = ua.StatusCodes
    for table, name, code in (
        (values(sample=attitude(Status.ROTATING)), "GravityToolface", codes.UncertainSensorNotAccurate),
        (values(later=60.0), "GravityToolface", codes.BadNoCommunication),
        (values(sample=attitude(Status.SENSOR_FAULT)), "ToolTemperature", codes.BadSensorFailure),
        (values(), "DistanceToPlan", codes.BadWaitingForInitialData),
        (values(active=False), "Inclination", codes.BadOutOfService),
        (values(later=2.0), "BitMeasuredDepth", codes.UncertainLastUsableValue),
    ):
        publish(served, table)
        got = run(read(name))
        assert got.StatusCode.value == code
    assert got.Value.Value == 650.25


def test_a_subscriber_gets_changes(served):
    publish(served, values())

    async def watch():
        got = asyncio.Queue()

        class Handler:
            def datachange_notification(self, _node, value, _data):
                got.put_nowait(value)

        async with asyncua.Client(served.address) as client:
            subscription = await client.create_subscription(50, Handler())
            await subscription.subscribe_data_change(await found(client, "Heartbeat"))
            first = await asyncio.wait_for(got.get(), 10.0)
            await asyncio.to_thread(publish, served, values(later=1.0))
            second = await asyncio.wait_for(got.get(), 10.0)
            await subscription.delete()
        return first, second

    first, second = run(watch())
    assert second == first + 1


def test_nothing_can_be_written_and_no_method_is_offered(served):
    async def attempt():
        async with asyncua.Client(served.address) as client:
            node = await found(client, "Inclination")
            with pytest.raises(ua.UaStatusCodeError) as error:
                await node.write_value(1.0)
            well, index = await well_of(client)
            with pytest.raises(ua.UaStatusCodeError):
                await well.get_child(f"{index}:take_survey")
            with pytest.raises(ua.UaStatusCodeError):
                await client.nodes.objects.add_object(index, "intruder")
            return error.value.code

    assert run(attempt()) in (ua.StatusCodes.BadUserAccessDenied, ua.StatusCodes.BadNotWritable)


@pytest.mark.fault_case(90)
def test_subscriptions_are_limited(served):
    async def many():
        async with asyncua.Client(served.address) as client:
            made = 0
            with contextlib.suppress(ua.UaStatusCodeError):
                for _ in range(200):
                    await client.create_subscription(1000, None)
                    made += 1
            return made

    assert run(many()) <= 64
    eventually(lambda: dict(served.status().counts)["subscriptions"] == 0)


def _every(interval_ms):
    """Return the request of a subscription with any publishing interval."""
    asked = ua.CreateSubscriptionParameters()
    asked.RequestedPublishingInterval = interval_ms
    asked.RequestedLifetimeCount, asked.RequestedMaxKeepAliveCount = 10_000, 3000
    asked.PublishingEnabled = True
    return asked


async def _watch(client, subscription, count, queue=2**31):
    """Ask for monitored items of one variable, each with the longest queue; returns ids and status codes."""
    asked = ua.CreateMonitoredItemsParameters()
    asked.SubscriptionId = subscription.subscription_id
    asked.TimestampsToReturn = ua.TimestampsToReturn.Both
    for handle in range(count):
        item = ua.MonitoredItemCreateRequest()
        item.ItemToMonitor = ua.ReadValueId(ua.NodeId(ua.ObjectIds.Server_ServerStatus_CurrentTime))
        item.ItemToMonitor.AttributeId = ua.AttributeIds.Value
        item.MonitoringMode = ua.MonitoringMode.Reporting
        item.RequestedParameters.ClientHandle = handle
        item.RequestedParameters.QueueSize = queue
        asked.ItemsToCreate.append(item)
    return await client.uaclient.create_monitored_items(asked)


@pytest.mark.fault_case(90)
def test_monitored_items_and_their_queues_are_limited_and_free_their_place(served, monkeypatch):
    """46 000 items of one client without a certificate held the server up for minutes."""
    monkeypatch.setattr(access, "MOST_ITEMS", 50)

    async def attempt():
        async with asyncua.Client(served.address) as client:
            first = await client.create_subscription(_every(1e-6), None)
            made = await _watch(client, first, 40)
            assert all(result.StatusCode.is_good() for result in made)
            assert all(result.RevisedQueueSize <= access.LONGEST_QUEUE for result in made)
            second = await client.create_subscription(_every(math.nan), None)
            # asyncua gives the publishing interval of the subscription as the revised sampling interval.
            assert all(result.RevisedSamplingInterval == access.SHORTEST_MS for result in made)
            codes = [result.StatusCode.value for result in await _watch(client, second, 30)]
            assert codes.count(0) == 10
            assert set(codes[10:]) == {ua.StatusCodes.BadTooManyMonitoredItems}
            change = ua.ModifyMonitoredItemsParameters()
            change.SubscriptionId = first.subscription_id
            item = ua.MonitoredItemModifyRequest()
            item.MonitoredItemId = made[0].MonitoredItemId
            item.RequestedParameters.QueueSize = 2**31
            change.ItemsToModify.append(item)
            (changed,) = await client.uaclient.modify_monitored_items(change)
            assert changed.RevisedQueueSize <= access.LONGEST_QUEUE
            await first.delete()
            again = await _watch(client, second, 30)
            assert all(result.StatusCode.is_good() for result in again)

    run(attempt())
    eventually(lambda: dict(served.status().counts)["monitored items"] == 0)


def test_junk_and_idle_connections_leave_the_others_alone(served):
    with socket.create_connection(("127.0.0.1", served.port)) as bad:
        bad.sendall(b"GET / HTTP/1.1\r\n\r\n" + b"\xff" * 5000)
        publish(served, values())
        test_a_variable_is_found_by_name_and_tells_value_unit_and_time(served)


def test_five_hundred_connections_are_turned_away_counted_and_leave_those_that_are_served_alone():
    with (
        started(OpcuaServer(OpcuaSettings(port=0, max_clients=2), "Well 1")) as server,
        contextlib.ExitStack() as stack,
    ):
        publish(server, values())

        async def read_meanwhile():
            async with asyncua.Client(server.address) as client:
                variable = await found(client, "Inclination")
                for _ in range(500):
                    connection = socket.create_connection(("127.0.0.1", server.port), 5.0)
                    stack.callback(connection.close)
                return await variable.read_value()

        assert run(read_meanwhile()) == values().survey.value("inclination")
        eventually(lambda: server.status().refused >= 499)


def test_node_opcua_reads_the_same(served):
    node = shutil.which("node")
    if node is None or not (PEERS / "node_modules" / "node-opcua-client").exists():
        pytest.skip("node or node-opcua-client is not there: npm install --prefix mwd_surface/test/peers")
    publish(served, values(later=2.0))
    done = subprocess.run(
        [node, str(PEERS / "opcua_read.js"), served.address, NAMESPACE, "Well 1", "Inclination", "BitMeasuredDepth"],
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    inclination, depth = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("[{")))
    table = values(later=2.0)
    assert inclination["value"] == table.survey.value("inclination")
    assert inclination["status"] == "Good"
    assert (inclination["unit"], depth["unit"]) == ("rad", "m")
    assert (depth["value"], depth["status"]) == (650.25, "UncertainLastUsableValue")
    assert inclination["source"] * 1_000_000 == pytest.approx(table.survey.result.stamp_ns, abs=1_000_000)


@contextlib.asynccontextmanager
async def secure(server, certificate, key, own, uri):
    client = asyncua.Client(server.address)
    client.application_uri = uri
    await client.set_security(
        asyncua.crypto.security_policies.SecurityPolicyBasic256Sha256,
        str(certificate),
        str(key),
        server_certificate=str(own),
    )
    async with client:
        yield client


@pytest.mark.filterwarnings("ignore::cryptography.utils.CryptographyDeprecationWarning")
def test_commands_need_a_trusted_certificate(tmp_path):
    from cryptography import x509

    asked = []

    def on_command(name, arguments):
        asked.append((name, arguments))
        return (False, "no such survey") if name == "reject_survey" else (True, "asked")

    trusted = tmp_path / "trusted"
    trusted.mkdir()
    good = run(certified(tmp_path, "controller"))
    bad = run(certified(tmp_path, "stranger"))
    shutil.copy(good[0], trusted)
    settings, duration = OpcuaSettings(port=0, allow_commands=True), ua.Variant(30.0, ua.VariantType.Double)
    with started(OpcuaServer(settings, "Well 1", on_command, tmp_path)) as server:
        assert (tmp_path / "own.pem").stat().st_mode & 0o077 == 0

        async def call(client, name, *arguments):
            well, index = await well_of(client)
            return await well.call_method(f"{index}:{name}", *arguments)

        async def refused(client):
            async with client:
                with pytest.raises(ua.UaStatusCodeError) as error:
                    await call(client, "take_survey", duration)
                return error.value.code

        async def as_trusted():
            async with secure(server, *good, tmp_path / "own.der", "urn:test:controller") as client:
                one = await call(client, "take_survey", duration)
                number = ua.Variant(7, ua.VariantType.UInt32)
                two = await call(client, "reject_survey", number, "Bo", "casing")
                with pytest.raises(ua.UaStatusCodeError):
                    await call(client, "take_survey")
                return one, two

        async def as_anybody():
            return await refused(asyncua.Client(server.address))

        async def as_impostor():
            """Shows the trusted certificate, but on a channel that proves nothing."""
            client = asyncua.Client(server.address)
            shown = x509.load_der_x509_certificate(good[0].read_bytes())
            client.security_policy = asyncua.crypto.security_policies.SecurityPolicyNone(host_cert=shown)
            return await refused(client)

        async def as_stranger():
            with pytest.raises((ua.UaStatusCodeError, ConnectionError)):
                async with secure(server, *bad, tmp_path / "own.der", "urn:test:stranger"):
                    asked.append("a stranger came in")

        assert run(as_trusted()) == ([True, "asked"], [False, "no such survey"])
        assert run(as_anybody()) == ua.StatusCodes.BadUserAccessDenied
        assert run(as_impostor()) == ua.StatusCodes.BadUserAccessDenied
        run(as_stranger())
    assert asked == [
        ("take_survey", {"duration": 30.0}),
        ("reject_survey", {"sequence": 7, "operator_name": "Bo", "reason": "casing"}),
    ]


@pytest.mark.fault_case(90)
def test_where_anonymous_reading_is_off_nobody_comes_in_without_a_certificate(tmp_path):
    with started(OpcuaServer(OpcuaSettings(port=0, anonymous=False), "Well 1", folder=tmp_path)) as server:

        async def attempt():
            with pytest.raises((ua.UaError, ConnectionError, TimeoutError)):
                async with asyncua.Client(server.address, timeout=3):
                    return True
            return False

        assert run(attempt()) is False


def test_missing_certificates_are_named():
    with pytest.raises(InterfaceError, match="certificates"):
        OpcuaServer(OpcuaSettings(port=0, anonymous=False)).start()
