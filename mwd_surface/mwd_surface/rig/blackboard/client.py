# SPDX-License-Identifier: Apache-2.0
"""
Client of a D-WIS blackboard: sends the manifest, writes the values, and reads the depths of the rig.

The blackboard is a third-party OPC UA server. Its methods Inject and ResolveQuery take and return JSON
(DWIS-Blackboard-Base and the Python sample of DWIS-Blackboard-Samples, D-WIS on GitHub). If the blackboard loses the
variables of this client, as after a restart, the manifest is sent again.
"""

from __future__ import annotations

import asyncio
import dataclasses
import json
import math
import time
import urllib.parse
from collections.abc import Callable, Iterable
from typing import Any

from mwd_sensors.core import budgets
from mwd_sensors.core.constants import CELSIUS_ZERO
from mwd_sensors.core.input_files import load_json
from mwd_sensors.core.settings import setting
from mwd_surface.rig.input import RigInput, RigInputSettings
from mwd_surface.rig.interface import (
    CONNECTED,
    CONNECTING,
    STOPPED,
    Backoff,
    InterfaceError,
    InterfaceStatus,
    OnRigState,
    PeerStatus,
    RigInterface,
    optional,
    wait_for,
)
from mwd_surface.rig.opcua.address_space import MANIFEST, STATUS_CODES, VariableValue
from mwd_surface.rig.values import RigValues, silenced
from mwd_surface.signals.table import TO_RIG, Signal
from mwd_surface.signals.units import UNITS

# Manifest of the signals that this program sends, made from the signal table. A blackboard creates the variables that
# the manifest names (variable provision). A consumer finds a variable by sentences (subject, verb, object) in the
# manifest, not by a node id. The fields are those of ManifestFile in DWIS-Blackboard-Base; nouns and verbs come from
# the DDHub vocabulary (DrillingDataSemantics, MeasurableQuantityTypes, Uncertainty, PhysicalLocation, DataProviders).

PREFIX = "http://ddhub.no/"
NODES, VARIABLES = "Nodes", "ProvidedVariables"  # aliases used within the manifest
_PROVIDER = "MWDSurface"
_UNCERTAINTY = "GaussianUncertainty"
_SIGMA = "sigma_"
_DEPTH = "DepthDrillingQuantity"
# Nouns of the signal table that are not classes of a signal but nodes to which a signal refers, each with the verb of
# the reference.
_REFERRED = {"NorthEastTVDFrame": "HasReferenceFrame", "BitReferenceLocation": "IsPhysicallyLocatedAt"}


def manifest() -> dict[str, Any]:
    """
    Return the manifest of the signals as a dict that can be written as JSON.

    Each signal becomes a variable with its OPC UA name and a data point that describes it. The blackboard derives the
    namespace of the variables from the name of the application, `MANIFEST`.
    """
    names = {signal.name for signal in TO_RIG}
    nodes: dict[str, str] = {_PROVIDER: "DataProvider"}
    sentences: list[dict[str, Any]] = []

    def say(subject: str, verb: str, target: str, kind: str | None = None) -> None:
        """Add a sentence whose object is a node of the manifest; kind: class of the node, if the node is new."""
        if kind is not None:
            nodes.setdefault(target, kind)
        sentences.append(_sentence(subject, verb, NODES, target))

    for signal in TO_RIG:
        point = f"{signal.opcua}_DataPoint"
        nodes[point] = "DrillingDataPoint"
        sentences.append(_sentence(point, "HasDynamicValue", VARIABLES, signal.opcua))
        say(point, "IsProvidedBy", _PROVIDER)
        quantity = quantity_of(signal)
        say(point, "IsOfMeasurableQuantity", quantity.removesuffix("Quantity"), quantity)
        for noun in signal.dwis:
            if noun in _REFERRED:
                say(point, _REFERRED[noun], noun.removesuffix("Location"), noun)
            elif noun != _UNCERTAINTY:
                sentences.append(_sentence(point, "BelongsToClass", PREFIX, PREFIX + noun))
        measured = signal.name.replace(_SIGMA, "", 1)
        if _UNCERTAINTY in signal.dwis and measured in names:
            of = next(s for s in TO_RIG if s.name == measured)
            uncertainty = f"{of.opcua}_Uncertainty"
            say(f"{of.opcua}_DataPoint", "HasUncertainty", uncertainty, _UNCERTAINTY)
            say(uncertainty, "HasUncertaintyMean", f"{of.opcua}_DataPoint")
            say(uncertainty, "HasUncertaintyStandardDeviation", point)
    return {
        "ManifestName": MANIFEST,
        "Provider": {"Name": MANIFEST, "Company": ""},
        "InjectionInformation": {
            "InjectedVariablesNamespaceAlias": "Variables",
            "InjectedNodesNamespaceAlias": NODES,
            "ProvidedVariablesNamespaceAlias": VARIABLES,
            "InjectedVocabularyNamespaceAlias": "Vocabulary",
        },
        "InjectedNodes": [_node(name, kind) for name, kind in nodes.items()],
        "InjectedVariables": [],
        "ProvidedVariables": [{"VariableID": signal.opcua, "DataType": "double", "Rank": 0} for signal in TO_RIG],
        "InjectedReferences": sentences,
    }


