# SPDX-License-Identifier: Apache-2.0
"""
OPC UA server: the values of a well as an object that clients find by name, with status codes.

On loopback everyone may read. From other machines, and for commands from anywhere, a session must be signed and
encrypted with a certificate that lies in the folder of trusted certificates. Variables cannot be written; commands are
methods.
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mwd_sensors.core import budgets
from mwd_surface import __version__
from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.set_point import SetPoint
from mwd_surface.control.status import ControlRequest, Sender
from mwd_surface.live.alarms import Alarm, Severity
from mwd_surface.rig.interface import (
    LISTENING,
    STOPPED,
    InterfaceError,
    InterfaceStatus,
    OnCommand,
    PeerStatus,
    RigInterface,
    bound_log,
    checked_host,
    optional,
    port_error,
    probe_port,
)
from mwd_surface.rig.opcua.access import APPLICATION, LONGEST_QUEUE, OpcuaAccess, OpcuaSettings, SubscriptionLimits
from mwd_surface.rig.opcua.address_space import (
    EPOCH,
    MANIFEST,
    NAMESPACE,
    STATUS_CODES,
    UNITS_NAMESPACE,
    VARIABLES,
    Variable,
    VariableValue,
    moment,
    unit_id,
    variable_values,
)
from mwd_surface.rig.survey import AcceptedSurvey
from mwd_surface.rig.values import RigValues, nothing_yet, survey_values
from mwd_surface.signals.table import OF_SURVEY
from mwd_surface.signals.units import UNITS

_REFUSALS = "asyncua.server.binary_server_asyncio"  # asyncua's logger for refused connections
_LOG = logging.getLogger("mwd_surface.opcua")
_MAX_SUBSCRIPTIONS = 64  # further subscriptions are refused
_TICK = 1.0  # longest time between two writes of a value, s


class OpcuaServer(RigInterface):
    """
    OPC UA server of one well.

    Parameters
    ----------
    well : str
        Name of the object that the variables belong to.
    on_command : callable, optional
        `on_command(name, arguments) -> (ok, message)` for decisions on surveys, called in a thread of the pool.
    folder : Path, optional
        Folder of the certificates, used if the settings name none.
    authority : ControlAuthority, optional
        Decides about requests that come through the control methods.
    """

    def __init__(
        self,
        settings: OpcuaSettings,
        well: str = "well",
        on_command: OnCommand | None = None,
        folder: Path | None = None,
        authority: ControlAuthority | None = None,
    ) -> None:
        super().__init__("opcua")
        self.settings, self.well = settings, well or "well"
        self._methods: list[OpcuaMethod] = []
        if settings.allow_commands and on_command is not None:
            self._methods += survey_methods(on_command)
        if settings.allow_control and authority is not None:
            self._methods += control_methods(authority)
        self._folder = Path(settings.certificates).expanduser() if settings.certificates else folder
        self._server: Any = None
        self._since: dict[Any, float] = {}
        self._written, self._confirmed_at = 0, -_TICK
        self._commands = self._record_errors = 0
        self.refused = 0
        self._last: dict[str, VariableValue] = {}
        self._written_values = asyncio.Event()
        self._ids: dict[str, Any] = {}
        self._subscriptions: SubscriptionLimits | None = None

    def start(self) -> None:
        """
        Start serving.

        Raises
        ------
        InterfaceError
            asyncua is missing, the address or port cannot be opened, or there is no folder for certificates.
        """
        self._asyncua = optional("asyncua", "asyncua", "OPC UA")
        bound_log("asyncua")
        self._ua = self._asyncua.ua
        self._access = OpcuaAccess(self.settings, self._folder, self._ua)
        super().start()

    async def serve(self, ready: Callable[[str], None], stop: asyncio.Event) -> None:
        """
        Listen until `stop` is set.

        Raises InterfaceError if the host is not allowed, the port cannot be opened, or there is no folder for
        certificates.
        """
        host = checked_host(self.settings.host, self.settings.allow_network)
        if self._access.needs_certificates and self._folder is None:
            raise InterfaceError("certificates: name a folder for the certificates of OPC UA")
        # Check the port before loading the address space, which takes seconds.
        probe_port(host, self.settings.port)
        server = self._server = self._asyncua.Server(user_manager=self._access)
        await server.init()
        await server.set_application_uri(APPLICATION)
        server.product_uri = APPLICATION
        server.set_server_name("MWD surface")
        await server.set_build_info(APPLICATION, "MWD telemetry", "mwd_surface", __version__, "0", EPOCH)
        server.set_endpoint(f"opc.tcp://{host}:{self.settings.port}/")
        await self._access.secure(server)
        self._limit(server)
        await self._build(server)
        refusals = logging.getLogger(_REFUSALS)
        refusals.addFilter(self._count_refusal)
        try:
            await server.start()
            server.bserver.set_policies(self._access.channels(server))
        except OSError as error:
            refusals.removeFilter(self._count_refusal)
            raise port_error(error, host, self.settings.port) from error
        try:
            ready(f"opc.tcp://{server.bserver.hostname}:{server.bserver.port}/")
            await self._follow(server, stop)
        finally:
            await server.stop()
            refusals.removeFilter(self._count_refusal)
            self._server = None

    def _count_refusal(self, record: logging.LogRecord) -> bool:
        """
        Filter the log of asyncua: count a refused connection, and suppress its message.

        Returns whether the message is logged.
        """
        server = self._server
        full = server is not None and len(server.bserver.clients) >= self.settings.max_clients
        if not full or not str(record.msg).startswith("Refusing connection"):
            return True
        self.refused += 1
        return False

    def _limit(self, server: Any) -> None:
        server.iserver.allow_remote_admin = False
        server.iserver.max_connections = self.settings.max_clients
        server.iserver.max_subscriptions = _MAX_SUBSCRIPTIONS
        server.iserver.max_monitored_item_queue_size = LONGEST_QUEUE
        server.iserver.max_unacked_messages_per_subscription = 100
        server.iserver.max_pending_messages_per_connection = 100
        self._subscriptions = SubscriptionLimits(self._ua, server.iserver.subscription_service)
        server.limits.max_message_size = budgets.OPCUA.size
        server.limits.max_chunk_count = budgets.OPCUA.size // server.limits.max_recv_buffer + 1

    async def _build(self, server: Any) -> None:
        """Create the object of the well with its variables, methods, history and conditions."""
        ua = self._ua
        well, self._ids = await add_well(ua, server, self.well)
        self._history = SurveyHistory(ua, server, self._ids)
        await self._history.open()
        self._conditions = Conditions(ua, server, well)
        await self._conditions.open()
        index = well.nodeid.NamespaceIndex
        for method in self._methods:
            arguments = [[_argument(ua, *argument) for argument in way] for way in (method.inputs, method.outputs)]
            name = method.name
            await well.add_method(
                ua.NodeId(f"{MANIFEST}.{name}", index), f"{index}:{name}", self._called(method), *arguments
            )

    async def _follow(self, server: Any, stop: asyncio.Event) -> None:
        await self._write(server, self.values or nothing_yet())
        records = asyncio.create_task(self._show_records(stop))
        try:
            await self._show_values(server, stop)
        finally:
            records.cancel()
            await asyncio.gather(records, return_exceptions=True)

    async def _show_records(self, stop: asyncio.Event) -> None:
        """Update history and conditions, in a task of their own so that errors or a long history delay no values."""
        while not stop.is_set():
            values = self.values
            if values is not None:
                try:
                    await self._history.show(values.surveys)
                    await self._conditions.show(values.alarms)
                except Exception as error:  # noqa: BLE001  (counted and shown; the next pass tries again)
                    if not self._record_errors:
                        _LOG.warning("OPC UA history or conditions: %s", error)
                    self._record_errors += 1
            await self._written_values.wait()
            self._written_values.clear()

    async def _show_values(self, server: Any, stop: asyncio.Event) -> None:
        while not stop.is_set():
            await self.woken(_TICK)
            clients = {client for client in server.bserver.clients if client.peer_name}
            self._since = {client: self._since.get(client, time.monotonic()) for client in clients}
            if self.values is not None:
                await self._write(server, self.values)

    async def _write(self, server: Any, values: RigValues) -> None:
        table, now = variable_values(values), time.monotonic()
        # Confirm every value once per second with a new server timestamp, even if the value has not changed.
        confirm = now - self._confirmed_at >= _TICK
        for variable in VARIABLES:
            reading = table[variable.name]
            if not confirm and self._last.get(variable.name) == reading:
                continue
            value = reading.data_value(self._ua, variable.kind)
            await server.write_attribute_value(self._ids[variable.name], value)
            self._written += 1
        self._last = table
        if confirm:
            self._confirmed_at = now
        self._written_values.set()

    def _called(self, method: OpcuaMethod) -> Callable[..., Any]:
        ua = self._ua
        names = [name for name, _, _ in method.inputs]
        wanted = [getattr(ua.VariantType, kind) for _, kind, _ in method.inputs]
        kinds = [getattr(ua.VariantType, kind) for _, kind, _ in method.outputs]

        async def call(_parent: Any, *given: Any) -> Any:
            # asyncua calls a coroutine in the task of its request, where the identity of the caller is known.
            self._commands += 1
            if len(given) != len(names):
                return ua.StatusCode(ua.StatusCodes.BadArgumentsMissing)
            if any(argument.VariantType != kind for argument, kind in zip(given, wanted, strict=True)):
                return ua.StatusCode(ua.StatusCodes.BadTypeMismatch)
            arguments = {key: argument.Value for key, argument in zip(names, given, strict=True)}
            if any(value is None for value in arguments.values()):
                return ua.StatusCode(ua.StatusCodes.BadInvalidArgument)
            # Call the method in a thread, because the answer of the node may take long.
            results = await asyncio.to_thread(method.call, arguments, self._access.identity)
            return [ua.Variant(value, kind) for value, kind in zip(results, kinds, strict=True)]

        return call

    def status(self) -> InterfaceStatus:
        """Return the state of the server."""
        peers = tuple(
            PeerStatus(f"{client.peer_name[0]}:{client.peer_name[1]}", since)
            for client, since in list(self._since.items())
        )
        server = self._server
        limits = self._subscriptions
        subscriptions = 0 if server is None else len(server.iserver.subscription_service.subscriptions)
        last = tuple(
            (name, f"{self._last[name].value} (0x{self._last[name].status:08X})")
            for name in ("Inclination", "Azimuth", "GravityToolface", "Heartbeat")
            if name in self._last
        )
        return InterfaceStatus(
            self.name,
            LISTENING if self.running else STOPPED,
            self.address,
            self.failure,
            peers if self.running else (),
            sent=self._written,
            refused=self.refused,
            counts=(
                ("subscriptions", subscriptions),
                ("monitored items", 0 if limits is None else limits.items),
                ("monitored items refused", 0 if limits is None else limits.refused),
                ("commands", self._commands),
                ("errors of history and conditions", self._record_errors),
            ),
            last=last,
        )


def _argument(ua: Any, name: str, kind: str, description: str) -> Any:
    return ua.Argument(
        Name=name,
        DataType=ua.NodeId(getattr(ua.ObjectIds, kind)),
        ValueRank=-1,
        ArrayDimensions=[],
        Description=ua.LocalizedText(description),
    )


# History of the survey variables, from the accepted surveys, readable by HistoryRead (OPC 10000-11).


SURVEY_VARIABLES = {signal.opcua: signal.name for signal in OF_SURVEY}


class SurveyHistory:
    """
    History of the server's survey variables, kept equal to the accepted surveys.

    Parameters
    ----------
    nodes : dict
        Node id of each variable, by its name.
    """

    def __init__(self, ua: Any, server: Any, nodes: Mapping[str, Any]) -> None:
        self._ua, self._server, self._nodes = ua, server, nodes
        self._shown: tuple[AcceptedSurvey, ...] = ()

    async def open(self) -> None:
        """Mark the survey variables as having a history."""
        ua = self._ua
        for name in SURVEY_VARIABLES:
            node = self._server.get_node(self._nodes[name])
            await node.write_attribute(ua.AttributeIds.Historizing, ua.DataValue(True))
            for attribute in (ua.AttributeIds.AccessLevel, ua.AttributeIds.UserAccessLevel):
                await node.set_attr_bit(attribute, ua.AccessLevel.HistoryRead)
        await self._fill(())

    async def show(self, surveys: tuple[AcceptedSurvey, ...]) -> None:
        """Set the accepted surveys, oldest first; a survey that is no longer accepted leaves the history."""
        if surveys != self._shown:
            await self._fill(surveys)

    async def _fill(self, surveys: tuple[AcceptedSurvey, ...]) -> None:
        from asyncua.server.history import HistoryDict

        storage = HistoryDict()
        for name in SURVEY_VARIABLES:
            await storage.new_historized_node(self._nodes[name], None)
        for survey in surveys:
            values = survey_values(survey, survey.decided_ns)
            for name, quantity in SURVEY_VARIABLES.items():
                value = values[quantity]
                reading = VariableValue(value.value, STATUS_CODES[value.condition], survey.result.stamp_ns)
                await storage.save_node_value(self._nodes[name], reading.data_value(self._ua, "Double"))
            # Saving to memory never yields to other tasks, so yield here, after each survey.
            await asyncio.sleep(0)
        self._server.iserver.history_manager.set_storage(storage)
        self._shown = surveys


# Methods of the OPC UA object of a well: decisions on surveys, and control of top drive and pumps.


_INTERFACE = "OPC UA"
Argument = tuple[str, str, str]  #: name, type and description of an argument

_DONE: tuple[Argument, ...] = (
    ("success", "Boolean", "whether the request was carried out"),
    ("message", "String", "the reason if the request was refused"),
)
_DECISION: tuple[Argument, ...] = (
    ("sequence", "UInt32", "number of the survey"),
    ("operator_name", "String", "who decides"),
    ("reason", "String", "why"),
)


@dataclasses.dataclass(frozen=True)
class OpcuaMethod:
    """
    Method of the OPC UA object: its arguments, its results, and the function that carries it out.

    The function receives the arguments and an identity from `OpcuaAccess`, and may be called in any thread.
    """

    name: str
    inputs: tuple[Argument, ...]
    call: Callable[[dict[str, Any], str], Sequence[Any]]
    outputs: tuple[Argument, ...] = _DONE


def survey_methods(on_command: OnCommand) -> list[OpcuaMethod]:
    """Return the methods for surveys; on_command: `on_command(name, arguments) -> (ok, message)` carries them out."""
    table = {
        "take_survey": (("duration", "Double", "averaging time, s; 0: the configured time"),),
        "accept_survey": _DECISION,
        "reject_survey": _DECISION,
    }

    def asking(name: str) -> Callable[[dict[str, Any], str], Sequence[Any]]:
        return lambda arguments, _identity: on_command(name, arguments)

    return [OpcuaMethod(name, inputs, asking(name)) for name, inputs in table.items()]


def control_methods(authority: ControlAuthority) -> list[OpcuaMethod]:
    """Return the control methods."""

    def request(given: dict[str, Any], identity: str) -> Sequence[Any]:
        decision = authority.request(ControlRequest(Sender(_INTERFACE, identity), **given), time.monotonic())
        return decision.message, int(decision.permission), decision.lease

    def command(given: dict[str, Any], identity: str) -> Sequence[Any]:
        return authority.command(SetPoint(**given), time.monotonic(), Sender(_INTERFACE, identity))

    def release(given: dict[str, Any], identity: str) -> Sequence[Any]:
        return authority.release(given["lease"], time.monotonic(), Sender(_INTERFACE, identity), given["reason"])

    lease = ("lease", "UInt32", "number of the lease")
    return [
        OpcuaMethod(
            "request_control",
            (
                ("controller", "String", "name of the controller"),
                ("role", "String", "purpose of the controller, in a word or two"),
                ("priority", "Byte", "0 to 255; a request with a higher priority than the owner's takes control over"),
                ("wait", "Boolean", "whether to wait while another controller has control"),
                ("duration", "Double", "time for which control is requested, s; 0: the longest time allowed"),
            ),
            request,
            (
                ("message", "String", "why the request was refused, or what the request waits for"),
                ("permission", "Byte", "0 denied, 1 pending, 2 granted"),
                ("lease", "UInt32", "number of the lease, or of the pending request; 0: denied"),
            ),
        ),
        OpcuaMethod(
            "set_point",
            (
                lease,
                ("sequence", "UInt32", "number of the set-point, higher than the last; 0: heartbeat only"),
                ("mode", "Byte", "0 hold, 1 rotate, 2 orient, 3 pump, 4 release"),
                ("rotary_speed", "Double", "rotate: rad/s"),
                ("turn", "Double", "orient: rad from the present position of the top drive"),
                ("flow_rate", "Double", "pump: m^3/s"),
                ("valid_for", "Double", "s, above 0; after this time without a new set-point the string is held"),
            ),
            command,
        ),
        OpcuaMethod("release_control", (lease, ("reason", "String", "why")), release),
    ]


# Static part of the address space: the well, its type, its variables with units, and the namespace metadata.


SAMPLING_MS = 100.0  # shortest interval at which values are written


async def add_well(ua: Any, server: Any, well: str) -> tuple[Any, dict[str, Any]]:
    """
    Add the object of the well with its variables.

    Parameters
    ----------
    well : str
        Browse name of the object.

    Returns
    -------
    asyncua.Node
        The object.
    dict
        Node id of each variable by its name.
    """
    index = await server.register_namespace(NAMESPACE)
    await _describe_namespace(ua, server, index)
    kind = await server.nodes.base_object_type.add_object_type(
        ua.NodeId(f"{MANIFEST}Type", index), f"{index}:{MANIFEST}Type"
    )
    # The type declares the variables; the well has its own instances with values.
    await _declare(ua, kind, index)
    node = await server.nodes.objects.add_object(ua.NodeId(MANIFEST, index), f"{index}:{well}")
    objects, organizes = server.nodes.objects, ua.ObjectIds.Organizes
    await _set_type(ua, objects, organizes, node, ua.ObjectIds.BaseObjectType, kind)
    return node, {v.name: (await _variable(ua, node, index, v, f"{MANIFEST}.{v.name}")).nodeid for v in VARIABLES}


async def _declare(ua: Any, kind: Any, index: int) -> None:
    for variable in VARIABLES:
        declared = await _variable(ua, kind, index, variable, f"{MANIFEST}Type.{variable.name}")
        await declared.set_modelling_rule(True)


async def _variable(ua: Any, parent: Any, index: int, variable: Variable, identifier: str) -> Any:
    first = variable_values(nothing_yet())[variable.name].value
    variant = ua.Variant(first, getattr(ua.VariantType, variable.kind))
    node = await parent.add_variable(ua.NodeId(identifier, index), f"{index}:{variable.name}", variant)
    described = ua.DataValue(ua.Variant(ua.LocalizedText(variable.description), ua.VariantType.LocalizedText))
    await node.write_attribute(ua.AttributeIds.Description, described)
    sampling = ua.DataValue(ua.Variant(SAMPLING_MS, ua.VariantType.Double))
    await node.write_attribute(ua.AttributeIds.MinimumSamplingInterval, sampling)
    if variable.unit:
        plain, analog = ua.ObjectIds.BaseDataVariableType, ua.ObjectIds.AnalogUnitType
        await _set_type(ua, parent, ua.ObjectIds.HasComponent, node, plain, analog)
        unit = ua.EUInformation(
            NamespaceUri=UNITS_NAMESPACE,
            UnitId=unit_id(variable.unit),
            DisplayName=ua.LocalizedText(variable.unit),
            Description=ua.LocalizedText(UNITS[variable.unit].name),
        )
        await node.add_property(0, "EngineeringUnits", unit)
    return node


async def _set_type(ua: Any, parent: Any, reference: Any, node: Any, old: Any, new: Any) -> None:
    """
    Change the type of a node.

    The reference of its parent is recreated, because browsing clients read the type from this reference.
    """
    await node.delete_reference(old, ua.ObjectIds.HasTypeDefinition)
    await node.add_reference(new, ua.ObjectIds.HasTypeDefinition, True, False)
    await parent.delete_reference(node, reference)
    await parent.add_reference(node, reference, True, True)


async def _describe_namespace(ua: Any, server: Any, index: int) -> None:
    """Add NamespaceMetadata (OPC 10000-5, 6.3.13): the version, and the statement that node ids never change."""
    namespaces = server.get_node(ua.ObjectIds.Server_Namespaces)
    node = await namespaces.add_object(
        ua.NodeId(f"{MANIFEST}.Metadata", index), f"{index}:{NAMESPACE}", objecttype=ua.ObjectIds.NamespaceMetadataType
    )
    values = {
        "NamespaceUri": ua.Variant(NAMESPACE, ua.VariantType.String),
        "NamespaceVersion": ua.Variant(__version__, ua.VariantType.String),
        "NamespacePublicationDate": ua.Variant(EPOCH, ua.VariantType.DateTime),
        "IsNamespaceSubset": ua.Variant(False, ua.VariantType.Boolean),
        "StaticNodeIdTypes": ua.Variant([int(ua.IdType.String)], ua.VariantType.Int32),
    }
    for name, value in values.items():
        await (await node.get_child(f"0:{name}")).write_value(value)


# Alarms of the well as OPC UA conditions: events of AlarmConditionType, with ConditionRefresh (OPC 10000-9).


# Severity number of an event. Ranges of OPC 10000-5, 6.4.2: 1 to 333 low, 334 to 666 medium, 667 to 1000 high.
_SEVERITY: Mapping[int, int] = {Severity.INFO: 200, Severity.WARNING: 500, Severity.CRITICAL: 900}


class Conditions:
    """
    Sender of alarms as OPC UA events: when an alarm is raised, changes, is acknowledged or ends.

    Parameters
    ----------
    source : asyncua.Node
        Object of the well that is the source of the events.
    """

    def __init__(self, ua: Any, server: Any, source: Any) -> None:
        self._ua, self._server, self._source = ua, server, source
        self._shown: dict[str, Alarm] = {}
        # The event object is shared, so only one task may fill and send it at a time.
        self._sending = asyncio.Lock()

    async def open(self) -> None:
        """Make the well a source of events, and serve ConditionRefresh."""
        ua = self._ua
        await self._source.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
        # The Server object is the root of all event sources, so a client may also subscribe to that object.
        server = self._server.nodes.server
        await server.add_reference(self._source, ua.ObjectIds.HasEventSource, True, False)
        self._events = await self._server.get_event_generator(
            ua.ObjectIds.AlarmConditionType, emitting_node=self._source.nodeid
        )
        # Set the type here, because asyncua does not find the base type of UtcTime by itself.
        self._events.event.data_types["ActiveState/TransitionTime"] = ua.VariantType.DateTime
        self._refresh = [
            await self._server.get_event_generator(kind)
            for kind in (ua.ObjectIds.RefreshStartEventType, ua.ObjectIds.RefreshEndEventType)
        ]
        refresh = self._server.get_node(ua.ObjectIds.ConditionType_ConditionRefresh)
        self._server.link_method(refresh, self._refresh_all)

    async def show(self, alarms: Sequence[Alarm]) -> None:
        """Send the alarms that changed since the last call."""
        now = {alarm.id: alarm for alarm in alarms}
        async with self._sending:
            await self._send_changes(now)

    async def _send_changes(self, now: Mapping[str, Alarm]) -> None:
        for alarm in sorted(now.values(), key=lambda a: a.last_ns):
            before = self._shown.get(alarm.id)
            # An alarm whose cause lasts is counted again and again: if only its count has changed, send no event.
            if before is None or _news(before) != _news(alarm):
                await self._send(alarm, retain=True)
        for gone in self._shown.keys() - now.keys():
            await self._send(self._shown[gone], retain=False)
        self._shown = dict(now)

    async def _refresh_all(self, _parent: Any, subscription: Any) -> list[Any]:
        """Send all alarms again to one subscription, between start and end events, for a client that connects late."""
        start, end = self._refresh
        async with self._sending:
            await start.trigger(subscription_id=subscription.Value)
            for alarm in self._shown.values():
                await self._send(alarm, retain=True, subscription=subscription.Value)
            await end.trigger(subscription_id=subscription.Value)
        return []

    async def _send(self, alarm: Alarm, *, retain: bool, subscription: int | None = None) -> None:
        ua, event, source = self._ua, self._events.event, self._source.nodeid
        active = alarm.active and retain
        acknowledged = alarm.acknowledged or not retain
        fields = {
            "NodeId": ua.NodeId(f"{source.Identifier}.alarm.{alarm.id}", source.NamespaceIndex),
            "ConditionName": alarm.id,
            "ConditionClassId": ua.NodeId(ua.ObjectIds.ProcessConditionClassType),
            "ConditionClassName": ua.LocalizedText("ProcessConditionClass"),
            "BranchId": ua.NodeId(),
            "Retain": retain,
            "Message": ua.LocalizedText(f"{alarm.text}; {alarm.remedy}" if alarm.remedy else alarm.text),
            "Severity": _SEVERITY[alarm.severity],
            "EnabledState": ua.LocalizedText("Enabled"),
            "EnabledState/Id": True,
            "ActiveState": ua.LocalizedText("Active" if active else "Inactive"),
            "ActiveState/Id": active,
            "ActiveState/TransitionTime": moment(alarm.raised_ns if active else alarm.last_ns),
            "AckedState": ua.LocalizedText("Acknowledged" if acknowledged else "Unacknowledged"),
            "AckedState/Id": acknowledged,
            "ClientUserId": alarm.acknowledged_by,
            "Quality": ua.StatusCode(ua.StatusCodes.Good),
        }
        for name, value in fields.items():
            setattr(event, name, value)
        await self._events.trigger(subscription_id=subscription)


def _news(alarm: Alarm) -> tuple[object, ...]:
    return alarm.text, alarm.severity, alarm.active, alarm.acknowledged
