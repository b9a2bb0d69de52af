# SPDX-License-Identifier: Apache-2.0
"""
Client that pushes the definitive survey to a WITSML 1.4.1.1 store: AddToStore first, then UpdateInStore.

An update does not remove what the survey no longer has, such as a station, or an azimuth that has become unknown. It is
deleted with DeleteFromStore. The store interface is SOAP 1.1 over HTTP(S): a request contains the text of a trajectory,
the answer a number and a message. Answers are parsed without entities, limited in size, and never cause another
request.
"""

from __future__ import annotations

import asyncio
import base64
import dataclasses
import functools
import re
import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit
from xml.sax.saxutils import escape

from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import read_text
from mwd_sensors.core.settings import setting
from mwd_surface.loopback import is_loopback
from mwd_surface.rig.interface import (
    CONNECTED,
    CONNECTING,
    STOPPED,
    Backoff,
    InterfaceError,
    InterfaceStatus,
    PeerStatus,
    RigInterface,
    wait_for,
)

_NAMESPACE = "http://www.witsml.org/message/120"
_ACTION = "http://www.witsml.org/action/120/Store."
SUCCESS, ALREADY_THERE, NOT_THERE = 1, -405, -433  # result numbers of WITSML 1.4.1.1
_SHOWN = 300  # largest number of characters of an error in the status


class StoreRefusedError(RuntimeError):
    """Raised if the store does not answer with success; the message has the number and text of the answer."""


@dataclasses.dataclass(frozen=True)
class WitsmlStoreSettings:
    """Address of the store, login, and waits between attempts."""

    enabled: bool = setting(False, "Send the definitive survey to a WITSML store whenever the survey changes.")
    url: str = setting("", "Address of the store's SOAP interface, http:// or https://.")
    user: str = setting("", "User name of the login. Empty: no login is sent.")
    password_file: str = setting("", "File whose first line is the password of the login.")
    allow_plain: bool = setting(False, "Allow the password to be sent without encryption (http) to another machine.")
    timeout: float = setting(
        20.0, "Longest wait for an answer of the store. Raise it for a slow network.", unit="s", low=0.5, high=300.0
    )
    backoff: Backoff = setting(Backoff, "Waits between attempts to send.")


