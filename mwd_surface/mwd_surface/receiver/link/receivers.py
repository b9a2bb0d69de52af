# SPDX-License-Identifier: Apache-2.0
"""The receiver of each code; all of them are used in the same way."""

from __future__ import annotations

from typing import Protocol

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.carrier.carrier_receiver import CarrierReceiver
from mwd_surface.receiver.flow_spans import FlowSpans
from mwd_surface.receiver.pulse.pulse_receiver import PulseReceiver
from mwd_surface.receiver.serial_receiver import SerialReceiver
from mwd_surface.receiver.words import Reception


class Receiver(Protocol):
    """What takes samples (pressure, Pa; voltage, V; bytes) and gives words; any cut of them gives the same."""

    last_sync_s: float
    """Start of the last sync, marker or frame that was found, s; -inf before the first."""

    def push(self, time_s: Array, value: Array, /) -> Reception:
        """Take samples, shape (n,) each; gives what they complete."""
        ...

    def finish(self) -> Reception:
        """Words of what is left at the end."""
        ...

    def why_nothing(self) -> str:
        """Reason in one sentence why there is no word."""
        ...


def receiver_of(tool: ToolConfiguration, flow: FlowSpans | None = None) -> Receiver:
    """
    Receiver of a tool; flow: as `PulseReceiver`, for the others do without.

    Raises
    ------
    ValueError
        No receiver reads the code of the tool.
    """
    if tool.code == "psk":
        return CarrierReceiver(tool)
    if tool.code == "serial":
        return SerialReceiver(tool)
    return PulseReceiver(tool, flow)
