# SPDX-License-Identifier: Apache-2.0
"""
Checks of this machine for everything that the ROS graph needs: one result per check, with the remedy for a problem.

The checks change nothing and start no node.
"""

from __future__ import annotations

import dataclasses
import enum
import importlib.metadata
import importlib.util
import os
import platform
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

PAGE_PORT = 8080
_PYTHONS = ((3, 11), (3, 12))  # versions for which the ROS wheels are made
_LEAST_DISK = 2 * 10**9  # smallest free space on the disk for recordings, bytes
# Receive buffer of a socket, bytes, as requested in fastdds.xml: one second of messages of three nodes at 1 kHz.
_RECEIVE_BUFFER = 4 * 2**20


class CheckLevel(enum.IntEnum):
    """Severity of the result of a check."""

    OK = 0
    NOTE = 1
    MISSING = 2


@dataclasses.dataclass(frozen=True)
class CheckResult:
    """Result of a check: its subject, level and state, and the remedy (empty if there is nothing to do)."""

    name: str
    level: CheckLevel
    state: str
    remedy: str = ""


def ok(name: str, state: str) -> CheckResult:
    """Return the result of a check that found no problem."""
    return CheckResult(name, CheckLevel.OK, state)


def note(name: str, state: str, remedy: str = "") -> CheckResult:
    """Return the result of a check that found something unusual."""
    return CheckResult(name, CheckLevel.NOTE, state, remedy)


def missing(name: str, state: str, remedy: str) -> CheckResult:
    """Return the result of a check that found something essential missing."""
    return CheckResult(name, CheckLevel.MISSING, state, remedy)


def examine(environment: Mapping[str, str], folder: Path) -> list[CheckResult]:
    """
    Run all checks; return their results, in the order in which problems should be fixed.

    Parameters
    ----------
    environment : mapping
        Environment variables of the process that would run the graph.
    folder : Path
        Folder for recordings.
    """
    checks: tuple[Callable[[], CheckResult], ...] = (
        python,
        *(lambda name=name, why=why: package(name, why) for name, why in _PACKAGES),
        *(lambda one=one: interface(*one) for one in _INTERFACES),
        *(lambda name=name, at=at: rig_port(name, at) for name, at in _RIG_PORTS),
        middleware,
        messages,
        lambda: foreign_ros(environment),
        lambda: discovery(environment),
        receive_buffer,
        lambda: disk(folder),
        lambda: page_port(PAGE_PORT),
        clock,
        *(lambda name=name, why=why: tool(name, why) for name, why in _TOOLS),
    )
    return [check() for check in checks]


_PACKAGES = (
    ("numpy", "all computations"),
    ("numba", "all filters"),
    ("yaml", "settings and scenarios"),
    ("rosbags", "reading recordings"),
    ("zstandard", "reading and writing recordings"),
    ("aiohttp", "the live page"),
    ("pygeomag", "the model of the magnetic field (WMM2025)"),
    ("ppigrf", "the model of the magnetic field of earlier years (IGRF)"),
)
# Purpose, Python module, and distribution to install.
_INTERFACES = (
    ("OPC UA", "asyncua", "asyncua"),
    ("OPC UA certificates", "cryptography", "cryptography"),
    ("Modbus", "pymodbus", "pymodbus"),
    ("WITS over a serial line", "serial", "pyserial"),
    ("Foxglove live", "foxglove", "foxglove-sdk"),
    ("PDF reports", "fpdf", "fpdf2"),
    ("mwd batch", "distributed", "distributed"),
    ("Parquet tables", "pyarrow", "pyarrow"),
)
_RIG_PORTS = (("WITS", 8686), ("OPC UA", 4840), ("Modbus", 5020))
_TOOLS = (
    ("cmake", "building the messages from source"),
    ("c++", "building the messages from source"),
    ("git", "getting the sources"),
)


def python() -> CheckResult:
    """Return OK if the ROS wheels are made for this Python version, else MISSING."""
    version = platform.python_version()
    if sys.version_info[:2] in _PYTHONS:
        return ok("Python", version)
    wanted = " or ".join(f"{a}.{b}" for a, b in _PYTHONS)
    return missing("Python", version, f"install Python {wanted} and run `make setup PYTHON=python3.12`")


def package(name: str, why: str) -> CheckResult:
    """Return OK if a required package is installed, else MISSING; why: its purpose, for the message."""
    if importlib.util.find_spec(name) is None:
        remedy = "run `make setup`, or pip install it into this Python"
        return missing(name, f"not installed; needed for {why}", remedy)
    distribution = {"yaml": "PyYAML"}.get(name, name)
    return ok(name, _version(distribution))


def interface(what: str, module: str, distribution: str) -> CheckResult:
    """Return OK if the package of an optional interface is installed, else NOTE; what: name of the interface."""
    if importlib.util.find_spec(module) is None:
        remedy = f"{Path(sys.prefix) / 'bin' / 'python'} -m pip install {distribution}"
        return note(what, f"not available, because {distribution} is not installed", remedy)
    return ok(what, f"{distribution} {_version(distribution)}")


def rig_port(what: str, port: int) -> CheckResult:
    """Return OK if a rig interface can listen on its usual port, else NOTE; what: name of the interface."""
    remedy = "`mwd run` uses another port; for a surface node, set the port of this interface (rig.*.port)"
    return _port(f"{what} port", port, remedy)