class WitsmlStore(RigInterface):
    """Client that pushes trajectories to a WITSML store."""

    def __init__(self, settings: WitsmlStoreSettings) -> None:
        super().__init__("witsml_store")
        self.settings = settings
        self._document = ""
        self._sent_document = ""
        # Elements of each trajectory that were written to the store, by the identifier of the trajectory.
        self._written: dict[str, set[ElementPath]] = {}
        self._sent = self._failures = 0
        self._reason = self._last = ""
        self._since = 0.0
        self._version = ""

    def push(self, document: str) -> None:
        """Set the trajectory to send (from `export_witsml.witsml`), in place of one that still waits; never blocks."""
        self._document = document
        # If the loop has just ended, the document waits for the next start.
        self.rouse()

    def start(self) -> None:
        """
        Start pushing.

        Raises
        ------
        InterfaceError
            The address is not valid, the password would be sent in clear text, or the password file cannot be read.
        """
        s, parts = self.settings, urlsplit(self.settings.url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise InterfaceError(
                f"url: {s.url!r} is not the address of a store; it must begin with https:// or http://"
            )
        exposed = s.user and parts.scheme == "http" and not is_loopback(parts.hostname)
        if exposed and not s.allow_plain:
            raise InterfaceError(f"url: {s.url} would carry the password in clear text; use https, or set allow_plain")
        self._authorization = self._credentials()
        super().start()

    async def serve(self, ready: Callable[[str], None], stop: asyncio.Event) -> None:
        """Push new documents until `stop` is set; wait and retry after a failure."""
        ready(self.settings.url)
        self._since, failed = time.monotonic(), 0
        while not stop.is_set():
            self.wake.clear()
            document = self._document
            if document and document != self._sent_document:
                try:
                    await asyncio.to_thread(self._deliver, document)
                except (OSError, StoreRefusedError, ValueError) as error:
                    failed += 1
                    self._failures += 1
                    self._reason = str(error)[:_SHOWN]
                else:
                    failed, self._reason, self._sent_document = 0, "", document
                    self._sent += 1
                    continue
            await wait_for(self.wake, self.settings.backoff.wait(failed) if failed else None)

    def _credentials(self) -> str:
        if not self.settings.user:
            return ""
        try:
            password = read_text(self.settings.password_file, budgets.SECRET).partition("\n")[0].rstrip("\r")
        except OSError as error:
            raise InterfaceError(f"password_file: {error}") from error
        except UnicodeDecodeError as error:
            raise InterfaceError(f"password_file: {self.settings.password_file} is not UTF-8") from error
        text = f"{self.settings.user}:{password}".encode()
        return "Basic " + base64.b64encode(text).decode("ascii")

    def _deliver(self, document: str) -> None:
        if not self._version:
            answer = self._ask("WMLS_GetVersion", {})
            self._version = answer.get("Result", "")
            if "1.4.1.1" not in self._version.split(","):
                versions, self._version = self._version, ""
                raise StoreRefusedError(f"the store speaks WITSML {versions or 'of an unknown version'}, not 1.4.1.1")
        uid, elements = _uid(document), _elements(document)
        before = self._written.get(uid, set())
        add, update = "WMLS_AddToStore", "WMLS_UpdateInStore"
        first, second = (update, add) if before else (add, update)
        result, message = self._order(first, "XMLin", document)
        if result == (ALREADY_THERE if first == add else NOT_THERE):
            first = second
            result, message = self._order(second, "XMLin", document)
        if result < SUCCESS:
            raise StoreRefusedError(f"{first}: the store refused with {result}" + (f": {message}" if message else ""))
        self._written[uid] = before | elements
        gone = before - elements
        if gone and first == update:
            result, message = self._order("WMLS_DeleteFromStore", "QueryIn", _without(document, gone))
            if result < SUCCESS:
                raise StoreRefusedError(f"WMLS_DeleteFromStore: the store refused with {result}: {message}")
        self._written[uid] = elements

    def _order(self, order: str, name: str, document: str) -> tuple[int, str]:
        """
        Call a function of the store, such as AddToStore; return the result number and message of the answer.

        name: name of the argument that contains the document.

        Raises StoreRefusedError if the answer has no result number, and the exceptions of `_ask`.
        """
        answer = self._ask(order, {"WMLtypeIn": "trajectory", name: document, "OptionsIn": "", "CapabilitiesIn": ""})
        try:
            result = int(answer.get("Result", ""))
        except ValueError as error:
            raise StoreRefusedError(f"{order}: the store gave no result") from error
        self._last = f"{order} {result}"
        return result, answer.get("SuppMsgOut", "").strip()

    @functools.cached_property
    def _opener(self) -> urllib.request.OpenerDirector:
        # Read the system's certificates only once, because reading them takes longer than a call.
        return urllib.request.build_opener(
            urllib.request.HTTPSHandler(context=ssl.create_default_context()), _NoRedirect()
        )

    def _ask(self, order: str, arguments: dict[str, str]) -> dict[str, str]:
        """
        Make one SOAP call; return the texts of the elements of the answer, by name.

        Raises StoreRefusedError for an HTTP error or an answer that is too large, OSError without an answer, and
        ValueError for an answer that is not XML.
        """
        inside = "".join(f"<{name}>{escape(text)}</{name}>" for name, text in arguments.items())
        body = (
            '<?xml version="1.0" encoding="UTF-8"?>'
            '<soap:Envelope xmlns:soap="http://schemas.xmlsoap.org/soap/envelope/">'
            f'<soap:Body><w:{order} xmlns:w="{_NAMESPACE}">{inside}</w:{order}></soap:Body></soap:Envelope>'
        )
        headers = {"Content-Type": "text/xml; charset=utf-8", "SOAPAction": f'"{_ACTION}{order}"'}
        if self._authorization:
            headers["Authorization"] = self._authorization
        request = urllib.request.Request(self.settings.url, body.encode(), headers)  # noqa: S310 (checked in start)
        try:
            with self._opener.open(request, timeout=self.settings.timeout) as response:
                answer = response.read(budgets.WITSML_STORE.size + 1)
        except urllib.error.HTTPError as error:
            with error:
                told = answer_texts(error.read(budgets.WITSML_STORE.size)) if error.code == 500 else {}
            text = told.get("faultstring", "")
            raise StoreRefusedError(f"{order}: HTTP {error.code} {text or error.reason}") from error
        if len(answer) > budgets.WITSML_STORE.size:
            raise StoreRefusedError(f"{order}: the answer is larger than {budgets.WITSML_STORE.size} bytes")
        return answer_texts(answer)

    def status(self) -> InterfaceStatus:
        """Return the state of the interface."""
        if not self.running:
            return InterfaceStatus(self.name, STOPPED, reason=self.failure)
        peers = (PeerStatus(self.settings.url, self._since, sent=self._sent, last=self._last),)
        state = CONNECTED if self._sent and not self._reason else CONNECTING
        return InterfaceStatus(
            self.name,
            state,
            self.settings.url,
            self._reason,
            peers if self._sent else (),
            sent=self._sent,
            counts=(("failures", self._failures),),
            last=(("last call", self._last or "none"),),
        )


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Handler that refuses redirects, so that survey and password are not sent to another address."""

    def redirect_request(self, *_about: object) -> None:
        """Return None, so that the redirect is not followed."""


def answer_texts(answer: bytes) -> dict[str, str]:
    """
    Return the text of each element of an answer by its local name; for repeated names the last text.

    Raises
    ------
    ValueError
        The answer is not XML, or declares a document type, which is not needed and could define entities.
    """
    from lxml import etree

    # The answer comes from outside: do not resolve entities and do not use the network.
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = etree.fromstring(answer, parser)
    except etree.XMLSyntaxError as error:
        raise ValueError(f"the answer is not XML: {error}") from error
    if root.getroottree().docinfo.doctype:
        raise ValueError("the answer declares a document type")
    return {etree.QName(one).localname: "".join(one.xpath("text()")) for one in root.iter(etree.Element)}


def _uid(document: str) -> str:
    match = re.search(r"<trajectory\b[^>]*\suid=\"([^\"]*)\"", document)
    return match[1] if match else ""


ElementPath = tuple[tuple[str, str], ...]  #: tag and identifier of each element from the trajectory to an element


def _elements(document: str) -> set[ElementPath]:
    """Return the elements of a trajectory that a store can delete: those with an identifier or with a text."""
    from lxml import etree

    found: set[ElementPath] = set()

    def visit(element: Any, above: ElementPath) -> None:
        for child in element:
            path = (*above, (etree.QName(child).localname, child.get("uid", "")))
            if child.get("uid") or (child.text or "").strip():
                found.add(path)
            # The elements of customData have no identifiers and are not described by the schema.
            if path[-1][0] != "customData":
                visit(child, path)

    visit(etree.fromstring(document.encode())[0], ())
    return found


def _without(document: str, gone: set[ElementPath]) -> str:
    """
    Return the DeleteFromStore query of the elements of a trajectory, with the opening elements of the document.

    A store deletes an element that is empty in the query. The unit of an empty element must not be given (-417 of the
    store interface), and an element without identifier that contains others must not be empty (-419).
    """
    from lxml import etree

    head = re.search(r"<trajectorys\b[^>]*>\s*<trajectory\b[^>]*>", document)
    root = etree.fromstring(f"{head[0] if head else ''}</trajectory></trajectorys>")
    nodes: dict[ElementPath, Any] = {(): root[0]}
    for path in sorted(gone):
        # A station that is deleted as a whole is empty in the query.
        if any(path[:k] in gone for k in range(1, len(path))):
            continue
        for k in range(1, len(path) + 1):
            tag, uid = path[k - 1]
            if path[:k] not in nodes:
                nodes[path[:k]] = etree.SubElement(nodes[path[: k - 1]], f"{{{root.nsmap[None]}}}{tag}")
                if uid:
                    nodes[path[:k]].set("uid", uid)
    return str(etree.tostring(root, encoding="unicode"))
