# SPDX-License-Identifier: Apache-2.0
"""
Modbus server over TCP or a serial line: controllers and collectors read the register map, and write where allowed.

pymodbus implements the protocol. Input registers (function 4) are answered from one block that is replaced as a whole.
Any other request is refused with the exception code of the protocol.
"""

from __future__ import annotations

import asyncio
import contextvars
import dataclasses
import itertools
import math
import struct
import time
from collections.abc import Callable, Sequence
from typing import Any

from mwd_sensors.core.settings import setting
from mwd_surface import __version__
from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.set_point import SetPoint
from mwd_surface.control.status import ControlDecision, ControlRequest, Permission, Sender
from mwd_surface.rig.input import RigInput, RigInputSettings
from mwd_surface.rig.interface import (
    LISTENING,
    STOPPED,
    InterfaceError,
    InterfaceStatus,
    OnRigState,
    PeerStatus,
    RigInterface,
    bound_log,
    checked_host,
    optional,
    probe_port,
)
from mwd_surface.rig.modbus.map import (
    CONTROLLER,
    COUNT,
    WRITABLE,
    WRITABLE_COUNT,
    ModbusForm,
    float_of,
    long_of,
    long_words,
    registers,
)
from mwd_surface.rig.values import nothing_yet
from mwd_surface.signals.units import UNITS


@dataclasses.dataclass(frozen=True)
class ModbusSettings:
    """Settings of the Modbus TCP server: address, format, and rights to write."""

    enabled: bool = setting(False, "Serve Modbus TCP.")
    host: str = setting("127.0.0.1", "Address of the network interface on which the server listens.")
    port: int = setting(
        5020,
        "TCP port of the server. 0 selects a free port; 502, the standard port, needs privileges.",
        low=0,
        high=65535,
    )
    allow_network: bool = setting(
        False, "Allow a host that other machines can reach. Without it only loopback addresses are accepted."
    )
    unit: int = setting(1, "Unit identifier of the server.", low=1, high=247)
    form: ModbusForm = setting(ModbusForm, "Encoding of numbers in registers.")
    allow_writes: bool = setting(False, "Let clients write the bit depth (float, m) to holding registers 100 and 101.")
    allow_control: bool = setting(
        False,
        "Let clients write control requests and set-points to holding registers 110 to 131. control.enabled must "
        "also be set. Modbus has no password, so use it only on the rig's own network.",
    )
    rig: RigInputSettings = setting(RigInputSettings, "Acceptance of a depth that a client writes.")
    max_clients: int = setting(
        16, "Largest number of connections at a time. Further connections are refused.", low=1, high=200
    )
    idle_timeout: float = setting(
        300.0,
        "Time without a request after which a connection is closed. Raise it for a client that asks seldom.",
        unit="s",
        low=0.2,
        high=86400.0,
    )


@dataclasses.dataclass(frozen=True)
class ModbusSerialSettings:
    """Settings of the serial line of Modbus RTU; the settings of Modbus TCP give unit, encoding and rights."""

    enabled: bool = setting(False, "Serve Modbus RTU over a serial line.")
    device: str = setting("/dev/ttyS0", "Serial device of the line.")
    baud: int = setting(19200, "Speed of the line in bits per second. Both ends must agree.", low=300, high=921600)
    parity: str = setting("none", "Parity bit of the line. Both ends must agree.", choices=("none", "even", "odd"))
    stop_bits: int = setting(1, "Number of stop bits of the line. Both ends must agree.", low=1, high=2)