def middleware() -> CheckResult:
    """Return OK if rclpy can be imported, else MISSING; imported in another process, so that a crash gives a result."""
    environment = {k: v for k, v in os.environ.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    words = "import rclpy, sys; from rclpy.utilities import get_rmw_implementation_identifier as f; print(f())"
    done = _ask([sys.executable, "-c", words], environment)
    if done.returncode == 0:
        return ok("ROS 2", f"rclpy with {done.stdout.strip()}")
    last = (done.stderr.strip().splitlines() or ["no answer"])[-1]
    remedy = (
        "run `make setup` for the wheels, or source /opt/ros/jazzy/setup.bash; recordings can be processed without ROS"
    )
    return missing("ROS 2", f"rclpy cannot be imported: {last}", remedy)


def messages() -> CheckResult:
    """Return OK if mwd_msgs is built for this Python, else MISSING."""
    if importlib.util.find_spec("mwd_msgs") is None:
        remedy = "run `make setup`, or `colcon build` and source install/setup.bash"
        return missing("mwd_msgs", "not built", remedy)
    return ok("mwd_msgs", "built")


def foreign_ros(environment: Mapping[str, str]) -> CheckResult:
    """
    Return MISSING if another ROS distribution is sourced, NOTE if AMENT_PREFIX_PATH names other folders, else OK.

    Packages of another installation would be mixed with those of this Python.
    """
    distro = environment.get("ROS_DISTRO", "")
    if distro and distro != "jazzy":
        remedy = "open a new shell in which no other ROS distribution is sourced"
        return missing("environment", f"ROS {distro} is sourced; the program needs jazzy", remedy)
    here = Path(sys.prefix).resolve()
    prefixes = [p for p in environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    others = [p for p in prefixes if Path(p).resolve() != here]
    if others and importlib.util.find_spec("ros_wheels_bootstrapper") is not None:
        state = f"AMENT_PREFIX_PATH also names {', '.join(others)}"
        return note("environment", state, "unset AMENT_PREFIX_PATH, unless you want to use this workspace")
    return ok("environment", distro or "wheels, nothing sourced")


def discovery(environment: Mapping[str, str]) -> CheckResult:
    """
    Return which machines discover the nodes of this machine: NOTE if the whole network does.

    The level is MISSING if ROS_DOMAIN_ID is not a valid domain.
    """
    reach = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    domain = environment.get("ROS_DOMAIN_ID", "0")
    if not domain.isdigit() or int(domain) > 232:
        return missing("domain", f"ROS_DOMAIN_ID is {domain!r}", "set it to a number from 0 to 101")
    if reach.upper() == "SUBNET":
        state = f"domain {domain}, the whole network discovers the nodes and may publish to them"
        return note("discovery", state, "unset ROS_AUTOMATIC_DISCOVERY_RANGE, unless you want this")
    return ok("discovery", f"domain {domain}, {reach}")


def receive_buffer() -> CheckResult:
    """
    Return OK if sockets may have a receive buffer of `_RECEIVE_BUFFER`, else NOTE.

    While the machine is busy, messages that do not fit into the buffer are lost.
    """
    limit = Path("/proc/sys/net/core/rmem_max")
    try:
        most = int(limit.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return note("receive buffer", f"{limit} cannot be read, so the largest receive buffer is unknown")
    state = f"at most {most / 2**20:.1f} MiB for a socket"
    if most < _RECEIVE_BUFFER:
        remedy = (
            f"streams at 1 kHz lose samples on a busy machine; run sudo sysctl -w net.core.rmem_max={_RECEIVE_BUFFER}"
        )
        return note("receive buffer", state, remedy)
    return ok("receive buffer", state)


def disk(folder: Path) -> CheckResult:
    """Return MISSING if recordings cannot be written, NOTE with less than 2 GB (11 h at 1 kHz) free, else OK."""
    place = folder.resolve()
    while not place.exists():
        place = place.parent
    try:
        with tempfile.TemporaryFile(dir=place):
            free = shutil.disk_usage(place).free
    except OSError as error:
        return missing("recordings", f"{folder}: {error.strerror}", "choose another --output folder")
    state = f"{folder}: {free / 1e9:.0f} GB free"
    if free < _LEAST_DISK:
        return note("recordings", state, "free some space, or choose another --output folder")
    return ok("recordings", state)


def page_port(port: int) -> CheckResult:
    """Return OK if the live page can listen on its port, else NOTE."""
    return _port("page", port, "`mwd run` uses another port, or the port of --port")


def clock() -> CheckResult:
    """
    Return NOTE if it is known that no service synchronises the clock of this machine; otherwise OK.

    Stamps of different machines are compared, so their clocks should agree.
    """
    if shutil.which("timedatectl") is None:
        return ok("clock", "not known here")
    done = _ask(["timedatectl", "show", "-p", "NTPSynchronized", "--value"], dict(os.environ))
    if done.returncode == 0 and done.stdout.strip() == "no":
        remedy = "install chrony, if rig data comes from another machine"
        return note("clock", "not synchronised", remedy)
    return ok("clock", "synchronised" if done.returncode == 0 else "not known here")


def tool(name: str, why: str) -> CheckResult:
    """Return OK if a program that only the build needs is installed, else NOTE; why: its purpose, for the message."""
    found = shutil.which(name)
    if found:
        return ok(name, found)
    remedy = f"on Debian or Ubuntu: sudo apt install {'g++' if name == 'c++' else name}"
    return note(name, f"not found; needed for {why}", remedy)


def _version(distribution: str) -> str:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return "installed"


def _port(name: str, port: int, remedy: str) -> CheckResult:
    if taken := port_taken(port):
        return note(name, f"port {port}: {taken}", remedy)
    return ok(name, f"port {port} is free")


def port_taken(port: int) -> str:
    """Return the reason why a program cannot listen on a loopback port; empty if the port is free."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            return error.strerror or str(error)
    return ""


def _ask(words: list[str], environment: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(
            words,
            capture_output=True,
            text=True,
            timeout=20.0,
            check=False,
            env=dict(environment),
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return subprocess.CompletedProcess(words, 1, "", str(error))
