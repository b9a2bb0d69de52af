# SPDX-License-Identifier: Apache-2.0
"""The page's server: what changed goes out, nothing unasked comes in, and nobody can hold it up."""

import asyncio
import concurrent.futures
import contextlib
import http.client
import itertools
import json
import socket
import struct
import threading
import time
from urllib.parse import urlsplit

import aiohttp
import pytest
from aiohttp import web
from example_live import ShownState
from hypothesis import given
from hypothesis import strategies as st
from waiting import eventually

from mwd_sensors.core import wire
from mwd_sensors.core.settings import flat
from mwd_surface.live.well_state import NodeDiagnostic
from mwd_surface.page.commands import COMMANDS, SecretAccess, checked_arguments, read_token
from mwd_surface.page.page_server import PageServer
from mwd_surface.page.settings import PageSettings

TOKEN = "drill-baby-drill"  # noqa: S105
JSON = {"Content-Type": "application/json"}


@contextlib.contextmanager
def running(on_command=None, token="", **settings):
    server = PageServer(PageSettings(port=0, **settings), on_command, token=token)
    server.start()
    try:
        yield server
    finally:
        server.stop()


def attitude(inclination):
    samples = wire.ATTITUDE.empty(1)
    samples["inclination"] = inclination
    return samples


def ask(server, path="/", method="GET", body=None, headers=None):
    place = urlsplit(server.address)
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=20)
    try:
        connection.request(method, path, body, headers or {})
        answer = connection.getresponse()
        return answer.status, answer.read(), dict(answer.getheaders())
    finally:
        connection.close()


def order(server, name, arguments, token=TOKEN, **headers):
    body = json.dumps(arguments) if not isinstance(arguments, (str, bytes)) else arguments
    head = {**JSON, **({"Authorization": f"Bearer {token}"} if token else {}), **headers}
    status, answer, _ = ask(server, f"/command/{name}", "POST", body, head)
    return status, json.loads(answer)


def watch(server, talk, **options):
    """Run `await talk(socket)` against the live address."""

    async def main():
        place = server.address.replace("http", "ws") + "live"
        async with aiohttp.ClientSession() as session, session.ws_connect(place, **options) as ws:
            return await asyncio.wait_for(talk(ws), 60)

    return asyncio.run(main())


def connected(server, receive_buffer=None, seconds=30.0):
    """A bare connection to the server."""
    place, connection = urlsplit(server.address), socket.socket()
    if receive_buffer is not None:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
    connection.settimeout(seconds)
    connection.connect((place.hostname, place.port))
    return connection


