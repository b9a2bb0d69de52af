# SPDX-License-Identifier: Apache-2.0
"""Settings of the OPC UA server: its address, and who may do what."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class OpcuaSettings:
    """Address of the server, and access rights."""

    enabled: bool = setting(False, "serve OPC UA", fixed=True)
    host: str = setting("127.0.0.1", "address of the network interface to listen on", fixed=True)
    port: int = setting(4840, "TCP port; 0 selects a free port", low=0, high=65535, fixed=True)
    allow_network: bool = setting(
        False, "allow an address that other machines can reach; certificates are then required", fixed=True
    )
    anonymous: bool = setting(
        True,
        "allow anonymous clients on this machine to read; clients of other machines always need a certificate",
        fixed=True,
    )
    allow_commands: bool = setting(False, "offer methods to clients with a trusted certificate", fixed=True)
    allow_control: bool = setting(
        False,
        "offer the control methods to clients with a trusted certificate; control.enabled must also be set",
        fixed=True,
    )
    certificates: str = setting(
        "", "folder with own.der, own.pem and the folder trusted; empty: next to the surveys", fixed=True
    )
    max_clients: int = setting(16, "largest number of connections at a time", low=1, high=500, fixed=True)
    max_subscriptions: int = setting(64, "largest number of subscriptions at a time", low=1, high=1000, fixed=True)
