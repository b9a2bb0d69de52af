# SPDX-License-Identifier: Apache-2.0
"""The client of a blackboard against a blackboard of our own: an OPC UA server with the methods of D-WIS."""

import asyncio
import contextlib
import json
import math
import re
import socket
import struct
import threading
from types import SimpleNamespace

import asyncua
import pytest
from example_rig import started, values
from waiting import eventually

from mwd_sensors.core.constants import CELSIUS_ZERO
from mwd_surface.rig.blackboard.client import Blackboard, BlackboardSettings
from mwd_surface.rig.input import RigInputSettings
from mwd_surface.rig.interface import Backoff, InterfaceError
from mwd_surface.rig.opcua.address_space import MANIFEST
from mwd_surface.signals.table import TO_RIG

ua = asyncua.ua
OTHERS = "http://ddhub.no/TopDrive/Variables/"


class Board:
    """A blackboard in a thread: it keeps what it was told, and knows a bit depth of somebody else."""

    def __init__(self):
        self.nodes, self.rig = {}, {}
        self.address = ""
        self._ready = threading.Event()
        self.forget()

    def forget(self):
        """No manifest was given yet; the next ones are taken."""
        self.manifests, self.answer, self.refuses = [], "", False

    @contextlib.contextmanager
    def served(self):
        thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)
        self._ready.clear()
        thread.start()
        assert self._ready.wait(120.0)
        try:
            yield self
        finally:
            self._loop.call_soon_threadsafe(self._stop.set)
            thread.join(10.0)

    def now(self, call, *arguments):
        """Result of a coroutine function, in the thread of the server."""
        return asyncio.run_coroutine_threadsafe(call(*arguments), self._loop).result(10.0)

    def value(self, name):
        return self.now(self.nodes[name].read_data_value, False)

    async def _serve(self):
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        self._server = server = asyncua.Server()
        await server.init()
        server.set_endpoint(self.address or "opc.tcp://127.0.0.1:0/")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        index = await server.register_namespace("http://ddhub.no/Blackboard")
        assert index == 2
        self._others = await server.register_namespace(OTHERS)
        board = await server.nodes.objects.add_object(ua.NodeId("DWIS", index), f"{index}:DWIS")
        for name, method in (("Inject", self._inject), ("ResolveQuery", self._resolve)):
            texts, text = (
                ua.Argument(Name=n, DataType=ua.NodeId(12), ValueRank=r) for n, r in (("in", 1), ("out", -1))
            )
            await board.add_method(ua.NodeId(name, index), f"{index}:{name}", asyncua.uamethod(method), [texts], [text])
        for noun, depth in (("BitDepth", 1234.5), ("HoleDepth", 1250.0)):
            at = ua.NodeId(noun, self._others)
            self.rig[noun] = await server.nodes.objects.add_variable(at, f"{self._others}:{noun}", depth)
        await server.start()
        self.address = f"opc.tcp://127.0.0.1:{server.bserver.port}/"
        self._ready.set()
        await self._stop.wait()
        await server.stop()

    async def _inject(self, _parent, texts):
        (text,) = texts
        table = json.loads(text)
        self.manifests.append(table)
        if self.answer:
            return self.answer
        if self.refuses:
            return json.dumps({"Success": False})
        index = await self._server.register_namespace(f"http://ddhub.no/{table['Provider']['Name']}/Variables/")
        made = []
        for variable in table["ProvidedVariables"]:
            name = variable["VariableID"]
            at = ua.NodeId(f"{MANIFEST}.{name}", index)
            if name not in self.nodes:
                self.nodes[name] = await self._server.nodes.objects.add_variable(at, f"{index}:{name}", 0.0)
                await self.nodes[name].set_writable()
            made.append({"ManifestItemID": name, "InjectedID": {"NameSpaceIndex": index, "ID": at.Identifier}})
        return json.dumps({"Success": True, "ProvidedVariables": made})

    async def _resolve(self, _parent, texts):
        noun = re.findall(r"rdf:type ddhub:(\w+)", texts[0])[0]
        rows = [
            {"Items": [{"NameSpace": f"http://ddhub.no/{MANIFEST}/Variables/", "ID": f"{MANIFEST}.BitMeasuredDepth"}]}
        ]
        rows = rows if noun == "BitDepth" else []
        return json.dumps({"Results": [*rows, {"Items": [{"NameSpace": OTHERS, "ID": noun}]}]})