def raw_watcher(server, **options):
    """A connection that has asked for the live state, and speaks no protocol from then on."""
    watcher = connected(server, **options)
    watcher.sendall(
        b"GET /live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    )
    eventually(lambda: server.clients == 1)
    return watcher


@contextlib.contextmanager
def commanded(**settings):
    """A server with a token, and the list of the commands that reach its node."""
    calls = []

    def on_command(*command):
        calls.append(command)
        return True, "done"

    with running(on_command, token=TOKEN, **settings) as server:
        yield server, calls


@pytest.fixture(scope="module")
def served():
    """One commanded server for the requests that it refuses."""
    with commanded() as made:
        yield made


async def sections_until(ws, name):
    while True:
        message = json.loads((await ws.receive()).data)
        if name in message["sections"]:
            return message


def test_the_page_and_all_it_needs_come_from_here_under_a_strict_policy():
    with running() as server:
        status, body, headers = ask(server)
        assert status == 200
        assert headers["Content-Security-Policy"].startswith("default-src 'self';")
        assert headers["X-Content-Type-Options"] == "nosniff"
        text = body.decode()
        assert "http://" not in text
        assert "https://" not in text
        for name in ("main.js", "page.css", "vendor/uPlot.iife.min.js", "vendor/uPlot-LICENSE.txt"):
            assert ask(server, "/" + name)[0] == 200
        assert ask(server, "/main.js")[2]["Content-Type"].startswith("text/javascript")


@pytest.mark.fault_case(95)
def test_state_json_is_the_last_state_and_says_so_while_there_is_none():
    with running() as server:
        empty = json.loads(ask(server, "/state.json")[1])
        assert (empty["sections"], empty["server"]["ready"]) == ({}, False)
        state = ShownState()
        state.on_attitude(attitude(0.7), 1.0)
        server.push(state.snapshot(1.5))
        full = json.loads(ask(server, "/state.json")[1])
        assert full["sections"]["attitude"]["inclination"]["value"] == 0.7
        assert full["sections"]["attitude"]["inclination"]["age"] == 0.5
        facts = {"controls": False, "exports": [], "clients": 0, "skipped": 0, "ready": True, "time_zone": ""}
        assert full["server"] == facts


def test_what_the_server_says_of_a_state_is_said_with_that_state():
    with running() as server:
        done = threading.Event()

        def play():
            for at in itertools.count():
                section = {"value": float(at)}
                replay = {"replay": {"at": float(at)}}
                server.push({"now": 0.0, "revisions": {"depth": at}, "sections": {"depth": section}, "server": replay})
                if done.wait(0.0):
                    return

        player = threading.Thread(target=play)
        player.start()
        try:
            for _ in range(200):
                shown = json.loads(ask(server, "/state.json")[1])
                if shown["server"]["ready"]:
                    assert shown["sections"]["depth"]["value"] == shown["server"]["replay"]["at"]
        finally:
            done.set()
            player.join()


def test_a_state_that_cannot_be_sent_ends_the_connection_and_the_next_one_serves():
    async def end(ws):
        server.push({"now": 0.0, "revisions": {"a": 1}, "sections": {"a": {"value": float("nan")}}})
        while (message := await ws.receive()).type == aiohttp.WSMsgType.TEXT:
            assert "a" not in json.loads(message.data)["sections"]
        return message.type

    async def begin(ws):
        return json.loads((await ws.receive()).data)["sections"]

    with running() as server:
        assert watch(server, end) in (aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.ERROR)
        server.push({"now": 0.0, "revisions": {"a": 2}, "sections": {"a": {"value": 1.0}}})
        assert watch(server, begin) == {"a": {"value": 1.0}}


def test_a_watcher_gets_all_first_then_only_what_changed():
    state = ShownState()
    with running() as server:
        server.push(state.snapshot(0.0))

        async def talk(ws):
            first = json.loads((await ws.receive()).data)
            assert {"attitude", "surveys", "alarms"} <= set(first["sections"])
            for k in range(5):
                state.on_attitude(attitude(0.1 * (k + 1)), 0.0)
                server.push(state.snapshot(0.0))
                news = await sections_until(ws, "attitude")
                assert news["sections"]["attitude"]["inclination"]["value"] == pytest.approx(0.1 * (k + 1))
                assert "surveys" not in news["sections"]

        watch(server, talk)


def test_when_nothing_changes_there_is_a_beat_a_second_and_nothing_else():
    with running() as server:
        snapshot = ShownState().snapshot(0.0)
        server.push(snapshot)

        async def talk(ws):
            await ws.receive()
            started = time.monotonic()
            for _ in range(20):
                server.push(snapshot)
            beat = json.loads((await ws.receive()).data)
            return beat["sections"], time.monotonic() - started

        sections, after = watch(server, talk)
        assert sections == {}
        assert after > 0.7


@pytest.mark.fault_case(95)
def test_the_history_goes_out_whole_once_and_then_by_new_rows():
    state = ShownState()
    for k in range(5):
        state.on_attitude(attitude(0.5), float(k))
    with running() as server:
        server.push(state.snapshot(4.0))

        async def talk(ws):
            first = await sections_until(ws, "history")
            state.on_attitude(attitude(0.5), 5.0)
            server.push(state.snapshot(5.0))
            return first["sections"]["history"], (await sections_until(ws, "history"))["sections"]["history"]

        whole, more = watch(server, talk)
        assert (whole["whole"], len(whole["rows"])) == (True, 4)
        assert (more["whole"], [row[0] for row in more["rows"]]) == (False, [5.0])


def test_a_rate_that_nobody_can_read_is_thinned_to_the_rate_of_the_page():
    state = ShownState()
    with running(max_rate=10.0) as server:

        async def talk(ws):
            count, end = 0, time.monotonic() + 1.0
            while time.monotonic() < end:
                state.on_attitude(attitude(0.5), time.monotonic())
                server.push(state.snapshot(time.monotonic()))
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(ws.receive(), 0.005)
                    count += 1
            return count

        assert 1 <= watch(server, talk) <= 13


@pytest.mark.fault_case(78)
def test_a_watcher_that_reads_nothing_is_dropped_without_memory_growing_or_others_waiting():
    state = ShownState()
    big = {"x" * 50: ["y" * 1000] * 400}
    with running(send_timeout=0.3) as server:
        server.push({"now": 0.0, "sections": {"a": big}, "revisions": {"a": 0}})
        lazy = raw_watcher(server, receive_buffer=4096)
        revision = 0

        def gone():
            nonlocal revision
            revision += 1
            server.push({"now": 0.0, "sections": {"a": big}, "revisions": {"a": revision}})
            return server.clients == 0

        eventually(gone)
        lazy.close()
        server.push(state.snapshot(0.0))
        assert ask(server, "/state.json")[0] == 200


# Frames from a browser, masked with zeros: first the start of a text (or nothing), then the frame that is repeated.
_ENDLESS = {
    "empty parts of a text": (b"\x01\x80\0\0\0\0", b"\x00\x80\0\0\0\0"),
    "parts of a text between answers": (b"\x01\x80\0\0\0\0", b"\x8a\x80\0\0\0\0\x00\x80\0\0\0\0"),
    "pings": (b"", b"\x89\x80\0\0\0\0"),
    "answers to no ping": (b"", b"\x8a\x80\0\0\0\0"),
}


@pytest.mark.parametrize("kind", _ENDLESS)
def test_a_watcher_that_sends_frames_without_end_is_cut(kind):
    first, then = _ENDLESS[kind]
    with running() as server:
        with raw_watcher(server) as endless:

            def send_on():
                endless.sendall(first)
                for _ in range(10_000):
                    endless.sendall(then * 1000)

            with pytest.raises(OSError, match=r"reset|[Bb]roken"):
                send_on()
            eventually(lambda: server.clients == 0)
        assert ask(server)[0] == 200


def test_watchers_beyond_the_limit_are_refused_politely():
    with running(max_clients=1) as server:

        async def talk(ws):
            await ws.receive()
            async with aiohttp.ClientSession() as session:
                with pytest.raises(aiohttp.WSServerHandshakeError) as error:
                    await session.ws_connect(server.address.replace("http", "ws") + "live")
                return error.value.status

        assert watch(server, talk) == 503


def test_a_watcher_that_talks_is_shown_out():
    with running() as server:

        async def talk(ws):
            await ws.send_str("let me in")
            while True:
                message = await ws.receive()
                if message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.CLOSING):
                    return True

        assert watch(server, talk)


