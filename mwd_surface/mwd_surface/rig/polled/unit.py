# SPDX-License-Identifier: Apache-2.0
"""
Unit on a polled serial line (RS-485): a surface unit of another maker asks it for inclination, azimuth and toolface.

The frame (format of requests and replies) is that of `mwd_sensors.drivers.polled_line`, so one file describes both ends
of a line.
"""

from __future__ import annotations

import asyncio
import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mwd_sensors.core.settings import setting
from mwd_sensors.drivers import polled_line
from mwd_sensors.drivers.polled_line import Poll, PolledFrame, ReplyItem
from mwd_surface.rig.interface import LISTENING, STOPPED, InterfaceError, InterfaceStatus, RigInterface, optional
from mwd_surface.rig.values import RigValues
from mwd_surface.signals.table import TO_RIG

_STEP_S = 0.005  # time between two reads of the line, s; a host waits a few tenths of a second for a reply
QUANTITIES = tuple(signal.name for signal in TO_RIG)


@functools.cache
def host_frame() -> PolledFrame:
    """Return the frame without a file: Modbus RTU, function 4, registers 0 to 2, in 0.01 deg; 65535 for unknown."""
    items = tuple(
        ReplyItem(name, "uint16", 0.01, unit="deg") for name in ("inclination", "azimuth", "gravity_toolface")
    )
    return PolledFrame(polls=(Poll(4, "00000003", items),))


@dataclasses.dataclass(frozen=True)
class PolledSettings:
    """Settings of the polled serial line of another maker's surface unit."""

    enabled: bool = setting(False, "Answer the polls of another maker's surface unit on a serial line.")
    device: str = setting("/dev/ttyS0", "Serial device of the line.")
    baud: int = setting(9600, "Speed of the line in bits per second. Both ends must agree.", low=300, high=921600)
    frame_file: str = setting(
        "",
        "YAML file with address, requests and replies. Empty: Modbus RTU, unit 1, function 4, with inclination, "
        "azimuth and toolface in registers 0 to 2, in steps of 0.01 deg.",
    )


class PolledUnit(RigInterface):
    """Interface that answers requests on a serial line with the newest values."""

    def __init__(self, settings: PolledSettings) -> None:
        super().__init__("polled")
        self.settings = settings
        self._unit: polled_line.PolledLineUnit | None = None
        self._serial: Any = None

    def start(self) -> None:
        """
        Start answering.

        Raises
        ------
        InterfaceError
            The frame cannot be used, pyserial or pymodbus is missing, or the device cannot be opened.
        """
        optional("pymodbus.framer", "pymodbus", "A polled serial line")
        self._serial = optional("serial", "pyserial", "A polled serial line")
        given = self.settings.frame_file
        try:
            frame = polled_line.read(Path(given).expanduser(), QUANTITIES) if given else host_frame()
        except (ValueError, OSError) as error:
            raise InterfaceError(f"frame_file: {error}") from error
        self._unit = polled_line.PolledLineUnit(frame)
        super().start()

    async def serve(self, ready: Callable[[str], None], stop: asyncio.Event) -> None:
        """Answer requests until `stop` is set; raise InterfaceError if the device cannot be opened or is gone."""
        device = self.settings.device
        try:
            line = self._serial.Serial(device, self.settings.baud, timeout=0, write_timeout=0, exclusive=True)
        except OSError as error:
            raise InterfaceError(f"{device}: {error.strerror or error}") from error
        with line:
            ready(device)
            while not stop.is_set():
                try:
                    answer = self._answer(line.read(max(line.in_waiting, 1)))
                    if answer:
                        line.write(answer)
                except OSError as error:
                    raise InterfaceError(f"{device} is gone: {error.strerror or error}") from error
                await asyncio.sleep(_STEP_S)

    def _answer(self, data: bytes) -> bytes:
        """Return the bytes to send in answer to the bytes that arrived; empty if no answer is due."""
        unit = self._unit
        asked = unit.feed(data) if data and unit is not None else None
        if unit is None or asked is None or isinstance(asked, bytes):
            return asked if isinstance(asked, bytes) else b""
        return polled_line.reply(unit.frame, asked, usable(self.values))

    def status(self) -> InterfaceStatus:
        """Return the state of the interface, with the count of each kind of error on the line."""
        unit = self._unit
        if unit is None or not self.running:
            return InterfaceStatus(self.name, STOPPED, self.settings.device, self.failure)
        reason = "; ".join(f"{count} times {words}" for words, count in unit.trouble.items())
        return InterfaceStatus(self.name, LISTENING, self.settings.device, reason, sent=unit.answered)


def usable(values: RigValues | None) -> dict[str, float]:
    """Return the values that may be used now, in SI, by name; all other values are left out, so they are unknown."""
    if values is None:
        return {}
    return {name: one.value for name, one in values.values.items() if one.condition.usable}