def quantity_of(signal: Signal) -> str:
    """Return the measurable quantity of a signal as a noun of the DDHub vocabulary."""
    if signal.unit == "m" and "depth" in signal.meaning and "difference" not in signal.meaning:
        return _DEPTH
    # A blackboard holds SI values, so temperatures have the quantity of the SI unit, in kelvin.
    return UNITS[signal.unit].quantity


def query(noun: str) -> str:
    """Return the SPARQL query for the variable that holds the present value of a class, such as BitDepth."""
    return (
        "PREFIX rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#>\n"
        f"PREFIX ddhub: <{PREFIX}>\n"
        "SELECT ?signal WHERE {\n"
        f"  ?point rdf:type ddhub:{noun} .\n"
        "  ?point ddhub:HasDynamicValue ?signal .\n"
        "}"
    )


def _node(name: str, kind: str) -> dict[str, Any]:
    fields = [{"FieldName": "ProviderName", "FieldValue": _PROVIDER}] if name == _PROVIDER else None
    return {
        "UniqueName": name,
        "BrowseName": name,
        "DisplayName": name,
        "TypeDictionaryURI": PREFIX + kind,
        "Fields": fields,
    }


def _sentence(subject: str, verb: str, namespace: str, target: str) -> dict[str, Any]:
    return {
        "Subject": {"NameSpace": NODES, "ID": subject},
        "VerbURI": PREFIX + verb,
        "Object": {"NameSpace": namespace, "ID": target},
    }


# Name of each depth that is read from the blackboard, with its class in the DDHub vocabulary.
NOUNS = {"bit_depth": "BitDepth", "hole_depth": "HoleDepth"}
_READ_S = 1.0  # time between two readings of the rig's depths, s
_FIND_S = 10.0  # time between two searches for depths that were not found, s
_SHOWN = 300  # largest number of characters of an error in the status
# Status codes of the values that may be used now.
_USABLE = frozenset(code for condition, code in STATUS_CODES.items() if condition.usable)
_LAST_NAMESPACE = 0xFFFF  # largest namespace index: an index has 16 bits in OPC UA


class BlackboardError(RuntimeError):
    """Raised if the blackboard refuses a request, or if its answer does not have the form that D-WIS describes."""