@pytest.mark.fault_case(76)
def test_half_open_connections_deny_nobody_the_page():
    with running(max_per_peer=6, max_connections=8, request_timeout=30.0) as server:
        crowd = [connected(server) for _ in range(30)]
        # Their own request would be given up after 30 s, what is asked meanwhile after 20.
        assert [ask(server)[0] for _ in range(5)] == [200] * 5
        for s in crowd:
            s.close()


@pytest.mark.fault_case(76)
def test_one_address_cannot_take_all_connections():
    with running(max_per_peer=2, max_connections=20) as server:

        async def talk(ws):
            await ws.receive()
            async with aiohttp.ClientSession() as session:
                other = await session.ws_connect(server.address.replace("http", "ws") + "live")
                await other.receive()
                third = await asyncio.to_thread(ask, server)
                await other.close()
            return third[0]

        assert watch(server, talk) == 503
        assert server.refused == 1


@pytest.mark.fault_case(78)
def test_a_watcher_that_reads_late_gets_the_newest_state_and_how_many_it_missed():
    with running(max_rate=20.0) as server:

        def push(k):
            server.push({"now": 0.0, "sections": {"a": {"k": k}}, "revisions": {"a": k}})

        async def talk(session_socket):
            read = []

            async def pause():
                for k in range(60):
                    push(k)
                    await asyncio.sleep(0.03)

            push(0)
            await session_socket.receive()
            # The library answers pings only while somebody reads.
            await pause()
            while not read or read[-1]["sections"].get("a", {}).get("k") != 59:
                read.append(json.loads((await session_socket.receive()).data))
            return read

        read = watch(server, talk)
        assert len(read) <= 6
        assert read[-1]["server"]["skipped"] >= 1