@pytest.fixture(scope="module")
def served():
    """One server for all tests but that of a restart: its address space takes seconds to load."""
    with Board().served() as board:
        yield board


@pytest.fixture
def board(served):
    served.forget()
    return served


def client(board, on_rig_state=None, **changes):
    waits = Backoff(first=0.05, longest=0.2)
    return Blackboard(BlackboardSettings(url=board.address, period=0.1, backoff=waits, **changes), on_rig_state)


@pytest.mark.slow
def test_every_signal_is_written_with_its_number_status_and_time_and_again_only_when_it_has_changed(board):
    table = values()
    with started(client(board)) as one:
        one.publish(table)
        eventually(lambda: one.status().sent >= len(TO_RIG))
        for signal in TO_RIG:
            given, found = table.values[signal.name], board.value(signal.opcua)
            assert found.StatusCode.is_good() == given.condition.usable
            if given.condition.usable:
                number = given.value + (CELSIUS_ZERO if signal.unit == "degC" else 0.0)
                assert found.Value.Value == pytest.approx(number)
                assert found.SourceTimestamp.timestamp() == pytest.approx(given.stamp_ns * 1e-9, abs=1e-3)
        assert board.manifests[0]["Provider"]["Name"] == MANIFEST
        assert one.status().state == "connected"
        one.publish(table)
        sent = one.status().sent
        assert sent == len(TO_RIG)
        one.publish(values(later=0.5))
        eventually(lambda: one.status().sent > sent)
    # The blackboard outlives the client: no number stays there as a good one.
    assert [s.opcua for s in TO_RIG if board.value(s.opcua).StatusCode.is_good()] == []


@pytest.mark.slow
def test_a_blackboard_that_was_restarted_gets_the_manifest_again():
    board = Board()
    with board.served():
        one = client(board)
        one.start()
        one.publish(values())
        eventually(lambda: one.status().sent >= len(TO_RIG))
    try:
        eventually(lambda: one.status().state == "connecting" and one.status().reason)
        board.nodes.clear()
        with board.served():
            eventually(lambda: len(board.manifests) == 2 and one.status().state == "connected")
            eventually(lambda: one.status().sent >= 2 * len(TO_RIG))
    finally:
        one.stop()


def test_a_refused_manifest_is_said_and_tried_again(board):
    board.refuses = True
    with started(client(board)) as one:
        eventually(lambda: len(board.manifests) >= 2)
        assert "refused the manifest" in one.status().reason
        board.refuses = False
        eventually(lambda: one.status().state == "connected")


def test_depths_of_others_are_read_by_what_they_are_and_only_while_they_are_new(board):
    taken = []
    rig = RigInputSettings(accept=True, confirm=1)
    with started(client(board, taken.append, rig=rig)) as one:
        eventually(lambda: taken)
        assert float(taken[0]["bit_depth"][0]) == 1234.5
        assert float(taken[0]["hole_depth"][0]) == 1250.0
        board.now(board.rig["BitDepth"].write_value, 1235.0)
        eventually(lambda: len(taken) >= 2)
        # The hole depth was not written again: it is not of now.
        assert int(taken[1]["valid"][0]) == 1
        assert one.status().received == len(taken) == 2


def placed(namespace):
    """Answer to the manifest with every variable in this namespace."""
    row = '{{"ManifestItemID": "{}", "InjectedID": {{"NameSpaceIndex": {}, "ID": "x"}}}}'
    rows = ", ".join(row.format(signal.opcua, namespace) for signal in TO_RIG)
    return f'{{"Success": true, "ProvidedVariables": [{rows}]}}'


