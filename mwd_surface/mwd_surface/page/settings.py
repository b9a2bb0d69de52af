# SPDX-License-Identifier: Apache-2.0
"""Settings of the live page: address, access and limits."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class PageSettings:
    """Settings of the live page: address, access and limits."""

    host: str = setting("127.0.0.1", "Address of the network interface on which the page is served.")
    port: int = setting(8080, "TCP port of the page. 0 selects a free port.", low=0, high=65535)
    allow_network: bool = setting(
        False, "Allow a host that other machines can reach. Without it only loopback addresses are accepted."
    )
    allowed_hosts: tuple[str, ...] = setting(
        (),
        "Further host names under which the page answers requests. Other names are refused, as protection against "
        "DNS rebinding.",
    )
    token_file: str = setting(
        "",
        "File whose first line is the secret for the operator controls: at least 8 characters, in a file that only "
        "you can read. If empty, the environment variable MWD_PAGE_TOKEN is used; without either the page is "
        "read-only.",
    )
    time_zone: str = setting(
        "",
        "Time zone of the rig, for example Europe/Oslo, shown on the page in addition to UTC. If empty, the page "
        "shows UTC alone.",
    )
    language: str = setting(
        "en",
        "Language of the page for browsers in which nobody has chosen one: en, zh_CN, or the code of another "
        "catalogue.",
    )
    max_rate: float = setting(
        15.0,
        "Largest number of updates per second to one browser. Raising it costs computing time for each browser.",
        unit="Hz",
        low=0.5,
        high=20.0,
    )
    max_clients: int = setting(
        32, "Largest number of browsers that receive updates at a time. Further browsers are refused.", low=1, high=500
    )
    max_connections: int = setting(
        96, "Largest number of connections at a time. Further connections are refused.", low=4, high=1000
    )
    max_per_peer: int = setting(
        64,
        "Largest number of connections from one address at a time. Further connections are refused. Raise it if "
        "many browsers share one address.",
        low=2,
        high=1000,
    )
    request_timeout: float = setting(
        5.0,
        "Longest time that a client may take to send a request. Raise it for a slow network.",
        unit="s",
        low=0.1,
        high=60.0,
    )
    command_timeout: float = setting(
        15.0,
        "Longest time that the page waits for the node to answer a command. Raise it for a slow computer.",
        unit="s",
        low=0.5,
        high=120.0,
    )
    send_timeout: float = setting(
        10.0,
        "Time without accepting data after which a browser is disconnected. Raise it for a slow network.",
        unit="s",
        low=0.2,
        high=120.0,
    )