@pytest.mark.fault_case(77)
def test_a_request_that_never_ends_is_cut_while_others_are_served():
    with running(request_timeout=0.3) as server, connected(server) as slow:
        slow.sendall(b"GET / HTTP/1.1\r\nHost: ")
        assert ask(server)[0] == 200
        with contextlib.suppress(ConnectionResetError):
            assert slow.recv(10) == b""


@contextlib.contextmanager
def playing_a_recording(**settings):
    asked = []
    server = PageServer(PageSettings(port=0, **settings), on_replay=asked.append)
    server.start()
    try:
        yield server, asked
    finally:
        server.stop()


def never_ends(server, path, head=""):
    """Answer to a request whose body never ends."""
    with connected(server) as slow:
        slow.sendall(
            f"POST {path} HTTP/1.1\r\nHost: localhost\r\n{head}"
            "Content-Type: application/json\r\nContent-Length: 50\r\n\r\n{".encode()
        )
        return slow.recv(12)


@pytest.mark.fault_case(77)
def test_a_command_or_a_request_to_play_whose_body_never_ends_is_cut():
    with commanded(request_timeout=0.3) as (server, calls):
        assert never_ends(server, "/command/stop_recording", f"Authorization: Bearer {TOKEN}\r\n") == b"HTTP/1.1 408"
    with playing_a_recording(request_timeout=0.3) as (server, asked):
        assert never_ends(server, "/replay") == b"HTTP/1.1 408"
    assert calls == asked == []


@pytest.mark.fault_case(79)
@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("[" * 10_000, "not JSON"),
        ('{"seek": 1' + "0" * 400 + "}", "seek: expected a number"),
        ('{"rate": NaN}', "not JSON"),
        ('{"rate": true}', "rate: expected a number"),
        ('{"playing": 1}', "playing: expected true or false"),
        ('{"seek": -1}', "seek: expected a number"),
        ("[]", "must be a JSON object"),
        ('{"speed": 1}', "a JSON object with playing, rate and seek"),
        (b"\xff\xfe", "not JSON"),
    ],
)
def test_a_malformed_request_to_play_is_refused_with_the_field(body, words):
    with playing_a_recording() as (server, asked):
        status, answer, _ = ask(server, "/replay", "POST", body, JSON)
        assert status == 400
        assert words in json.loads(answer)["message"]
        assert ask(server, "/replay", "POST", '{"seek": 3, "playing": true}', JSON)[0] == 200
        assert asked == [{"seek": 3, "playing": True}]


def test_requests_that_are_none_leave_no_line_in_the_log(caplog):
    with running() as server:
        for junk in (b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", b"\x16\x03\x01\x02\x00\r\n\r\n"):
            with connected(server) as connection:
                connection.sendall(junk)
                assert connection.recv(12).startswith(b"HTTP/1.")
        assert ask(server)[0] == 200
    assert caplog.records == []


@pytest.mark.fault_case(81)
@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "[::1", "localhost.evil"]
)
def test_a_name_that_may_be_rebound_to_us_is_refused(served, host):
    assert ask(served[0], headers={"Host": host})[0] in (400, 421)


def test_addresses_localhost_and_configured_names_are_answered():
    with running(allowed_hosts=("rig12.local",)) as server:
        for host in ("127.0.0.1", "localhost:99", "[::1]:80", "10.1.2.3:8080", "Rig12.local:8080"):
            assert ask(server, headers={"Host": host})[0] == 200


@pytest.mark.fault_case(81)
def test_another_site_can_neither_watch_nor_command():
    with commanded() as (server, calls):
        status, answer = order(server, "stop_recording", {}, Origin="http://evil.example")
        assert status == 403
        assert "other sites" in answer["message"]

        async def talk(_ws):
            return None

        with pytest.raises(aiohttp.WSServerHandshakeError) as error:
            watch(server, talk, headers={"Origin": "http://evil.example"})
        assert error.value.status == 403
        assert calls == []
        own = server.address.rstrip("/")
        assert order(server, "stop_recording", {}, Origin=own)[0] == 200


