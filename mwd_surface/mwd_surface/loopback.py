# SPDX-License-Identifier: Apache-2.0
"""Checks of the addresses on which servers listen: reachable by this machine only, and reasons why a port fails."""

from __future__ import annotations

import errno
import ipaddress
import re
import socket


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach an address; False for any name other than localhost."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _is_name(host: str) -> bool:
    """Return whether a text may be an address or the name of a machine, without a port."""
    try:
        host.encode("idna")
    except UnicodeError:
        return False
    return bool(host) and not re.search(r"[\s/\[\]@]|^[^:]*:\d*$", host)


def refused_host(host: str, *, allow_network: bool) -> str:
    """Return why the settings do not allow a server to listen on this host; empty if they do."""
    if not _is_name(host):
        return f"host: {host!r} is not an address; write one such as 127.0.0.1 or ::1, and the port in its own setting"
    if allow_network or is_loopback(host):
        return ""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return (
            f"host: the name {host!r} may lead to an address that other machines reach; write 127.0.0.1 or another"
            " address, or set allow_network if the name is right"
        )
    return f"host: {host} can be reached from other machines; set allow_network if this is intended"


def port_problem(error: OSError, host: str, port: int) -> str:
    """Return a message that says why a network port cannot be opened, and what to do."""
    where = f"{host} port {port}"
    if isinstance(error, socket.gaierror) or (error.errno is not None and error.errno < 0):
        why = error.strerror or error
        return f"{where}: this machine finds no address for the name {host!r} ({why}); correct it, or set 127.0.0.1"
    if error.errno == errno.EADDRINUSE:
        return (
            f"{where} is in use (`ss -ltnp 'sport = :{port}'` names the program);"
            " stop that program, or set another port (0 selects a free one)"
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"{where} may not be opened by this user; set a port of 1024 or more"
    if error.errno in (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT, None):
        return f"{where} is not an address of this machine; set 127.0.0.1 or ::1, or the address of one of its networks"
    return f"{where} cannot be opened: {error.strerror or error}"
