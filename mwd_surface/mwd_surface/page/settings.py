# SPDX-License-Identifier: Apache-2.0
"""Settings of the live page: address, access and limits."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class PageSettings:
    """Address of the page, who may request it, and its limits."""

    host: str = setting("127.0.0.1", "address of the network interface to listen on", fixed=True)
    port: int = setting(8080, "TCP port; 0 selects a free port", low=0, high=65535, fixed=True)
    allow_network: bool = setting(
        False, "allow an address that other machines can reach; needed for any host other than loopback", fixed=True
    )
    allowed_hosts: tuple[str, ...] = setting(
        (),
        "further host names under which requests are answered; others are refused as protection against DNS rebinding",
        fixed=True,
    )
    token_file: str = setting(
        "",
        "file whose first line is the secret for the operator controls, at least 8 characters, readable only by you; "
        "if empty, the environment variable MWD_PAGE_TOKEN is used, and without it the page is read-only",
        fixed=True,
    )
    time_zone: str = setting(
        "",
        "time zone of the rig, shown on the page beside UTC, for example Europe/Oslo; if empty, UTC alone",
        fixed=True,
    )
    language: str = setting(
        "en",
        "language of the page in browsers where nobody has chosen one: en, zh_CN, or that of another catalogue",
        fixed=True,
    )
    max_rate: float = setting(
        15.0,
        "largest number of updates per second to one browser; raising it costs computing time per browser",
        unit="Hz",
        low=0.5,
        high=20.0,
        fixed=True,
    )
    max_clients: int = setting(32, "largest number of browsers that receive updates", low=1, high=500, fixed=True)
    max_connections: int = setting(96, "largest number of connections at a time", low=4, high=1000, fixed=True)
    max_per_peer: int = setting(64, "largest number of connections from one address", low=2, high=1000, fixed=True)
    request_timeout: float = setting(
        5.0, "longest time a client may take to send a request", unit="s", low=0.1, high=60.0, fixed=True
    )
    command_timeout: float = setting(
        15.0, "longest wait for the node to answer a command", unit="s", low=0.5, high=120.0, fixed=True
    )
    send_timeout: float = setting(
        10.0,
        "time without accepting data after which a browser is disconnected",
        unit="s",
        low=0.2,
        high=120.0,
        fixed=True,
    )