_READ_INPUT, _READ_HOLDING, _WRITE_MULTIPLE = 4, 3, 16  # function codes of Modbus
# Largest number of bits or registers in one request, by function (Modbus application protocol 1.1b3, section 6).
_MOST_READ = {1: 2000, 2: 2000, 3: 125, 4: 125}
_WRITES = (5, 6, 15, 16, 22, 23)  # function codes that write to coils or registers
# Functions that are answered: reads, writes, and reading the identification (43). To other functions pymodbus would
# answer with example values (24, a queue of registers that does not exist) or a false confirmation (8).
_SERVED = frozenset((*_MOST_READ, *_WRITES, 43))
# Largest number in the length field of a request over TCP: unit and 253 bytes of function and data.
_LONGEST = 254
# Largest number of bytes of requests that wait to be answered, and of answers that wait for a slow reader.
_MOST_WAITING = 16384
_LOOK = 1.0  # time between checks for idle connections, s
_PYMODBUS = 3, 13  # first version of pymodbus with the simulator devices that this server uses


@dataclasses.dataclass
class _Connection:
    transport: Any
    address: str
    since: float
    last_request: float
    requests: int = 0
    received: bytes = b""  #: bytes of requests that are not answered yet
    answering: bool = False  #: whether pymodbus works on a request


