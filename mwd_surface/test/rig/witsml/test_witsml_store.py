# SPDX-License-Identifier: Apache-2.0
"""The definitive survey goes to a store: added, then updated, tried again, never with a password in the clear."""

import base64
import contextlib
import http.server
import random
import threading
import xml.etree.ElementTree as ET
from xml.sax.saxutils import escape

import pytest
from example_rig import started
from example_surveys import MADE, surveys, table
from lxml import etree
from waiting import eventually

from mwd_surface.exports.export_witsml import witsml
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.rig.interface import Backoff, InterfaceError
from mwd_surface.rig.witsml.store import WitsmlStore, WitsmlStoreSettings, answer_texts

ENVELOPE = '<s:Envelope xmlns:s="http://schemas.xmlsoap.org/soap/envelope/"><s:Body>{}</s:Body></s:Envelope>'
VERSION = ENVELOPE.format("<r><Result>1.3.1.1,1.4.1.1</Result></r>").encode()


@pytest.fixture(scope="module")
def document():
    return witsml(table())


class Stub(http.server.BaseHTTPRequestHandler):
    """A small store: keeps trajectories by uid and answers as the interface says."""

    def do_POST(self):
        store = self.server
        body = self.rfile.read(int(self.headers["Content-Length"]))
        call = ET.fromstring(body)[0][0]  # noqa: S314
        order = call.tag.rpartition("}")[2]
        assert self.headers["SOAPAction"] == f'"http://www.witsml.org/action/120/Store.{order}"'
        store.headers.append(dict(self.headers))
        store.orders.append(order)
        status, answer = store.answers.pop(0) if store.answers else (200, self.answer(order, call))
        self.send_response(status)
        if status == 302:
            self.send_header("Location", "http://127.0.0.1:1/")
        self.send_header("Content-Length", str(len(answer)))
        self.end_headers()
        self.wfile.write(answer)

    def answer(self, order, call):
        if order == "WMLS_GetVersion":
            return VERSION
        assert call.findtext("WMLtypeIn") == "trajectory"
        document = call.findtext("QueryIn" if order == "WMLS_DeleteFromStore" else "XMLin")
        (trajectory,) = ET.fromstring(document.encode())  # noqa: S314
        uid, kept = trajectory.get("uid"), self.server.kept
        if order in self.server.refused:
            self.server.refused.remove(order)
            return ENVELOPE.format("<r><Result>-1</Result><SuppMsgOut>busy</SuppMsgOut></r>").encode()
        there = uid in kept
        code = {("WMLS_AddToStore", True): -405, ("WMLS_UpdateInStore", False): -433}.get((order, there), 1)
        if order == "WMLS_DeleteFromStore":
            self.server.deleted += [station.get("uid") for station in trajectory if not len(station)]
            kept[uid] = without(kept[uid], document)
        elif code == 1:
            kept[uid] = updated(kept[uid], document) if there else document
        reported = escape("no such <object>" if code < 0 else "")
        inside = f"<Result>{code}</Result><SuppMsgOut>{reported}</SuppMsgOut>"
        return ENVELOPE.format(f"<m:{order}Response xmlns:m='urn:x'>{inside}</m:{order}Response>").encode()

    def log_message(self, *_about):
        """Keep the test's output clean."""


def key(element):
    return element.tag, element.get("uid")


def updated(kept, document):
    """Return a kept trajectory after UpdateInStore: what the document does not name stays."""

    def update(old, new):
        old.text = new.text
        before = {key(child): child for child in old}
        for child in new:
            if key(child) in before and "customData" not in child.tag:
                update(before[key(child)], child)
            elif "customData" not in child.tag:
                old.append(child)
        return old

    return ET.tostring(update(*(ET.fromstring(text.encode()) for text in (kept, document))), encoding="unicode")  # noqa: S314


def without(kept, query):
    """Return a kept trajectory after DeleteFromStore: what is empty in the query is deleted."""

    def delete(old, asked):
        before = {key(child): child for child in old}
        for child in asked:
            found = before[key(child)]
            assert "uom" not in child.attrib, "-417"
            if len(child):
                delete(found, child)
                if not len(found) and not found.get("uid"):
                    old.remove(found)
            else:
                assert child.get("uid") or not len(found), "-419"
                old.remove(found)
        return old

    return ET.tostring(delete(*(ET.fromstring(text.encode()) for text in (kept, query))), encoding="unicode")  # noqa: S314


def values(document):
    """Return the texts of the elements of a trajectory, by the tags and identifiers on the way to each."""

    def visit(element, above):
        for child in element:
            path = (*above, key(child))
            if len(child):
                yield from visit(child, path)
            elif "customData" not in str(path) and child.text:
                yield path, child.text

    return dict(visit(ET.fromstring(document.encode()), ()))  # noqa: S314


@contextlib.contextmanager
def store(answers=()):
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Stub)
    server.orders, server.headers, server.kept, server.deleted, server.refused = [], [], {}, [], []
    server.answers = list(answers)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def client(server, **changes):
    url = f"http://127.0.0.1:{server.server_address[1]}/store"
    return WitsmlStore(WitsmlStoreSettings(url=url, backoff=Backoff(0.01, 0.05), timeout=5.0, **changes))


def send(push, document, sent=1):
    """Push a document, and wait until so many are sent."""
    push.push(document)
    eventually(lambda: push.status().sent == sent)


