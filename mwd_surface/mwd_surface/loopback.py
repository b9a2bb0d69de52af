# SPDX-License-Identifier: Apache-2.0
"""Which addresses only programs on this machine can reach: what may be served without being asked for."""

from __future__ import annotations

import ipaddress


def is_loopback(host: str) -> bool:
    """True for addresses of this machine alone; a name other than localhost may lead anywhere."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
