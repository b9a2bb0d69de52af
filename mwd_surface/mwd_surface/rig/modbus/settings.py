# SPDX-License-Identifier: Apache-2.0
"""Settings of Modbus over TCP and over a serial line."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting
from mwd_surface.rig.input import RigInputSettings
from mwd_surface.rig.modbus.map import ModbusForm


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
