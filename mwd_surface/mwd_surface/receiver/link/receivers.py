# SPDX-License-Identifier: Apache-2.0
"""Choice of the receiver for a telemetry code; all receivers have the same interface."""

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
    """Interface of a receiver: samples (Pa, V or bytes) in, words out, independent of the cut into blocks."""

    last_sync_s: float  #: begin of the last sync, marker or frame found, s; -inf before the first

    def push(self, time_s: Array, value: Array, /) -> Reception:
        """Add samples, shape (n,) each; return the words and frames that they complete."""
        ...

    def finish(self) -> Reception:
        """Return the words of the samples that are left at the end."""
        ...

    def why_nothing(self) -> str:
        """Return the reason, in one sentence, why no word was received."""
        ...


def receiver_of(tool: ToolConfiguration, flow: FlowSpans | None = None) -> Receiver:
    """
    Return the receiver for a tool; flow: as in `PulseReceiver`, other receivers do not use it.

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
