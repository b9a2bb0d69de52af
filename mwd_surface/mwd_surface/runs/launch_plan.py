# SPDX-License-Identifier: Apache-2.0
"""
What `mwd run` starts: the arguments of each node for one well, and what keeps two runs on one machine apart.

A run owns a middleware domain nobody else uses, ports for page and rig, and a folder.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import importlib.util
import math
import os
import socket
import stat
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

# A command that visits a graph is there sooner without the simulator and its compiler.
if TYPE_CHECKING:
    from mwd_sensors.simulator.scenario import Scenario

FIRST_PORT = 8080
TIE_ON = "leg.tie_on_"  # prefix of the tie-on parameters of the surface
WELL = ("surface", "estimator", "sonde")  # nodes that `mwd node well` runs in one process
# How the middleware is set up for streams; a profile of the caller's own comes first.
MIDDLEWARE = Path(__file__).with_name("fastdds.xml")
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
# Interfaces to the rig: their usual port, and the package they need.
_RIG_PORTS = {"wits0_server": (8686, ""), "opcua": (4840, "asyncua"), "modbus": (5020, "pymodbus")}
_RIG_WORDS = {
    "wits0_server": "WITS 127.0.0.1:{}",
    "opcua": "OPC UA opc.tcp://127.0.0.1:{}/",
    "modbus": "Modbus TCP 127.0.0.1:{}",
}
_PORTS = 100
# Domains up to 101 leave their ports below the ephemeral range of Linux.
_DOMAINS = range(1, 101)
_BASE_PORT, _PER_DOMAIN = 7400, 250


def node_words(name: str, namespace: str, parameters: Mapping[str, Any], before: Sequence[str] = ()) -> list[str]:
    """Words that run a node of the graph in this Python; before: of ROS, ahead of its parameters."""
    words = [sys.executable, "-P", "-m", "mwd_surface.cli", "node", name, "--ros-args", "-r", f"__ns:=/{namespace}"]
    # The log file of ROS would hold the same lines again, and nothing bounds it.
    return [*words, "--disable-external-lib-logs", *before, *parameter_words(parameters)]


def parameter_words(parameters: Mapping[str, Any]) -> list[str]:
    """Parameters as the words that follow --ros-args."""
    return [word for key, value in parameters.items() for word in ("-p", f"{key}:={_text(value)}")]


def parameter_yaml(parameters: Mapping[str, Mapping[str, Any]], namespace: str) -> str:
    """Parameters of several nodes as a ROS parameter file: words of one process hold for each of its nodes."""
    lines = []
    for node, given in parameters.items():
        lines += [f"/{namespace}/{node}:", "  ros__parameters:", *(f"    {k}: {_text(v)}" for k, v in given.items())]
    return "\n".join([*lines, ""])


def reference_parameters(scenario: Scenario) -> dict[str, Any]:
    """Parameters of the estimator that name the place and day of a scenario, or the field it sets."""
    from mwd_sensors.simulator.scenario import parse_date

    place = scenario.place
    if scenario.field_override is not None:
        total, dip, declination = scenario.field_override
        return {
            "place.field": "fixed",
            "place.total_nt": float(total),
            "place.dip_deg": float(dip),
            "place.declination_deg": float(declination),
        }
    return {
        "place.field": "igrf" if scenario.model == "igrf" else "model",
        "place.lat_deg": place.latitude_deg,
        "place.lon_deg": place.longitude_deg,
        "place.height_m": place.height_m,
        "place.date": parse_date(scenario.date).date().isoformat(),
    }


def estimator_parameters(scenario: Scenario) -> dict[str, Any]:
    """Parameters of the estimator that follow from a scenario: place, day or field, and the string around the tool."""
    return {**reference_parameters(scenario), "tool.string": scenario.string}


def surface_parameters(scenario: Scenario) -> dict[str, Any]:
    """
    Parameters of the surface that follow from a scenario: place of the well, tie-on, sensor to bit.

    A tie-on that the author of the scenario set for the surface replaces the one of the simulated hole.
    """
    own = any(name.startswith(TIE_ON) for name in scenario.surface)
    return {
        **({} if own else tie_on_parameters(scenario)),
        **scenario.surface,
        "well.sensor_to_bit": scenario.well.sensor_to_bit_m,
        "well.latitude_deg": float(scenario.place.latitude_deg),
        "well.longitude_deg": float(scenario.place.longitude_deg),
    }


def tie_on_parameters(scenario: Scenario) -> dict[str, Any]:
    """
    Parameters of the surface that tie the path to the true hole: to its point one stand above the sensor at the start.

    The last survey of an earlier run would lie about there. The azimuth is from true north.
    """
    import numpy as np

    from mwd_sensors.core import minimum_curvature as mc

    md, inclination, azimuth = np.array(scenario.well.stations, dtype=float).T
    depth = max(0.0, scenario.well.bit_m - scenario.well.sensor_to_bit_m - scenario.rig.stand_m)
    # Beyond both ends of its stations the hole goes straight on; the first one lies straight below the wellhead.
    ends = np.array([min(md[0], depth) - 1.0, max(md[-1], depth) + 1.0])
    stations = (
        np.concatenate([ends[:1], md, ends[1:]]),
        np.radians(np.concatenate([inclination[:1], inclination, inclination[-1:]])),
        np.radians(np.concatenate([azimuth[:1], azimuth, azimuth[-1:]])),
    )
    start = np.array([0.0, 0.0, md[0]]) - (md[0] - ends[0]) * mc.tangent(stations[1][0], stations[2][0])
    # The arcs do not depend on where depth counts from, and the first depth of a path is not negative.
    along = stations[0] - ends[0]
    path = mc.path(along, *stations[1:], start)
    inc, azi, (north, east, down) = mc.interpolate(along, *stations[1:], path, depth - ends[0])
    return {
        f"{TIE_ON}depth": depth,
        f"{TIE_ON}inclination_deg": math.degrees(inc),
        f"{TIE_ON}azimuth_deg": math.degrees(azi) % 360.0,
        f"{TIE_ON}north": float(north),
        f"{TIE_ON}east": float(east),
        f"{TIE_ON}vertical_depth": float(down),
    }


def checked_well(name: str) -> str:
    """
    Name of a well as a ROS namespace, without slashes at its ends.

    Raises
    ------
    ValueError
        It has characters that ROS names cannot have.
    """
    plain = name.strip("/")
    parts = plain.split("/")
    if not all(part.isascii() and part.isidentifier() for part in parts):
        raise ValueError(f"--well {name}: write it with letters, digits and underscores, not beginning with a digit")
    return plain


@contextlib.contextmanager
def page_port(wanted: int | None) -> Iterator[int]:
    """
    The port asked for, else the first free one from `FIRST_PORT` on, held until the block ends.

    Raises
    ------
    ValueError
        The port asked for is taken, or none is free.
    """
    with _free_port(FIRST_PORT, _PORTS) if wanted is None else _free_port(wanted, 1) as port:
        if port is not None:
            yield port
            return
    if wanted is not None:
        raise ValueError(f"--port {wanted}: something listens there already; omit it to use a free port")
    raise ValueError(f"every port from {FIRST_PORT} to {FIRST_PORT + _PORTS - 1} is taken; name another with --port")


@contextlib.contextmanager
def rig_parameters(given: Mapping[str, Any] | None = None) -> Iterator[dict[str, Any]]:
    """
    Parameters of the surface that switch on WITS, OPC UA and Modbus on this machine alone.

    Each has the first free port from its usual one on, or the one in `given`, held until the block ends. One that
    `given` switches off, whose package is not installed, or for which no port is free, stays off.

    Raises
    ------
    ValueError
        A port in `given` is taken.
    """
    parameters: dict[str, Any] = {}
    given = given or {}
    with contextlib.ExitStack() as held:
        for name, (first, package) in _RIG_PORTS.items():
            if not given.get(f"rig.{name}.enabled", True):
                continue
            wanted = int(given.get(f"rig.{name}.port", 0))
            port = held.enter_context(_free_port(wanted, 1) if wanted else _free_port(first, _PORTS))
            if wanted and port is None:
                raise ValueError(f"rig.{name}.port {wanted}: something listens there already; give another one")
            if port is not None and (not package or importlib.util.find_spec(package) is not None):
                parameters |= {f"rig.{name}.enabled": True, f"rig.{name}.port": port}
        yield parameters


def rig_addresses(parameters: Mapping[str, Any]) -> list[str]:
    """Name and address of each rig interface that these parameters of a surface switch on."""
    ports = {name: parameters.get(f"rig.{name}.port") for name in _RIG_PORTS}
    return [_RIG_WORDS[name].format(port) for name, port in ports.items() if port is not None]


@contextlib.contextmanager
def _free_port(first: int, count: int) -> Iterator[int | None]:
    """The first free one of so many ports, held against other runs until the block ends; None where none is."""
    for port in range(first, first + count):
        lock = _locked(f"port_{port}")
        if lock is None:
            continue
        with lock:
            if _bindable(port):
                yield port
                return
    yield None


@contextlib.contextmanager
def own_domain(environment: Mapping[str, str]) -> Iterator[int]:
    """
    A middleware domain for one run, held until the block ends: the one in ROS_DOMAIN_ID, else one nobody uses.

    Raises
    ------
    ValueError
        ROS_DOMAIN_ID is no domain, or none is free.
    """
    given = environment.get("ROS_DOMAIN_ID")
    if given:
        if not given.isdigit() or int(given) > 232:
            raise ValueError(f"ROS_DOMAIN_ID is {given!r}: expected a number from 0 to 101")
        yield int(given)
        return
    first = os.getpid() % len(_DOMAINS)
    for k in range(len(_DOMAINS)):
        domain = _DOMAINS[(first + k) % len(_DOMAINS)]
        lock = _locked(f"domain_{domain}")
        if lock is None:
            continue
        with lock:
            if _quiet(domain):
                yield domain
                return
    raise ValueError("every middleware domain is in use: stop a run, or set ROS_DOMAIN_ID")


def visited_domain(environment: Mapping[str, str], wanted: int | None) -> int:
    """
    The domain of a graph to visit: the one asked for, else ROS_DOMAIN_ID, else that of the one run on this machine.

    Raises
    ------
    ValueError
        Several runs go on, or ROS_DOMAIN_ID is no domain.
    """
    given = environment.get("ROS_DOMAIN_ID")
    if wanted is not None or given:
        text = str(wanted) if wanted is not None else str(given)
        if not text.isdigit() or int(text) > 232:
            raise ValueError(f"domain {text}: expected a number from 0 to 101")
        return int(text)
    running = []
    for domain in _DOMAINS:
        # Only a lock that was made can be held.
        if (_own_folder() / f"domain_{domain}.lock").exists():
            lock = _locked(f"domain_{domain}")
            if lock is None:
                running.append(domain)
            else:
                lock.close()
    if len(running) > 1:
        raise ValueError(f"runs go on in domains {', '.join(map(str, running))}: name the one you mean with --domain")
    return running[0] if running else 0


def graph_environment(environment: Mapping[str, str], domain: int, log_folder: Path | str) -> dict[str, str]:
    """Variables of the nodes: the caller's, discovery on this machine only unless the caller set otherwise."""
    return {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "AMENT_PREFIX_PATH": sys.prefix,
        PROFILES: str(MIDDLEWARE),
        "RCUTILS_COLORIZED_OUTPUT": "0",
        "PYTHONUNBUFFERED": "1",
        **environment,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_LOG_DIR": str(log_folder),
    }


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        # 30 would be a whole number to ROS, and 1e-05 text.
        return repr(value) if math.isfinite(value) and "e" not in repr(value) else f"{value:.12f}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(_text(one) for one in value) + "]"
    # In quotes, so that a date or a number stays text.
    return "'" + str(value).replace("'", "''") + "'" if isinstance(value, str) else str(value)


def _bindable(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _locked(what: str) -> TextIO | None:
    """A lock that two runs starting at once cannot both have; None where another has it."""
    try:
        file = (_own_folder() / f"{what}.lock").open("a")
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        return None
    return file


def _own_folder() -> Path:
    """
    A folder for locks that only this user can write.

    A predictable name in the shared temporary folder could be taken by another user beforehand, as a link or a lock
    that never ends; runs of other users are seen by the ports they bind.

    Raises
    ------
    OSError
        It cannot be made, or somebody else made it.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(runtime) / "mwd" if runtime else Path(tempfile.gettempdir()) / f"mwd-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise PermissionError(errno.EPERM, "is not a folder of this user alone", str(folder))
    return folder


def _quiet(domain: int) -> bool:
    """Whether no participant of that domain has its first unicast port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", _BASE_PORT + _PER_DOMAIN * domain + 10))
        except OSError:
            return False
    return True
