# SPDX-License-Identifier: Apache-2.0
"""Settings of the OPC UA server: its address, and the access rights."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class OpcuaSettings:
    """Address of the server, and access rights."""

    enabled: bool = setting(False, "Serve OPC UA.")
    host: str = setting("127.0.0.1", "Address of the network interface on which the server listens.")
    port: int = setting(4840, "TCP port of the server. 0 selects a free port.", low=0, high=65535)
    allow_network: bool = setting(
        False, "Allow a host that other machines can reach. Clients of other machines then need a certificate."
    )
    anonymous: bool = setting(
        True, "Let anonymous clients on this machine read. Clients of other machines always need a certificate."
    )
    allow_commands: bool = setting(False, "Offer methods to clients with a trusted certificate.")
    allow_control: bool = setting(
        False, "Offer the control methods to clients with a trusted certificate. control.enabled must also be set."
    )
    certificates: str = setting(
        "",
        "Folder with the server's certificate own.der and key own.pem, and the folder trusted of client certificates. "
        "Empty: a folder next to the surveys.",
    )
    max_clients: int = setting(
        16, "Largest number of connections at a time. Further connections are refused.", low=1, high=500
    )
    max_subscriptions: int = setting(
        64, "Largest number of subscriptions at a time. Further subscriptions are refused.", low=1, high=1000
    )