class ModbusServer(RigInterface):
    """
    Modbus TCP server of one well.

    Parameters
    ----------
    on_rig_state : callable, optional
        Receives the bit depth that a client wrote, as `wire.RIG_STATE`, if writing is allowed.
    authority : ControlAuthority, optional
        Decides about requests that come through the control registers.
    """

    _called, _what = "modbus", "Modbus TCP"

    def __init__(
        self,
        settings: ModbusSettings,
        on_rig_state: OnRigState | None = None,
        authority: ControlAuthority | None = None,
    ) -> None:
        super().__init__(self._called)
        self.settings = settings
        self.refused = 0
        self.reads = 0
        self.denied = 0
        self._on_rig_state = on_rig_state
        self._input = RigInput(settings.rig)
        self._block = registers(nothing_yet(), settings.form)
        self._connections: dict[int, _Connection] = {}
        self._gone = 0
        self._numbers = itertools.count(1)
        self._written = (0, 0)
        # Number of the connection whose request is answered in the present task.
        self._asking = contextvars.ContextVar("connection", default=0)
        allowed = settings.allow_control and authority is not None
        self._control = ControlRegisters(authority, settings.form) if allowed and authority else None

    def start(self) -> None:
        """
        Start serving.

        Raises
        ------
        InterfaceError
            pymodbus is missing, or the address or port cannot be opened.
        """
        self._server = optional("pymodbus.server", "pymodbus", self._what, _PYMODBUS)
        bound_log("pymodbus")
        self._simulator = optional("pymodbus.simulator", "pymodbus", self._what)
        self._codes = optional("pymodbus.constants", "pymodbus", self._what).ExcCodes
        self._identity = optional("pymodbus", "pymodbus", self._what).ModbusDeviceIdentification
        super().start()

    async def serve(self, ready: Callable[[str], None], stop: asyncio.Event) -> None:
        """Listen until `stop` is set; raise InterfaceError if the host is not allowed or the port cannot be opened."""
        host, port = checked_host(self.settings.host, self.settings.allow_network), self.settings.port
        probe_port(host, port)
        server = self._server.ModbusTcpServer(self._devices(), address=(host, port), identity=self._named())
        await self._serve(server, f"{host} port {port}", ready, stop)

    async def _serve(self, server: Any, where: str, ready: Callable[[str], None], stop: asyncio.Event) -> None:
        """Run a server of pymodbus until `stop` is set; raise InterfaceError if it cannot start; where: its address."""
        # Limit the server to decoding the functions in `_SERVED`.
        table = server.decoder.pdu_table
        server.decoder.pdu_table = {function: classes for function, classes in table.items() if function in _SERVED}
        make = server.callback_new_connection
        server.callback_new_connection = lambda: self._watched(make())
        try:
            await server.serve_forever(background=True)
        except RuntimeError as error:
            raise InterfaceError(f"{where}: {error}") from error
        try:
            ready(self._bound(server))
            await self._follow(stop)
        finally:
            await server.shutdown()
            for connection in list(self._connections.values()):
                connection.transport.abort()

    def _bound(self, server: Any) -> str:
        """Return the address at which a running server answers."""
        return self._peer(server.transport.sockets[0].getsockname())

    async def _follow(self, stop: asyncio.Event) -> None:
        """Replace the block of registers when new values arrive, and check the connections."""
        while not stop.is_set():
            await self.woken(_LOOK)
            if self.values is not None:
                self._block = registers(self.values, self.settings.form)
            self._look_after()

    def _look_after(self) -> None:
        """Close connections that have been idle for too long."""
        now = time.monotonic()
        for connection in list(self._connections.values()):
            if now - connection.last_request > self.settings.idle_timeout:
                connection.transport.close()

    def _devices(self) -> list[Any]:
        data, kinds = self._simulator.SimData, self._simulator.DataType
        blocks = [data(0, values=[0] * COUNT, datatype=kinds.REGISTERS)]
        if self.settings.allow_writes:
            blocks.append(data(WRITABLE, values=[0] * WRITABLE_COUNT, datatype=kinds.REGISTERS))
        if self._control is not None:
            blocks += [
                data(start, values=list(words), datatype=kinds.REGISTERS)
                for start, words in self._control.blocks().items()
            ]
        ours = self._simulator.SimDevice(id=self.settings.unit, simdata=blocks, action=self._answer)
        # This device stands for all other units, which have no registers.
        others = self._simulator.SimDevice(
            id=0, simdata=[data(0, values=[0], datatype=kinds.REGISTERS)], action=self._deny
        )
        return [ours, others]

    def _named(self) -> Any:
        return self._identity(
            info_name={
                "VendorName": "MWD telemetry",
                "ProductCode": "mwd",
                "ProductName": "MWD surface",
                "ModelName": f"register map {self._block[0]}",
                "MajorMinorRevision": __version__,
            }
        )

    async def _answer(
        self, function: int, _start: int, address: int, count: int, current: list[int], wanted: list[Any] | None
    ) -> Any:
        """
        Answer a request to the unit of this server.

        Returns None if the request is carried out, with the words of a read in `current`; otherwise the exception code.
        No other task runs before the reply is complete, so a reader never gets parts of two blocks.
        """
        if function == _READ_INPUT and address + count <= COUNT:
            current[:COUNT] = self._block
            self.reads += 1
            return None
        if self._control is not None and address >= REQUEST:
            return self._answer_control(function, address, count, current, wanted)
        if self.settings.allow_writes and address >= WRITABLE:
            if function == _READ_HOLDING:
                current[WRITABLE : WRITABLE + WRITABLE_COUNT] = self._written
                self.reads += 1
                return None
            if function in _WRITES:
                return self._write(function, address, wanted)
        self.denied += 1
        return self._codes.ILLEGAL_FUNCTION if address + count <= COUNT else self._codes.ILLEGAL_ADDRESS

    def _answer_control(
        self, function: int, address: int, count: int, current: list[int], wanted: list[Any] | None
    ) -> Any:
        control, connection = self._control, self._asking.get()
        for start, words in control.blocks(connection).items() if control is not None else ():
            inside = start <= address and address + count <= start + len(words)
            if function == _READ_HOLDING and inside:
                current[start : start + len(words)] = words
                self.reads += 1
                return None
        if function != _WRITE_MULTIPLE or control is None:
            self.denied += 1
            return self._codes.ILLEGAL_FUNCTION
        if not control.write(address, [int(word) for word in wanted or ()], connection):
            self.denied += 1
            return self._codes.ILLEGAL_VALUE
        return None

    async def _deny(self, *_request: Any) -> Any:
        self.denied += 1
        return self._codes.ILLEGAL_ADDRESS

    def _write(self, function: int, address: int, wanted: list[Any] | None) -> Any:
        if function != _WRITE_MULTIPLE or address != WRITABLE or wanted is None or len(wanted) != WRITABLE_COUNT:
            # A depth needs both words: half a float would be a wrong depth.
            self.denied += 1
            return self._codes.ILLEGAL_VALUE
        words = (int(wanted[0]), int(wanted[1]))
        depth = float_of(words, self.settings.form)
        if not (math.isfinite(depth) and 0.0 <= depth <= self.settings.rig.deepest):
            self.denied += 1
            return self._codes.ILLEGAL_VALUE
        self._written = words
        sample = self._input.take({"bit_depth": depth}, time.time_ns())
        if sample is not None and self._on_rig_state is not None:
            self._on_rig_state(sample)
        return None

    def _watched(self, handler: Any) -> Any:
        """
        Return the handler of a pymodbus connection with its methods replaced.

        The new methods number the connection, limit the number of connections, and record the time of the last request.
        """
        made, lost, received = handler.connection_made, handler.connection_lost, handler.data_received
        handle = handler.handle_request
        # Use a counter, because the address of a deleted object can be used again.
        number = next(self._numbers)

        async def handle_request() -> None:
            self._asking.set(number)
            try:
                await handle()
            finally:
                connection = self._connections.get(number)
                if connection is None:  # the connection ended before its request was handled
                    forget()
                else:
                    connection.answering = False
                    answer_next(connection)

        def answer_next(connection: _Connection) -> None:
            """Give pymodbus one request at a time: it drops all bytes that were received together with a request."""
            while not connection.answering and (request := self._next_request(connection)):
                connection.requests += 1
                answer = self._at_once(request)
                if answer is None:
                    received(request)
                    connection.answering = handler.last_pdu is not None
                else:
                    self.denied += 1
                    connection.transport.write(answer)
            if max(len(connection.received), connection.transport.get_write_buffer_size()) > _MOST_WAITING:
                connection.transport.abort()

        def forget() -> None:
            if self._control is not None:
                self._control.forget(number)

        def connection_made(transport: asyncio.Transport) -> None:
            if len(self._connections) >= self.settings.max_clients:
                self.refused += 1
                handler.listener.active_connections.pop(handler.unique_id, None)
                transport.close()
                return
            peer = transport.get_extra_info("peername") or ("unknown", 0)
            now = time.monotonic()
            self._connections[number] = _Connection(transport, self._peer(peer), now, now)
            made(transport)

        def data_received(data: bytes) -> None:
            connection = self._connections.get(number)
            if connection is not None:
                connection.last_request = time.monotonic()
                connection.received += data
                answer_next(connection)

        def connection_lost(error: Exception | None) -> None:
            connection = self._connections.pop(number, None)
            forget()
            if connection is not None:
                self._gone += connection.requests
                lost(error)

        handler.connection_made, handler.data_received = connection_made, data_received
        handler.connection_lost, handler.handle_request = connection_lost, handle_request
        return handler

    def _peer(self, name: Any) -> str:
        return f"{name[0]}:{name[1]}"

    def _next_request(self, connection: _Connection) -> bytes:
        """Remove and return the first complete request; empty without one. Close a connection that sends junk."""
        head = connection.received[:7]
        if len(head) < 7:
            return b""
        protocol, length = struct.unpack_from(">HH", head, 2)
        if protocol != 0 or not 2 <= length <= _LONGEST:
            connection.received = b""
            connection.transport.abort()
            return b""
        end = 6 + length
        if len(connection.received) < end:
            return b""
        request, connection.received = connection.received[:end], connection.received[end:]
        return request

    def _at_once(self, data: bytes) -> bytes | None:
        return _refusal(data)

    def status(self) -> InterfaceStatus:
        """Return the state of the server."""
        now = time.monotonic()
        connections = list(self._connections.values())
        peers = tuple(
            PeerStatus(
                c.address,
                c.since,
                sent=c.requests,
                received=c.requests,
                rate=c.requests / (now - c.since) if now > c.since else 0.0,
            )
            for c in connections
        )
        requests = self._gone + sum(c.requests for c in connections)
        block = self._block
        return InterfaceStatus(
            self.name,
            LISTENING if self.running else STOPPED,
            self.address,
            self.failure,
            peers,
            sent=self.reads,
            received=requests,
            refused=self.refused,
            counts=(("denied", self.denied), ("rig_samples", self._input.counts.taken)),
            last=(("heartbeat", str(block[1])), ("status", f"{block[2]:016b}"), ("survey", str(block[3]))),
        )