@pytest.mark.fault_case(80)
@pytest.mark.parametrize(
    "path", ["/../page_server.py", "/%2e%2e/page_server.py", "/vendor/..%2f..%2fwell.py", "//etc/passwd"]
)
def test_nothing_outside_the_page_can_be_asked_for(served, path):
    status, body, _ = ask(served[0], path)
    assert status == 404
    assert b"import" not in body


def test_without_a_token_configured_every_command_is_refused():
    with running(lambda _n, _a: (True, "")) as server:
        status, answer = order(server, "stop_recording", {})
        assert status == 403
        assert "read-only" in answer["message"]


@pytest.mark.parametrize("token", ["", "wrong", TOKEN + "x", TOKEN[:-1]])
def test_a_missing_or_wrong_token_is_refused(token):
    with commanded() as (server, calls):
        assert order(server, "stop_recording", {}, token=token)[0] == 401
        assert calls == []


def test_a_command_with_the_token_reaches_the_node_and_its_answer_or_error_comes_back():
    calls = []

    def act(name, arguments):
        calls.append((name, arguments))
        if name == "reject_survey":
            raise ValueError("survey 9 is not in the list")
        return (name != "take_survey", f"{name} done")

    with running(act, token=TOKEN) as server:
        given_ = {"sequence": 4, "operator_name": "A. Berg", "reason": "gyro agrees", "measured_depth": 1200}
        assert order(server, "accept_survey", given_) == (200, {"ok": True, "message": "accept_survey done"})
        assert order(server, "take_survey", {}) == (409, {"ok": False, "message": "take_survey done"})
        assert calls == [("accept_survey", {**given_, "measured_depth": 1200.0}), ("take_survey", {})]
        status, answer = order(server, "reject_survey", {"sequence": 9, "operator_name": "B"})
        assert (status, answer["message"]) == (409, "survey 9 is not in the list")


def test_a_node_that_does_not_answer_gives_the_browser_a_sentence_and_blocks_nobody_who_watches():
    free = threading.Event()
    with running(lambda _n, _a: (free.wait(5), "")[::1], token=TOKEN, command_timeout=0.5) as server:
        status, answer = order(server, "take_survey", {})
        assert status == 504
        assert "has not finished" in answer["message"]
        assert ask(server)[0] == 200
        free.set()


@pytest.mark.fault_case(79)
@pytest.mark.parametrize(
    ("name", "body", "status", "words"),
    [
        ("explode", "{}", 404, "unknown command"),
        ("accept_survey", "{", 400, "not JSON"),
        ("accept_survey", "[" * 10_000, 400, "not JSON"),
        ("accept_survey", "[]", 400, "object"),
        ("accept_survey", '{"sequence": "4", "operator_name": "A"}', 400, "sequence: expected int"),
        ("accept_survey", '{"sequence": true, "operator_name": "A"}', 400, "sequence: expected int"),
        ("accept_survey", '{"sequence": -1, "operator_name": "A"}', 400, "sequence: must be within"),
        ("accept_survey", '{"sequence": 4}', 400, "operator_name: must be given"),
        ("accept_survey", '{"sequence": 4, "operator_name": "  "}', 400, "operator_name: must not be empty"),
        ("accept_survey", '{"sequence": 4, "operator_name": "A", "measured_depth": NaN}', 400, "NaN is not a number"),
        ("accept_survey", '{"sequence": 4, "operator_name": "A", "measured_depth": 1e999}', 400, "measured_depth"),
        ("accept_survey", '{"sequence": 4, "operator_name": "A\\nB"}', 400, "operator_name"),
        ("stop_recording", '{"path": "/etc"}', 400, "no arguments"),
        ("export", '{"format": "csv", "name": "../x"}', 400, "name: is a path"),
        ("export", '{"format": "csv", "name": "/etc/x"}', 400, "name: is a path"),
        ("export", '{"format": "csv", "name": ".."}', 400, "name: is a path"),
        ("start_recording", '{"name": "a/b"}', 400, "name: is a path"),
        ("take_survey", '{"duration": "' + "9" * 600 + '"}', 400, "duration: expected float"),
        ("start_recording", '{"name": "' + "a" * 20_000 + '"}', 413, ""),
        ("start_recording", b"\xff\xfe", 400, "not JSON"),
    ],
)
def test_a_malformed_command_is_refused_with_the_field_and_never_reaches_the_node(served, name, body, status, words):
    server, calls = served
    got, answer = order(server, name, body)
    assert got == status
    assert words in answer["message"]
    assert calls == []


