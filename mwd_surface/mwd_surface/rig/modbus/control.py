# SPDX-License-Identifier: Apache-2.0
"""
Holding registers through which a controller takes control: its request at 110, its set-points at 120.

Each block is written as a whole by function 16. A lease belongs to the connection that requested it. A command block
with sequence 0 is a heartbeat.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.set_point import SetPoint
from mwd_surface.control.status import Decision, Permission, Request, Sender
from mwd_surface.rig.modbus.map import CONTROLLER, ModbusForm, float_of, long_of, long_words
from mwd_surface.signals.units import UNITS

REQUEST, REQUEST_COUNT, ANSWER_COUNT = 110, 4, 4
COMMAND, COMMAND_COUNT = 120, 12
_ASK, _RELEASE = 1, 2
_INTERFACE = "Modbus"


class ControlRegisters:
    """
    Control registers of one server.

    Parameters
    ----------
    authority : ControlAuthority
    form : ModbusForm
    clock : callable
        Steady time, s, the same clock as the authority's.
    """

    def __init__(self, authority: ControlAuthority, form: ModbusForm, clock: Callable[[], float]) -> None:
        self._authority, self._form, self._clock = authority, form, clock
        self._last: tuple[int, ...] = (0,) * (REQUEST_COUNT + ANSWER_COUNT)
        self._asked: dict[int, tuple[int, ...]] = {}
        self._command: tuple[int, ...] = (0,) * COMMAND_COUNT

    def blocks(self, connection: int = 0) -> dict[int, tuple[int, ...]]:
        """
        Return the registers that a reader sees, by the address of the first register of each block.

        A connection sees its own last request and answer. A connection without a request sees the last request of all,
        because some masters open a new connection for each request.
        """
        return {REQUEST: self._asked.get(connection, self._last), COMMAND: self._command}

    def forget(self, connection: int) -> None:
        """Drop the stored request and answer of a connection that ended."""
        self._asked.pop(connection, None)

    def write(self, address: int, words: Sequence[int], connection: int = 0) -> bool:
        """Process a block written by a connection; return whether the block was valid and done."""
        if address == REQUEST and len(words) == REQUEST_COUNT:
            return self._ask(tuple(words), connection)
        if address == COMMAND and len(words) == COMMAND_COUNT:
            return self._set(tuple(words), connection)
        return False

    def _ask(self, words: tuple[int, ...], connection: int) -> bool:
        """Process a request: action (1 request, 2 release), controller number, priority, duration in s (0: longest)."""
        action, number, priority, duration = words
        if action == _RELEASE:
            status = self._authority.status(self._clock())
            mine = f"{CONTROLLER}{number}"
            lease = status.lease if status.owner == mine else 0
            lease = status.pending if status.pending_controller == mine else lease
            done, message = self._authority.release(lease, self._clock(), _sender(connection))
            decision = Decision(Permission.DENIED, 0, message)
        elif action == _ASK and number:
            name = f"{CONTROLLER}{number}"
            request = Request(_sender(connection), name, _INTERFACE, priority, duration=float(duration))
            decision = self._authority.request(request, self._clock())
            done = True
        else:
            return False
        lease_words = long_words(decision.lease)
        lease_words = lease_words if self._form.word_order == "ABCD" else lease_words[::-1]
        self._last = self._asked[connection] = (*words, number, int(decision.permission), *lease_words)
        return done

    def _set(self, words: tuple[int, ...], connection: int) -> bool:
        """Process a command: lease (u32), sequence, mode; then f32 speed r/min, turn deg, flow L/min, validity s."""
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
        taken, _ = self._authority.command(point, self._clock(), _sender(connection))
        if taken:
            self._command = words
        return taken


def _sender(connection: int) -> Sender:
    return Sender(_INTERFACE, f"connection {connection}")