def _refusal(data: bytes) -> bytes | None:
    """
    Return the refusal of a request with a wrong function or number of registers; None if the request is allowed.

    The protocol requires exception 1 or 3 with the requested function code, but pymodbus 3.16 answers exception 1
    with function code 0.
    """
    if len(data) < 8:
        return None
    transaction, protocol, length, unit, function = struct.unpack_from(">HHHBB", data)
    if protocol != 0 or length != len(data) - 6 or function >= 0x80:
        return None
    code = 0 if function in _SERVED else 1
    if len(data) == 12 and function in _MOST_READ:
        (count,) = struct.unpack_from(">H", data, 10)
        code = 0 if 1 <= count <= _MOST_READ[function] else 3
    return struct.pack(">HHHBBB", transaction, 0, 3, unit, function | 0x80, code) if code else None


# Holding registers through which a controller requests control (from 110) and sends set-points (from 120).


REQUEST, REQUEST_COUNT, ANSWER_COUNT = 110, 4, 4  # address of the request; numbers of registers
COMMAND, COMMAND_COUNT = 120, 12  # address and number of registers of a set-point
_ASK, _RELEASE = 1, 2  # action codes in a request for control
_INTERFACE = "Modbus"


class ControlRegisters:
    """Control registers of one server."""

    def __init__(self, authority: ControlAuthority, form: ModbusForm) -> None:
        self._authority, self._form = authority, form
        self._last: tuple[int, ...] = (0,) * (REQUEST_COUNT + ANSWER_COUNT)
        self._asked: dict[int, tuple[int, ...]] = {}
        self._command: tuple[int, ...] = (0,) * COMMAND_COUNT

    def blocks(self, connection: int = 0) -> dict[int, tuple[int, ...]]:
        """
        Return the registers that a connection reads, by the address of the first register of each block.

        A connection reads its own last request and answer. A connection without a request reads the last request of any
        connection, because some masters open a new connection for each request.
        """
        return {REQUEST: self._asked.get(connection, self._last), COMMAND: self._command}

    def forget(self, connection: int) -> None:
        """Drop the stored request and answer of a connection that ended."""
        self._asked.pop(connection, None)

    def write(self, address: int, words: Sequence[int], connection: int = 0) -> bool:
        """Process a block written by a connection; return whether the block was valid and was carried out."""
        if address == REQUEST and len(words) == REQUEST_COUNT:
            return self._ask(tuple(words), connection)
        if address == COMMAND and len(words) == COMMAND_COUNT:
            return self._set(tuple(words), connection)
        return False

    def _ask(self, words: tuple[int, ...], connection: int) -> bool:
        """
        Process a request for control; return whether it was valid and, for a release, whether it was carried out.

        words: action (1 request, 2 release), number of the controller, priority, duration, s (0: the longest allowed).
        """
        action, number, priority, duration = words
        if action == _RELEASE:
            status = self._authority.status(time.monotonic())
            mine = f"{CONTROLLER}{number}"
            lease = status.lease if status.owner == mine else 0
            lease = status.pending if status.pending_controller == mine else lease
            done, message = self._authority.release(lease, time.monotonic(), _sender(connection))
            decision = ControlDecision(Permission.DENIED, 0, message)
        elif action == _ASK and number:
            name = f"{CONTROLLER}{number}"
            request = ControlRequest(_sender(connection), name, _INTERFACE, priority, duration=float(duration))
            decision = self._authority.request(request, time.monotonic())
            done = True
        else:
            return False
        lease_words = long_words(decision.lease)
        lease_words = lease_words if self._form.word_order == "ABCD" else lease_words[::-1]
        self._last = self._asked[connection] = (*words, number, int(decision.permission), *lease_words)
        return done

    def _set(self, words: tuple[int, ...], connection: int) -> bool:
        """
        Process a set-point; return whether it was accepted.

        words: lease (32-bit integer), sequence, mode, then four 32-bit floats: rotary speed, r/min; turn, deg; flow,
        L/min; validity, s.
        """
        speed, turn, flow, valid_for = (float_of(words[k : k + 2], self._form) for k in (4, 6, 8, 10))
        point = SetPoint(
            words[3],
            long_of(words[:2], self._form),
            words[2],
            rotary_speed=speed / UNITS["rad/s"].modbus.factor,
            turn=turn / UNITS["rad"].modbus.factor,
            flow_rate=flow / UNITS["m^3/s"].modbus.factor,
            valid_for=valid_for,
        )
        taken, _ = self._authority.command(point, time.monotonic(), _sender(connection))
        if taken:
            self._command = words
        return taken