@dataclasses.dataclass(frozen=True)
class BlackboardSettings:
    """Settings of the blackboard and of the data exchanged with it."""

    enabled: bool = setting(
        False,
        "Publish the signals to a D-WIS blackboard, an OPC UA server on which the systems of a rig share their "
        "signals.",
    )
    url: str = setting(
        "opc.tcp://127.0.0.1:48030/",
        "Address of the blackboard's OPC UA server, for example opc.tcp://127.0.0.1:48030/.",
    )
    inject: str = setting(
        "ns=2;s=Inject",
        "Node id of the blackboard's method that accepts a D-WIS manifest, the description of the signals.",
    )
    resolve: str = setting(
        "ns=2;s=ResolveQuery", "Node id of the blackboard's method that finds the signals of a D-WIS query."
    )
    timeout: float = setting(
        10.0,
        "Longest wait for an answer of the blackboard. Raise it for a slow network.",
        unit="s",
        low=0.5,
        high=300.0,
    )
    period: float = setting(
        1.0,
        "Shortest time between two writes of changed values. Lowering it causes more traffic.",
        unit="s",
        low=0.1,
        high=60.0,
    )
    backoff: Backoff = setting(Backoff, "Waits between attempts to connect.")
    rig: RigInputSettings = setting(RigInputSettings, "Depths of the rig that others publish on the blackboard.")


class Blackboard(RigInterface):
    """
    Client of a D-WIS blackboard for one well.

    Parameters
    ----------
    on_rig_state : callable, optional
        Receives rig data, `wire.RIG_STATE`, in the thread of the interface.
    """

    def __init__(
        self,
        settings: BlackboardSettings,
        on_rig_state: OnRigState | None = None,
    ) -> None:
        super().__init__("blackboard")
        self.settings = settings
        self._on_rig_state = on_rig_state if settings.rig.accept else None
        self._input = RigInput(settings.rig)
        self._asyncua: Any = None
        self._connected = self._bare = False
        self._since = 0.0
        self._written = self._read = self._injections = self._failures = 0
        self._reason = ""

    def start(self) -> None:
        """
        Start publishing.

        Raises
        ------
        InterfaceError
            asyncua is missing, or the address is not valid.
        """
        self._asyncua = optional("asyncua", "asyncua", "the blackboard")
        if not _is_address(self.settings.url):
            raise InterfaceError(f"url: {self.settings.url!r} is not an address: write opc.tcp://host:port/")
        super().start()

    async def serve(self, ready: Callable[[str], None], stop: asyncio.Event) -> None:
        """Connect, send the manifest and the values, and reconnect after failures, until `stop` is set."""
        ready(self.settings.url)
        failures = 0
        while not stop.is_set():
            client = self._asyncua.Client(self.settings.url, timeout=self.settings.timeout)
            try:
                async with client:
                    await self._publish(client, stop)
                failures = 0
            except Exception as error:  # noqa: BLE001  (asyncua raises any exception for bytes that are not OPC UA)
                # A connection that was established resets the count of failures, so the next wait is short.
                failures = 0 if self._connected else failures
                failures, self._failures = failures + 1, self._failures + 1
                self._reason = (str(error) or "the peer did not answer as OPC UA")[:_SHOWN]
            finally:
                self._connected = False
            if not stop.is_set():
                await wait_for(stop, self.settings.backoff.wait(failures))

    async def _publish(self, client: Any, stop: asyncio.Event) -> None:
        variables = await self._inject(client)
        reader = _Depths(client, self.settings.resolve, {node.nodeid.to_string() for node in variables.values()})
        self._connected, self._since, self._reason = True, time.monotonic(), ""
        # Send status codes again after each connection: the blackboard may have been replaced by one that accepts them.
        self._bare = False
        sent: dict[str, VariableValue] = {}
        write_at = read_at = time.monotonic()
        while not stop.is_set():
            now = time.monotonic()
            if self.values is not None and now >= write_at:
                write_at = now + self.settings.period
                await self._write(client, variables, self.values, sent)
            if self._on_rig_state is not None and now >= read_at:
                read_at = now + _READ_S
                await self._take(reader, now)
            await wait_for(stop, max(min(write_at, read_at) - time.monotonic(), 0.05))
        if self.values is not None:
            # The blackboard keeps the last values, also if this client never comes back.
            await self._write(client, variables, silenced(self.values, 0.0, "the surface node has stopped"), sent)

    async def _inject(self, client: Any) -> dict[str, Any]:
        """
        Send the manifest; return the nodes that the blackboard created, by variable name.

        Raises BlackboardError if the blackboard refuses the manifest or does not create every variable.
        """
        result = await _asked(client, self.settings.inject, json.dumps(manifest()))
        if not result.get("Success"):
            raise BlackboardError("the blackboard refused the manifest: read its log")
        made = _made(result)
        missing = [signal.opcua for signal in TO_RIG if signal.opcua not in made]
        if missing:
            raise BlackboardError(f"the blackboard made no variable for {', '.join(missing[:3])}")
        self._injections += 1
        ua = self._asyncua.ua
        return {name: client.get_node(ua.NodeId(at, space)) for name, (space, at) in made.items()}

    async def _write(
        self, client: Any, variables: dict[str, Any], values: RigValues, sent: dict[str, VariableValue]
    ) -> None:
        """Write the values that changed since the last write."""
        ua, table = self._asyncua.ua, readings(values)
        changed = [name for name, reading in table.items() if sent.get(name) != reading]
        if not changed:
            # With nothing to write, read a value instead, so that a lost session is noticed.
            await client.nodes.server_state.read_value()
            return
        results = await client.write_values(
            [variables[name] for name in changed],
            [self._data_value(table[name]) for name in changed],
            raise_on_partial_error=False,
        )
        if not self._bare and any(result.value == ua.StatusCodes.BadWriteNotSupported for result in results):
            self._bare = True
            return
        for result in results:
            result.check()
        sent |= {name: table[name] for name in changed}
        self._written += len(changed)

    def _data_value(self, reading: VariableValue) -> Any:
        ua = self._asyncua.ua
        if self._bare:
            # Without a status code the last value would stay on the blackboard as a good one.
            value = reading.value if reading.status in _USABLE else math.nan
            return ua.DataValue(ua.Variant(value, ua.VariantType.Double))
        # The blackboard sets the server timestamp.
        return dataclasses.replace(reading.data_value(ua, "Double"), ServerTimestamp=None)

    async def _take(self, reader: _Depths, now: float) -> None:
        found = await reader.read(now)
        if not found or self._on_rig_state is None:
            return
        sample = self._input.take(found, time.time_ns())
        if sample is not None:
            self._read += 1
            self._on_rig_state(sample)

    def status(self) -> InterfaceStatus:
        """Return the state of the interface."""
        if not self.running:
            return InterfaceStatus(self.name, STOPPED, reason=self.failure)
        peers = (PeerStatus(self.settings.url, self._since, sent=self._written, received=self._read),)
        return InterfaceStatus(
            self.name,
            CONNECTED if self._connected else CONNECTING,
            self.settings.url,
            self._reason,
            peers if self._connected else (),
            sent=self._written,
            received=self._read,
            counts=(("manifests sent", self._injections), ("failures", self._failures)),
        )


