# SPDX-License-Identifier: Apache-2.0
"""Conformance test over Modbus TCP with the blocks of docs/rig/control.md; each client has its own connection."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

from mwd_surface.conformance.bench import Bench, CaseError, ControlAnswer, NotPossibleError, Point, View, Wish
from mwd_surface.control.set_point import Mode

_REQUEST, _COMMAND, _STATE = 110, 120, 38  # first registers of the blocks
_ASK, _RELEASE = 1, 2  # actions of a request
_RPM, _DEGREE, _LITRE_PER_MINUTE = math.pi / 30.0, math.pi / 180.0, 1e-3 / 60.0
_LAG_S = 0.5  # wait for an update of the registers, s; longer than their period of 0.1 s
_LARGEST = 3e38  # largest float32 that is sent


class ModbusConformance:
    """
    Modbus server under test.

    Parameters
    ----------
    unit : int
        Modbus address (unit identifier) of the server.

    Raises
    ------
    ValueError
        The server does not answer.
    """

    name, largest, lag_s = "Modbus", 0xFFFF, _LAG_S

    def __init__(self, host: str, port: int, unit: int = 1) -> None:
        self._where = host, port
        self.unit = unit
        self._peers: dict[int, ModbusPeer] = {}
        self._numbers: dict[str, int] = {}
        self._reader = self.connect()

    def connect(self) -> Any:
        """Return a connected client of pymodbus; raise ValueError if the server does not answer."""
        from pymodbus.client import ModbusTcpClient

        client: Any = ModbusTcpClient(self._where[0], port=self._where[1], timeout=10)
        if not client.connect():
            raise ValueError(f"Modbus {self._where[0]} port {self._where[1]} does not answer")
        return client

    def peer(self, number: int) -> ModbusPeer:
        """Return the client with a number, and connect it at first use."""
        if number not in self._peers:
            self._peers[number] = ModbusPeer(self, self.connect())
        return self._peers[number]

    def number_of(self, name: str) -> int:
        """
        Return the number that stands for a controller's name in Modbus; 0 for an empty name.

        Raises NotPossibleError for a name that a case makes invalid, because Modbus does not transmit names.
        """
        if not name:
            return 0
        if len(name) > 100 or not name.isprintable():
            raise NotPossibleError("a controller over Modbus has a number instead of a name")
        return self._numbers.setdefault(name, 7001 + len(self._numbers))

    def view(self) -> View:
        """Return the public state of the authority."""
        words = self._reader.read_input_registers(_STATE, count=22, device_id=self.unit).registers
        speed, turn = (struct.unpack(">f", struct.pack(">2H", *words[k : k + 2]))[0] for k in (14, 16))
        return View(words[2] << 16 | words[3], words[7], words[5], speed * _RPM, turn * _DEGREE, int(words[0] == 1))

    def attacks(self) -> list[tuple[str, str, Callable[[Bench], tuple[bool, str]]]]:
        """Return the test cases that only this interface has."""
        return [
            ("a set-point is written in part", "exception; the previous set-point stays in force", self._part),
            ("only one register is written", "exception; the previous set-point stays in force", self._single),
            ("a set-point of the owner over a new connection", "refused: it counts as another client", self._again),
        ]

    def _part(self, bench: Bench) -> tuple[bool, str]:
        lease = bench.turning()
        return _stays(bench, lease, self.peer(0).write(_COMMAND, block(lease, 2, Point(speed=0.9))[:6]))

    def _single(self, bench: Bench) -> tuple[bool, str]:
        lease = bench.turning()
        done = not self.peer(0).client.write_register(_COMMAND + 2, 2).isError()
        return _stays(bench, lease, done)

    def _again(self, bench: Bench) -> tuple[bool, str]:
        lease = bench.turning()
        peer = self.peer(0)
        peer.client.close()
        peer.client.connect()
        return _stays(bench, lease, peer.write(_COMMAND, block(lease, 2, Point(Mode.ROTATE, 0.9))))

    def close(self) -> None:
        """Close all clients."""
        for peer in self._peers.values():
            peer.client.close()
        self._reader.close()


class ModbusPeer:
    """Client with a Modbus connection of its own."""

    def __init__(self, interface: ModbusConformance, client: Any) -> None:
        self._interface, self.client = interface, client
        self._names: dict[int, int] = {}

    def write(self, address: int, words: Sequence[int]) -> bool:
        """Write registers by function 16; return whether there was no exception."""
        return not self.client.write_registers(address, list(words), device_id=self._interface.unit).isError()

    def ask(self, wish: Wish) -> ControlAnswer:
        """
        Request control and return the answer.

        Raises
        ------
        NotPossibleError
            The wish has limits or waits, or its duration, in whole seconds, does not fit into a register.
        CaseError
            The server answers the request of another controller.
        """
        if wish.wait or wish.speed or wish.left_speed:
            raise NotPossibleError("a request over Modbus has no such field")
        if not (math.isfinite(wish.duration) and 0.0 <= wish.duration <= 0xFFFF):
            raise NotPossibleError("a duration over Modbus is a whole number of seconds, at most 65535")
        number = self._interface.number_of(wish.name)
        if not self.write(_REQUEST, (_ASK, number, wish.priority, int(wish.duration))):
            return ControlAnswer(0, 0, "exception")
        words = self.client.read_holding_registers(_REQUEST + 4, count=4, device_id=self._interface.unit).registers
        if words[0] != number:
            raise CaseError(f"the request of controller {number} was answered for controller {words[0]}")
        answer = ControlAnswer(words[1], words[2] << 16 | words[3])
        if answer.lease:
            self._names[answer.lease] = number
        return answer

    def send(self, lease: int, sequence: int, point: Point) -> bool:
        """Send a set-point or a heartbeat as a command block; return whether there was no exception."""
        return self.write(_COMMAND, block(lease, sequence, point))

    def release(self, lease: int) -> bool:
        """
        Give a lease back; return whether the interface accepted the request.

        The request contains the controller number with which this client requested the lease. For a lease of another
        client it contains the number of the owner, which every client can read.
        """
        own = self.client.read_input_registers(_STATE + 4, count=1, device_id=self._interface.unit).registers[0]
        return self.write(_REQUEST, (_RELEASE, self._names.get(lease, own), 0, 0))


def block(lease: int, sequence: int, point: Point) -> list[int]:
    """
    Return the register values, 16 bit each, of a command block.

    Finite values are limited to the range of a 32-bit float. Raises NotPossibleError if the mode does not fit into 16
    bit.
    """
    if not 0 <= point.mode <= 0xFFFF:
        raise NotPossibleError("a mode over Modbus is a number of 16 bit")
    values = (point.speed / _RPM, point.turn / _DEGREE, point.flow / _LITRE_PER_MINUTE, point.valid_for)
    floats = [v if not math.isfinite(v) else max(-_LARGEST, min(_LARGEST, v)) for v in values]
    words = struct.unpack(">8H", struct.pack(">4f", *floats))
    return [lease >> 16 & 0xFFFF, lease & 0xFFFF, sequence, point.mode, *words]


def _stays(bench: Bench, lease: int, done: bool) -> tuple[bool, str]:
    view = bench.view()
    return not done and (view.lease, view.sequence) == (lease, 1), f"set-point {view.sequence}"