def test_a_trajectory_is_added_and_afterwards_updated_and_arrives_unchanged(document):
    with store() as server, started(client(server)) as push:
        send(push, document)
        assert list(server.kept.values()) == [document]
        changed = document.replace("<definitive>true", "<definitive>false")
        send(push, changed, 2)
        assert values(*server.kept.values()) == values(changed)
        assert server.orders == ["WMLS_GetVersion", "WMLS_AddToStore", "WMLS_UpdateInStore"]
        status = push.status()
        assert (status.state, status.peers[0].last) == ("connected", "WMLS_UpdateInStore 1")


def test_a_trajectory_that_the_store_already_has_is_updated(document):
    with store() as server:
        for _ in range(2):
            with started(client(server)) as push:
                send(push, document)
        assert server.orders[-3:] == ["WMLS_GetVersion", "WMLS_AddToStore", "WMLS_UpdateInStore"]


def test_a_station_that_is_taken_out_of_the_survey_is_deleted_in_the_store(document):
    whole = surveys()
    less = survey_table(whole.reject(7, "Bo", "casing", MADE), MADE)
    with store() as server, started(client(server)) as push:
        send(push, document)
        send(push, witsml(less), 2)
        assert server.deleted == [whole.find(7).survey.uuid]


def thinned(document, seed):
    """Return a trajectory in which some numbers, texts and stations are no longer known."""
    chance, root = random.Random(seed), etree.fromstring(document.encode())

    def thin(element):
        for child in list(element):
            if child.tag.rpartition("}")[2] in ("customData", "md", "typeTrajStation"):
                continue
            if chance.random() < 0.3:
                element.remove(child)
            else:
                thin(child)

    thin(root[0])
    return etree.tostring(root, encoding="unicode")


@pytest.mark.parametrize("refused", [False, True])
def test_what_becomes_unknown_does_not_stay_in_the_store(document, refused):
    documents = [document, *(thinned(document, seed) for seed in range(6)), document]
    with store() as server, started(client(server)) as push:
        for k, one in enumerate(documents, start=1):
            # A deletion that fails is made up for.
            server.refused = ["WMLS_DeleteFromStore"] if refused else []
            send(push, one, k)
            assert values(*server.kept.values()) == values(one)
        assert server.orders.count("WMLS_DeleteFromStore") >= 6


def test_the_same_document_is_sent_once(document):
    with store() as server, started(client(server)) as push:
        for _ in range(5):
            send(push, document)
        assert server.orders.count("WMLS_AddToStore") == 1


def test_after_failures_it_is_tried_again_until_it_goes_through(document):
    fault = ENVELOPE.format("<s:Fault><faultstring>database is down</faultstring></s:Fault>").encode()
    answers = [(500, fault), (503, b""), (200, b"no xml"), (302, b"")]
    with store(answers) as server, started(client(server)) as push:
        send(push, document)
        assert dict(push.status().counts)["failures"] == 4
        assert push.status().reason == ""


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        ((500, ENVELOPE.format("<s:Fault><faultstring>disk full</faultstring></s:Fault>").encode()), "disk full"),
        ((401, b""), "HTTP 401"),
        ((200, b"<a>" * 3), "not XML"),
        ((200, b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>'), "document type"),
        ((200, b"<a><Result>x</Result></a>"), "WITSML x, not 1.4.1.1"),
        ((302, b""), "HTTP 302"),
    ],
)
def test_the_reason_of_a_failure_is_reported(answer, reason, document):
    with store([answer] * 10_000) as server, started(client(server)) as push:
        push.push(document)
        eventually(lambda: reason in push.status().reason)
        assert push.status().state == "connecting"


def test_a_store_that_is_not_there_is_reported_and_tried_again(document):
    with store() as server:
        push = client(server)
    with started(push):
        push.push(document)
        eventually(lambda: dict(push.status().counts)["failures"] >= 2)
        assert "refused" in push.status().reason


def test_a_refusal_carries_the_number_and_words_of_the_store(document):
    refusal = ENVELOPE.format("<r><Result>-401</Result><SuppMsgOut>not &lt;valid&gt;</SuppMsgOut></r>").encode()
    with store([(200, VERSION), *[(200, refusal)] * 1000]) as server, started(client(server)) as push:
        push.push(document)
        eventually(lambda: "refused with -401: not <valid>" in push.status().reason)


def test_the_password_comes_from_a_file_and_never_goes_out_in_the_clear_to_another_machine(tmp_path, document):
    secret = tmp_path / "password"
    secret.write_text("hush\n")
    with store() as server, started(client(server, user="bo", password_file=str(secret))) as push:
        send(push, document)
        assert server.headers[0]["Authorization"] == "Basic " + base64.b64encode(b"bo:hush").decode()
        assert "hush" not in repr(push.status())
    exposed = WitsmlStoreSettings(url="http://store.example/", user="bo", password_file=str(secret))
    with pytest.raises(InterfaceError, match="clear text"):
        WitsmlStore(exposed).start()


@pytest.mark.parametrize("url", ["", "file:///etc/passwd", "ftp://store.example/", "https://"])
def test_what_is_no_address_of_a_store_is_refused(url):
    with pytest.raises(InterfaceError, match="url"):
        WitsmlStore(WitsmlStoreSettings(url=url)).start()


@pytest.mark.fault_case(83)
def test_an_entity_bomb_is_refused_before_it_grows():
    bomb = b'<!DOCTYPE a [<!ENTITY b "xxxxxxxxxx"><!ENTITY c "&b;&b;&b;">]><a>&c;</a>'
    with pytest.raises(ValueError, match="document type"):
        answer_texts(bomb)
