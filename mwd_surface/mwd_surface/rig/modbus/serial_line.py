# SPDX-License-Identifier: Apache-2.0
"""Modbus RTU: the register map over a serial line."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from mwd_surface.control.authority import ControlAuthority
from mwd_surface.rig.interface import (
    InterfaceError,
    OnRigState,
    optional,
)
from mwd_surface.rig.modbus.server import ModbusServer
from mwd_surface.rig.modbus.settings import ModbusSerialSettings, ModbusSettings


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

    def _at_once(self, _data: bytes) -> bytes | None:
        return None
