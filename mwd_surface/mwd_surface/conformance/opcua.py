# SPDX-License-Identifier: Apache-2.0
"""Conformance test over OPC UA with the methods of docs/rig/control.md; each client has its own session."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from mwd_surface.conformance.bench import Bench, ControlAnswer, NotPossibleError, Point, View, Wish

_PATIENCE_S = 20.0  # longest time for an answer of the server, s
_LAG_S = 0.5  # wait for an update of the variables, s; longer than their period of 0.1 s
_NAMESPACE = "http://ddhub.no/MWDSurveyManifest/Variables/"


class OpcuaKeys(NamedTuple):
    """Certificate and private key of the client, certificate of the server, and the client's application URI."""

    certificate: Path
    private_key: Path
    server_certificate: Path
    application: str


class OpcuaConformance:
    """
    OPC UA server under test.

    Raises
    ------
    ValueError
        The server does not answer, refuses the certificate, or has no such object.
    """

    name, largest, lag_s = "OPC UA", 2**32 - 1, _LAG_S

    def __init__(self, url: str, keys: OpcuaKeys, well: str) -> None:
        self.url, self.keys, self.well = url, keys, well
        # Do not log refused calls, because the cases make calls that the server must refuse.
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        self._peers: dict[int, OpcuaPeer] = {}
        self._reader = OpcuaPeer(self)

    def peer(self, number: int) -> OpcuaPeer:
        """Return the client with a number, and open its session at first use."""
        if number not in self._peers:
            self._peers[number] = OpcuaPeer(self)
        return self._peers[number]

    def view(self) -> View:
        """Return the public state of the authority."""
        names = ("ControlLease", "SetPointMode", "SetPointSequence", "TopDriveSpeedSetPoint", "TurnSetPoint")
        lease, mode, sequence, speed, turn, pending = self._reader.read((*names, "ControlPending"))
        return View(lease, mode, sequence, speed, turn, pending)

    def attacks(self) -> list[tuple[str, str, Callable[[Bench], tuple[bool, str]]]]:
        """Return the cases of wrong use that only OPC UA allows: title, expected result and function."""
        return [
            ("a client writes a variable of the control state", "refused by the server", self._write),
            ("a method is called without one of its arguments", "refused by the server", self._missing),
            ("a set-point of the owner in a new session", "refused: it counts as another client", self._again),
        ]

    def _write(self, bench: Bench) -> tuple[bool, str]:
        bench.turning()
        from asyncua import ua
        from asyncua.ua.uaerrors import UaError

        try:
            self._reader.variable("TopDriveSpeedSetPoint").write_value(ua.Variant(5.0, ua.VariantType.Double))
        except UaError as error:
            return True, type(error).__name__
        return False, "written"

    def _missing(self, bench: Bench) -> tuple[bool, str]:
        from asyncua import ua
        from asyncua.ua.uaerrors import UaError

        lease = bench.take(bench.one())
        try:
            self.peer(0).call("set_point", ua.Variant(lease, ua.VariantType.UInt32))
        except UaError as error:
            return bench.view().sequence == 0, type(error).__name__
        return False, "called"

    def _again(self, bench: Bench) -> tuple[bool, str]:
        lease = bench.turning()
        self.peer(0).close()
        self.peer(0).open()
        taken = self.peer(0).send(lease, 2, Point(speed=0.9))
        return not taken, "accepted" if taken else "refused"

    def close(self) -> None:
        """Close all clients."""
        for peer in (*self._peers.values(), self._reader):
            peer.close()


class OpcuaPeer:
    """Client with an OPC UA session of its own."""

    def __init__(self, interface: OpcuaConformance) -> None:
        from asyncua import ua

        self._interface = interface
        self._kinds, self._variant = ua.VariantType, ua.Variant
        self.open()

    def open(self) -> None:
        """
        Open a session.

        Raises ValueError if the server gives no session, or does not have the object with the methods.
        """
        from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
        from asyncua.sync import Client
        from asyncua.ua.uaerrors import UaError

        keys = self._interface.keys
        # asyncua closes a connection whose server does not answer within the watchdog's interval, usually a second.
        self._client = Client(self._interface.url, timeout=_PATIENCE_S, watchdog_intervall=_PATIENCE_S)
        self._client.aio_obj.session_timeout = 600_000
        self._client.application_uri = keys.application
        own = str(keys.certificate), str(keys.private_key)
        self._client.set_security(SecurityPolicyBasic256Sha256, *own, server_certificate=str(keys.server_certificate))
        try:
            self._client.connect()
        except (UaError, OSError, TimeoutError) as error:
            self._client.tloop.stop()
            why = f"{self._interface.url} gives no session: {str(error) or type(error).__name__}"
            raise ValueError(f"{why}; check the address, and that the server trusts the certificate") from error
        self._index = self._client.get_namespace_index(_NAMESPACE)
        objects = {one.read_browse_name().Name: one for one in self._client.nodes.objects.get_children()}
        if self._interface.well not in objects:
            self._client.disconnect()
            names = ", ".join(sorted(objects.keys() - {"Server", "Aliases", "Locations"}))
            raise ValueError(
                f"{self._interface.url} has no object {self._interface.well!r}; choose --well from: {names}"
            )
        self._well = objects[self._interface.well]
        self._variables: dict[str, Any] = {}

    def variable(self, name: str) -> Any:
        """Return a variable of the well."""
        if name not in self._variables:
            self._variables[name] = self._well.get_child([f"{self._index}:{name}"])
        return self._variables[name]

    def read(self, names: tuple[str, ...]) -> list[Any]:
        """Return the values of several variables, read in one request, whatever the status of a value is."""
        from asyncua.ua.attribute_ids import AttributeIds

        nodes = [self.variable(name) for name in names]
        found = self._client.read_attributes(nodes, AttributeIds.Value)
        return [one.Value.Value for one in found]

    def call(self, name: str, *arguments: Any) -> Any:
        """Call a method of the well and return its outputs."""
        return self._well.call_method(f"{self._index}:{name}", *arguments)

    def ask(self, wish: Wish) -> ControlAnswer:
        """
        Request control and return the answer.

        Raises NotPossibleError if the wish has limits or a priority that is not a byte: the method has no arguments
        for these.
        """
        if wish.speed or wish.left_speed:
            raise NotPossibleError("a request over OPC UA has no such argument")
        if not 0 <= wish.priority <= 255:
            raise NotPossibleError("a priority over OPC UA is at most 255")
        message, permission, lease = self.call(
            "request_control",
            wish.name,
            "conformance",
            self._variant(wish.priority, self._kinds.Byte),
            self._variant(wish.wait, self._kinds.Boolean),
            self._variant(wish.duration, self._kinds.Double),
        )
        return ControlAnswer(permission, lease, message)

    def send(self, lease: int, sequence: int, point: Point) -> bool:
        """Send a set-point or a heartbeat; return whether the server accepts it."""
        whole = ((lease, self._kinds.UInt32), (sequence, self._kinds.UInt32), (int(point.mode), self._kinds.Byte))
        floats = (point.speed, point.turn, point.flow, point.valid_for)
        arguments = [self._variant(value, kind) for value, kind in whole]
        arguments += [self._variant(value, self._kinds.Double) for value in floats]
        return bool(self.call("set_point", *arguments)[0])

    def release(self, lease: int) -> bool:
        """Give a lease back; return whether the server accepts this."""
        return bool(self.call("release_control", self._variant(lease, self._kinds.UInt32), "conformance")[0])

    def close(self) -> None:
        """End the session."""
        self._client.disconnect()