class _Depths:
    """
    Reader of the rig's depths on a blackboard; the variables are found by their class, such as BitDepth.

    Parameters
    ----------
    resolve : str
        Node id of the method that answers a query.
    ours : set of str
        Node ids of the variables that this client publishes; they are not used as a source.
    """

    def __init__(self, client: Any, resolve: str, ours: Iterable[str]) -> None:
        self._client, self._resolve, self._ours = client, resolve, set(ours)
        self._nodes: dict[str, Any] = {}
        self._stamps: dict[str, Any] = {}
        self._find_at = 0.0
        self._unknown = optional("asyncua.ua", "asyncua", "the blackboard").StatusCodes.BadNodeIdUnknown

    async def read(self, now: float) -> dict[str, float]:
        """
        Return the depths, m, by name, that are good and newer than at the last call; NaN for one that is not a number.

        now: steady time, s.
        """
        if len(self._nodes) < len(NOUNS) and now >= self._find_at:
            self._find_at = now + _FIND_S
            for name, noun in NOUNS.items():
                if name not in self._nodes:
                    await self._find(name, noun)
        found = {}
        for name, node in list(self._nodes.items()):
            value = await node.read_data_value(raise_on_bad_status=False)
            if value.StatusCode.value == self._unknown:
                # The publisher has removed the node: search again.
                del self._nodes[name]
                continue
            stamp = value.SourceTimestamp or value.ServerTimestamp
            if value.Value is not None and value.StatusCode.is_good() and stamp != self._stamps.get(name):
                self._stamps[name] = stamp
                found[name] = _number(value.Value.Value)
        return found

    async def _find(self, name: str, noun: str) -> None:
        answer = await _asked(self._client, self._resolve, query(noun))
        spaces = await self._client.get_namespace_array()
        nodes = [(spaces.index(space), at) for space, at in _found(answer) if space in spaces]
        others = [self._client.get_node(f"ns={index};s={at}") for index, at in nodes]
        others = [node for node in others if node.nodeid.to_string() not in self._ours]
        # With two providers of one depth it is unknown which one is meant, so neither is used.
        if len(others) == 1:
            self._nodes[name] = others[0]