@pytest.mark.parametrize(
    "answer",
    [
        "nonsense",
        "[]",
        "[" * 50_000,
        '{"Success": true, "ProvidedVariables": [1]}',
        '{"Success": true}',
        '{"Success": "yes"',
        placed("1e999"),
        placed("1000000"),
        placed("-1"),
    ],
)
def test_an_answer_that_is_none_ends_in_a_sentence_and_another_try(board, answer):
    board.answer = answer
    with started(client(board)) as one:
        eventually(lambda: len(board.manifests) >= 2)
        assert one.status().reason
        board.answer = ""
        eventually(lambda: one.status().state == "connected")


class Bare:
    """The session with a blackboard that keeps numbers, and refuses status codes and times."""

    def __init__(self):
        self.has = {}

    async def write_values(self, nodes, given, raise_on_partial_error):
        assert not raise_on_partial_error
        codes = []
        for node, value in zip(nodes, given, strict=True):
            plain = value.StatusCode in (None, ua.StatusCode(0)) and value.SourceTimestamp is None
            codes.append(ua.StatusCode(0 if plain else ua.StatusCodes.BadWriteNotSupported))
            if plain:
                self.has[node] = value.Value.Value
        return codes


def test_a_blackboard_without_status_codes_has_only_numbers_that_may_be_used():
    """The last toolface of a lost tool stayed on it, as a good value."""
    one, session, sent = client(SimpleNamespace(address="opc.tcp://127.0.0.1:1/")), Bare(), {}
    one._asyncua = asyncua
    names = {signal.opcua: signal.opcua for signal in TO_RIG}
    for later in (0.0, 0.0, 2.5, 100.0):
        table = values(later=later)
        asyncio.run(one._write(session, names, table, sent))
    usable = {signal.opcua for signal in TO_RIG if table.values[signal.name].condition.usable}
    assert {name for name, number in session.has.items() if math.isfinite(number)} == usable
    assert {"Inclination", "GravityToolface"} - usable == {"GravityToolface"}


@pytest.mark.parametrize("url", ["http://x", "opc.tcp://", "opc.tcp://host", "opc.tcp://host:99999/", "opc.tcp://[::1"])
def test_an_address_that_is_none_is_refused_with_a_sentence(url):
    with pytest.raises(InterfaceError, match=r"write opc\.tcp"):
        Blackboard(BlackboardSettings(url=url)).start()


ACKNOWLEDGED = b"ACKF" + struct.pack("<6I", 28, 0, 65536, 65536, 0, 0)


@pytest.mark.parametrize(
    "answered",
    [
        lambda _hello: b"",
        lambda _hello: b"HTTP/1.1 400 Bad Request\r\n\r\n",
        lambda data: ACKNOWLEDGED if data.startswith(b"HEL") else data,
        lambda data: ACKNOWLEDGED if data.startswith(b"HEL") else b"OPNF" + struct.pack("<I", 108) + b"\x9f" * 100,
        lambda data: ACKNOWLEDGED if data.startswith(b"HEL") else b"MSGF" + struct.pack("<I", 0),
    ],
    ids=["nothing", "http", "echo", "garbage", "no length"],
)
def test_whatever_bytes_a_server_answers_with_the_client_tries_again(answered):
    with socket.create_server(("127.0.0.1", 0)) as server:
        asked = []

        def serve():
            # Ends with the server's socket.
            with contextlib.suppress(OSError):
                while True:
                    talk, _ = server.accept()
                    with talk, contextlib.suppress(OSError):
                        asked.append(1)
                        talk.settimeout(5.0)
                        while (data := talk.recv(65536)) and (answer := answered(data)):
                            talk.sendall(answer)

        threading.Thread(target=serve, daemon=True).start()
        waits = Backoff(first=0.05, longest=0.1)
        url = f"opc.tcp://127.0.0.1:{server.getsockname()[1]}/"
        with started(Blackboard(BlackboardSettings(url=url, timeout=0.5, backoff=waits))) as one:
            eventually(lambda: len(asked) >= 3)
            assert one.running
            assert one.status().reason
        server.shutdown(socket.SHUT_RDWR)
