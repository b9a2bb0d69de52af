# SPDX-License-Identifier: Apache-2.0
"""Settings of the OPC UA server: its address, and who may do what."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class OpcuaSettings:
    """Where the server is and who may do what."""

    enabled: bool = setting(False, "serve OPC UA", fixed=True)
    host: str = setting("127.0.0.1", "address of the network interface to listen on", fixed=True)
    port: int = setting(4840, "TCP port; 0: any that is free", low=0, high=65535, fixed=True)
    allow_network: bool = setting(
        False, "listen on an address that other machines can reach; certificates are then needed", fixed=True
    )
    anonymous: bool = setting(
        True,
        "allow anonymous clients of this machine to read; clients of other machines always need a certificate",
        fixed=True,
    )
    allow_commands: bool = setting(False, "offer methods to clients with a trusted certificate", fixed=True)
    allow_control: bool = setting(
        False,
        "offer the methods of control to clients with a trusted certificate; control.enabled must be set, too",
        fixed=True,
    )
    certificates: str = setting(
        "", "folder of own.der, own.pem and the folder trusted; empty: beside the surveys", fixed=True
    )
    max_clients: int = setting(16, "most connections at a time", low=1, high=500, fixed=True)
    max_subscriptions: int = setting(64, "subscriptions at a time", low=1, high=1000, fixed=True)