async def _asked(client: Any, method: str, text: str) -> dict[str, Any]:
    """
    Call a method of the blackboard with an array of one text, as D-WIS requires; return the parsed JSON answer.

    Raises BlackboardError if the method does not belong to an object, or if the answer is not a JSON table.
    """
    ua = optional("asyncua.ua", "asyncua", "the blackboard")
    node = client.get_node(method)
    parent = await node.get_parent()
    if parent is None:
        raise BlackboardError(
            f"{method} does not belong to an object: set its node id to that of the blackboard's method"
        )
    argument = ua.Variant([text], ua.VariantType.String)
    answer = await parent.call_method(node.nodeid, argument)
    first = answer[0] if isinstance(answer, list) else answer
    try:
        table = load_json(first, budgets.WITSML_STORE)
    except (TypeError, ValueError, AttributeError) as error:
        raise BlackboardError(f"{method} did not answer with JSON") from error
    if not isinstance(table, dict):
        raise BlackboardError(f"{method} did not answer with a table")
    return table


def _is_address(url: str) -> bool:
    """Return whether the URL names a host and a port of OPC UA."""
    try:
        parts = urllib.parse.urlsplit(url)
        return parts.scheme == "opc.tcp" and bool(parts.hostname) and bool(parts.port)
    except ValueError:
        return False


def _number(value: object) -> float:
    """Return the value of a variable as a number; NaN if it is not a number (every check rejects NaN)."""
    return float(value) if isinstance(value, int | float) else math.nan


def _made(result: dict[str, Any]) -> dict[str, tuple[int, str]]:
    """
    Return the namespace index and id of each variable that the blackboard created, by name in the manifest.

    Raises BlackboardError if the answer does not have the form that D-WIS describes.
    """
    try:
        rows = [(row["ManifestItemID"], row["InjectedID"]) for row in result.get("ProvidedVariables") or ()]
        made = {str(name): (int(at["NameSpaceIndex"]), str(at["ID"])) for name, at in rows}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise BlackboardError(f"the answer to the manifest is not the answer of a blackboard ({error!r})") from error
    if any(not 0 <= space <= _LAST_NAMESPACE for space, _ in made.values()):
        raise BlackboardError("the answer to the manifest has an invalid namespace index")
    return made


def _found(answer: dict[str, Any]) -> list[tuple[str, str]]:
    """
    Return the namespace and id of the node in the first column of each row of a query's answer.

    Raises BlackboardError if the answer does not have the form that D-WIS describes.
    """
    try:
        items = [row["Items"][0] for row in answer.get("Results") or () if row["Items"]]
        return [(str(item["NameSpace"]), str(item["ID"])) for item in items]
    except (KeyError, TypeError, IndexError) as error:
        raise BlackboardError(f"the answer to a query is not the answer of a blackboard ({error!r})") from error


def readings(values: RigValues) -> dict[str, VariableValue]:
    """Return value, status code and stamp of every signal, by OPC UA name; values in SI, temperatures in kelvin."""
    table = {}
    for signal in TO_RIG:
        v = values.values[signal.name]
        number = v.value + CELSIUS_ZERO if signal.unit == "degC" else v.value
        table[signal.opcua] = VariableValue(number, STATUS_CODES[v.condition], v.stamp_ns)
    return table