def _sender(connection: int) -> Sender:
    return Sender(_INTERFACE, f"connection {connection}")


# Server on a serial line.


class ModbusSerial(ModbusServer):
    """
    Register map served over a serial line that may have several units: requests to other units are ignored.

    Parameters
    ----------
    line : ModbusSerialSettings
        Settings of the line; the other arguments are those of `ModbusServer`.
    """

    _called, _what = "modbus_serial", "Modbus RTU"

    def __init__(
        self,
        line: ModbusSerialSettings,
        settings: ModbusSettings,
        on_rig_state: OnRigState | None = None,
        authority: ControlAuthority | None = None,
    ) -> None:
        super().__init__(settings, on_rig_state, authority)
        self.line = line
        self._seen = False

    def start(self) -> None:
        """
        Start serving.

        Raises
        ------
        InterfaceError
            pymodbus or pyserial is missing, or the device cannot be opened.
        """
        self._serial = optional("serial", "pyserial", self._what)
        super().start()

    async def serve(self, ready: Callable[[str], None], stop: asyncio.Event) -> None:
        """Answer requests until `stop` is set; raise InterfaceError if the device cannot be opened or is gone."""
        line, self._seen = self.line, False
        try:
            # Open the device once before pymodbus does, because pymodbus gives no reason when it fails.
            self._serial.Serial(line.device, line.baud, timeout=0, exclusive=True).close()
        except OSError as error:
            raise InterfaceError(f"{line.device}: {error.strerror or error}") from error
        server = self._server.ModbusSerialServer(
            self._devices(),
            port=line.device,
            baudrate=line.baud,
            parity=line.parity[0].upper(),
            stopbits=line.stop_bits,
            identity=self._named(),
        )
        await self._serve(server, line.device, ready, stop)

    def _bound(self, _server: Any) -> str:
        return self.line.device

    def _watched(self, handler: Any) -> Any:
        """Return the handler of the line with its methods replaced; it answers only requests to the unit."""
        send = handler.server_send

        def server_send(answer: Any, address: Any) -> None:
            if answer is not None and answer.dev_id == self.settings.unit:
                send(answer, address)

        handler.server_send = server_send
        return super()._watched(handler)

    def _look_after(self) -> None:
        """Raise InterfaceError if the device is gone, so that the interface restarts; a silent line is not an error."""
        if self._seen and not self._connections:
            raise InterfaceError(f"{self.line.device} is gone")
        self._seen = bool(self._connections)

    def _peer(self, _name: Any) -> str:
        return self.line.device

    def _next_request(self, connection: _Connection) -> bytes:
        """Return all bytes: pymodbus finds the requests of a line, where the next one comes after the answer."""
        request, connection.received = connection.received, b""
        return request

    def _at_once(self, _data: bytes) -> bytes | None:
        return None