@pytest.mark.parametrize("change", [1, -1])
def test_both_rod_buttons_of_the_page_give_accepted_arguments(change):
    given = {"operator_name": "Li", "change": change}
    assert checked_arguments("count_rods", json.dumps(given).encode()) == given


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("count_rods", {"change": -2}),
        ("count_rods", {"change": 2}),
        ("count_rods", {"count": -1}),
        ("judge_control", {"decision": -1}),
        # A larger number does not fit the field of the service.
        ("judge_control", {"decision": 256}),
        ("decide_downlink", {"decision": 0, "number": 2**32}),
        ("accept_survey", {"sequence": 1, "value": 256}),
    ],
)
def test_a_number_outside_the_range_of_its_field_is_refused(name, given):
    with pytest.raises(web.HTTPBadRequest) as refused:
        checked_arguments(name, json.dumps({"operator_name": "Li", **given}).encode())
    assert str(refused.value.text).startswith(list(given)[-1])


def test_a_command_as_a_form_or_by_get_is_refused(served):
    server, calls = served
    assert order(server, "stop_recording", "{}", **{"Content-Type": "text/plain"})[0] == 415
    assert ask(server, "/command/stop_recording")[0] == 405
    assert calls == []


@pytest.mark.slow
@pytest.mark.fault_case(79)
@given(
    st.sampled_from(sorted(COMMANDS)),
    st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9), st.lists),
)
def test_any_json_gives_checked_arguments_or_a_refusal(name, value):
    fields = COMMANDS[name]
    body = json.dumps(dict.fromkeys(fields, value)).encode()
    arguments = {}
    with contextlib.suppress(web.HTTPBadRequest):
        arguments = checked_arguments(name, body)
    for key, given_value in arguments.items():
        kind = fields[key][0]
        assert given_value in kind if isinstance(kind, range) else type(given_value) is kind


def test_a_taken_port_is_named_and_the_first_page_lives_on():
    with running() as server:
        port = urlsplit(server.address).port
        second = PageServer(PageSettings(port=port))
        with pytest.raises(OSError, match=rf"127\.0\.0\.1 port {port} is in use"):
            second.start()
        second.stop()
        assert ask(server)[0] == 200


def test_an_address_that_is_not_allowed_or_not_here_and_a_token_that_is_no_secret_are_refused():
    with pytest.raises(ValueError, match="allow_network"):
        PageServer(PageSettings(host="0.0.0.0"))  # noqa: S104
    PageServer(PageSettings(host="0.0.0.0", allow_network=True))  # noqa: S104
    with pytest.raises(OSError, match=r"203\.0\.113\.9 port 0 is not an address of this machine"):
        PageServer(PageSettings(host="203.0.113.9", port=0, allow_network=True)).start()
    with pytest.raises(ValueError, match="at least 8 characters"):
        PageServer(token="1234")  # noqa: S106


def test_the_token_comes_from_a_private_file_or_the_environment_and_is_kept_as_a_hash(tmp_path):
    file = tmp_path / "token"
    file.write_text(TOKEN + "\n")
    file.chmod(0o644)
    with pytest.raises(ValueError, match="chmod"):
        read_token(str(file), {})
    file.chmod(0o640)
    assert read_token(str(file), {"MWD_PAGE_TOKEN": "another-secret"}) == TOKEN
    assert read_token("", {"MWD_PAGE_TOKEN": TOKEN}) == TOKEN
    assert read_token("", {}) == ""
    with pytest.raises(ValueError, match="No such file"):
        read_token(str(tmp_path / "none"), {})
    assert TOKEN not in repr(vars(PageServer(token=TOKEN)))
    assert "token" not in {name for name, _ in flat(PageSettings()).items()}


def test_an_address_that_guesses_has_to_wait():
    now = [0.0]
    access = SecretAccess(TOKEN, lambda: now[0])
    for k in range(5):
        assert access.wait_s("a") == 0
        assert not access.allows("a", f"guess {k} \udcff")
    assert access.wait_s("a") == 60
    assert access.wait_s("b") == 0
    assert access.allows("b", TOKEN)
    now[0] = 60.0
    assert access.wait_s("a") == 0
    assert access.allows("a", TOKEN)


def test_a_token_of_any_bytes_is_refused_and_guessing_is_locked_out():
    with commanded() as (server, _):
        answers = []
        for _ in range(6):
            with connected(server) as raw:
                raw.sendall(
                    b"POST /command/stop_recording HTTP/1.1\r\nHost: localhost\r\n"
                    b"Authorization: Bearer \xff\xc3\xa9\xed\xa0\x80\r\nContent-Type: application/json\r\n"
                    b"Content-Length: 2\r\n\r\n{}"
                )
                answers.append(raw.recv(12))
        assert answers == [b"HTTP/1.1 401"] * 5 + [b"HTTP/1.1 429"]


@pytest.mark.parametrize(("name", "abort", "grant"), [("judge_control", 2, 0), ("decide_downlink", 3, 1)])
def test_whoever_guesses_at_the_operator_s_address_does_not_lock_out_an_abort(name, abort, grant):
    with commanded() as (server, calls):
        words = {"decision": abort, "operator_name": "Ann"}
        for k in range(7):
            assert order(server, name, words, token=f"guess {k}")[0] == (401 if k < 5 else 429)
        assert order(server, name, words) == (200, {"ok": True, "message": "done"})
        assert order(server, name, {**words, "decision": grant, "number": 1})[0] == 429
        assert order(server, "stop_recording", {})[0] == 429
        # The right token of an abort does not end the wait of whoever guesses.
        assert order(server, "stop_recording", {}, token="another guess")[0] == 429  # noqa: S106
        assert calls == [(name, words)]


def test_an_abort_does_not_wait_for_an_export():
    ends = threading.Event()

    def act(name, _arguments):
        return (name != "export" or ends.wait(30.0)), name

    with running(act, token=TOKEN) as server, concurrent.futures.ThreadPoolExecutor(1) as pool:
        export = pool.submit(order, server, "export", {"format": "csv"})
        assert order(server, "judge_control", {"decision": 2, "operator_name": "Ann"})[0] == 200
        assert not export.done()
        ends.set()
        assert export.result()[0] == 200


def test_it_stops_with_watchers_on_and_can_start_again():
    server = PageServer(PageSettings(port=0))
    server.start()

    async def talk(ws):
        await ws.receive()
        started = time.monotonic()
        stopping = asyncio.create_task(asyncio.to_thread(server.stop))
        message = await ws.receive()
        while message.type is aiohttp.WSMsgType.TEXT:
            message = await ws.receive()
        await stopping
        return time.monotonic() - started, ws.close_code

    took, code = watch(server, talk)
    assert took < 10.0
    assert code == 1001
    with pytest.raises(RuntimeError, match="not running"):
        _ = server.address
    server.stop()
    server.start()
    assert ask(server)[0] == 200
    server.stop()


def test_pushing_is_cheap_safe_from_any_thread_and_allowed_before_start_and_after_stop():
    server = PageServer(PageSettings(port=0))
    server.push(ShownState().snapshot(0.0))
    server.start()
    snapshot = ShownState().snapshot(0.0)
    threads = [threading.Thread(target=lambda: [server.push(snapshot) for _ in range(500)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert ask(server, "/state.json")[0] == 200
    server.stop()
    server.push(snapshot)


def test_names_with_markup_travel_as_text():
    state = ShownState()
    state.show(0.0, diagnostics=(NodeDiagnostic("<script>alert(1)</script>", 1, "</script>"),))
    with running() as server:
        server.push(state.snapshot(0.0))
        status, body, headers = ask(server, "/state.json")
        assert (status, headers["Content-Type"].split(";")[0]) == (200, "application/json")
        assert json.loads(body)["sections"]["diagnostics"]["rows"][0]["name"] == "<script>alert(1)</script>"


def test_garbage_instead_of_http_and_half_closed_sockets_do_no_harm():
    with running() as server:
        for rubbish in (b"\x00" * 100, b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"A" * 100_000):
            with connected(server) as broken, contextlib.suppress(OSError):
                broken.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                broken.sendall(rubbish)
        assert ask(server)[0] == 200
