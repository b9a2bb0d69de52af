# SPDX-License-Identifier: Apache-2.0
"""
Launch plan of `mwd run`: the arguments of each node of one well, and the resources that separate runs on one machine.

Each run has its own middleware domain, its own ports for page and rig interfaces, and its own folder.
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

from mwd_surface.runs.doctor import port_taken

# Import only for type annotations: commands for a running graph start faster without the simulator and its compiler.
if TYPE_CHECKING:
    from mwd_sensors.simulator.scenario import Scenario

FIRST_PORT = 8080  # first port that is tried for the page
TIE_ON = "leg.tie_on_"  # prefix of the tie-on parameters of the surface
WELL = ("surface", "estimator", "sonde")  # nodes that `mwd node well` runs in one process
# Profile of Fast DDS for streams at high rates; a profile that the user has set takes precedence.
MIDDLEWARE = Path(__file__).with_name("fastdds.xml")
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
# Interfaces to the rig: usual port, and required package.
_RIG_PORTS = {"wits0_server": (8686, ""), "opcua": (4840, "asyncua"), "modbus": (5020, "pymodbus")}
_RIG_WORDS = {
    "wits0_server": "WITS 127.0.0.1:{}",
    "opcua": "OPC UA opc.tcp://127.0.0.1:{}/",
    "modbus": "Modbus TCP 127.0.0.1:{}",
}
_PORTS = 100  # number of ports that are tried
# The ports of domains up to 101 are below the ephemeral range of Linux.
_DOMAINS = range(1, 101)
_BASE_PORT, _PER_DOMAIN = 7400, 250  # first port, and number of ports per domain (PB and DG of DDSI-RTPS)


def node_words(name: str, namespace: str, parameters: Mapping[str, Any], before: Sequence[str] = ()) -> list[str]:
    """Return the command line that runs a node with this Python; before: ROS arguments that precede the parameters."""
    words = [sys.executable, "-P", "-m", "mwd_surface", "node", name, "--ros-args", "-r", f"__ns:=/{namespace}"]
    # The enclave of SROS2 names the node's keys and permissions; ROS ignores it if security is off.
    words += ["--enclave", f"/{namespace}/{name}"]
    # Disable the log files of ROS, because they would have the same lines again, without a size limit.
    return [*words, "--disable-external-lib-logs", *before, *parameter_words(parameters)]


def parameter_words(parameters: Mapping[str, Any]) -> list[str]:
    """Return the arguments that follow --ros-args for the given parameters."""
    return [word for key, value in parameters.items() for word in ("-p", f"{key}:={_text(value)}")]


def parameter_yaml(parameters: Mapping[str, Mapping[str, Any]], namespace: str) -> str:
    """
    Return the text of a ROS parameter file for several nodes of one process.

    A file is needed because parameters on the command line apply to every node of the process.
    """
    lines = []
    for node, given in parameters.items():
        lines += [f"/{namespace}/{node}:", "  ros__parameters:", *(f"    {k}: {_text(v)}" for k, v in given.items())]
    return "\n".join([*lines, ""])


def reference_parameters(scenario: Scenario) -> dict[str, Any]:
    """Return the parameters of the estimator for the place and day of a scenario, or for its fixed field."""
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
    """
    Return the parameters of the estimator that follow from a scenario: place, day or field, the string, the gyros.

    The only parameter of the precision unit is its g-sensitivity. The estimator finds the bias and the noise of the
    unit from the stations of a run. One station does not show the g-sensitivity, so the sigma of the gyro azimuth
    contains the full stated value.
    """
    from mwd_sensors.simulator.instrument_grade import grade

    unit = scenario.precision
    gyros = {} if unit is None else {"tool.precision.gyro.g_deg_h_g": grade(unit.grade, unit.changes).gyro.g_deg_h_g}
    return {**reference_parameters(scenario), "tool.string": scenario.string, **gyros}


def surface_parameters(scenario: Scenario) -> dict[str, Any]:
    """
    Return the parameters of the surface that follow from a scenario: place of the well, tie-on, sensor to bit.

    A tie-on in the surface settings of the scenario replaces the tie-on that is computed from the simulated hole.
    """
    own = any(name.startswith(TIE_ON) for name in scenario.surface)
    return {
        **({} if own else tie_on_parameters(scenario)),
        "well.convention": scenario.well.convention,
        **scenario.surface,
        "well.sensor_to_bit": scenario.well.sensor_to_bit_m,
        "well.latitude_deg": float(scenario.place.latitude_deg),
        "well.longitude_deg": float(scenario.place.longitude_deg),
    }


def tie_on_parameters(scenario: Scenario) -> dict[str, Any]:
    """
    Return the parameters of a tie-on on the true hole, one stand above the sensor's position at the start.

    The last survey of an earlier run would be at about this depth. The azimuth is from true north.
    """
    import numpy as np

    from mwd_sensors.core import minimum_curvature as mc

    md, inclination, azimuth = scenario.well.hole
    depth = max(0.0, scenario.well.bit_m - scenario.well.sensor_to_bit_m - scenario.rig.stand_m)
    # The hole is straight above the first and below the last station; the wellhead is vertically above the first one.
    ends = np.array([min(md[0], depth) - 1.0, max(md[-1], depth) + 1.0])
    stations = (
        np.concatenate([ends[:1], md, ends[1:]]),
        np.concatenate([inclination[:1], inclination, inclination[-1:]]),
        np.concatenate([azimuth[:1], azimuth, azimuth[-1:]]),
    )
    start = np.array([0.0, 0.0, md[0]]) - (md[0] - ends[0]) * mc.tangent(stations[1][0], stations[2][0])
    # The arcs do not depend on the origin of depth, and a path must begin at a depth that is not negative.
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
    Return the name of a well as a ROS namespace, without slashes at its ends.

    Raises
    ------
    ValueError
        The name has characters that ROS does not allow in names.
    """
    plain = name.strip("/")
    parts = plain.split("/")
    if not all(part.isascii() and part.isidentifier() for part in parts):
        raise ValueError(f"--well {name}: write it with letters, digits and underscores, not beginning with a digit")
    return plain


@contextlib.contextmanager
def page_port(wanted: int | None) -> Iterator[int]:
    """
    Yield the requested port, or else the first free port from `FIRST_PORT` on; other runs cannot use it in this block.

    Raises
    ------
    ValueError
        The requested port is in use, or no port is free.
    """
    with _free_port(FIRST_PORT, _PORTS) if wanted is None else _free_port(wanted, 1) as port:
        if port is not None:
            yield port
            return
    if wanted is not None:
        raise ValueError(f"--port {wanted}: another program listens there already; omit it to use a free port")
    raise ValueError(f"every port from {FIRST_PORT} to {FIRST_PORT + _PORTS - 1} is in use; choose another with --port")


@contextlib.contextmanager
def rig_parameters(given: Mapping[str, Any] | None = None) -> Iterator[dict[str, Any]]:
    """
    Yield the parameters of the surface that enable WITS, OPC UA and Modbus, on this machine only.

    Each interface gets the port in `given`, or the first free port from its usual port on; other runs cannot use this
    port until the block ends. An interface is off if `given` disables it, its package is not installed, or no port is
    free.

    Raises
    ------
    ValueError
        A port in `given` is in use.
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
                raise ValueError(
                    f"rig.{name}.port {wanted}: another program listens there already; choose another port"
                )
            if port is not None and (not package or importlib.util.find_spec(package) is not None):
                parameters |= {f"rig.{name}.enabled": True, f"rig.{name}.port": port}
        yield parameters


def rig_addresses(parameters: Mapping[str, Any]) -> list[str]:
    """Return name and address of each rig interface that these parameters of a surface enable."""
    ports = {name: parameters.get(f"rig.{name}.port") for name in _RIG_PORTS}
    return [_RIG_WORDS[name].format(port) for name, port in ports.items() if port is not None]


@contextlib.contextmanager
def _free_port(first: int, count: int) -> Iterator[int | None]:
    """
    Yield the first free port of `count` ports from `first` on, which other runs cannot use until the block ends.

    Yield None if no port is free.
    """
    for port in range(first, first + count):
        lock = _locked(f"port_{port}")
        if lock is None:
            continue
        with lock:
            if not port_taken(port):
                yield port
                return
    yield None


@contextlib.contextmanager
def own_domain(environment: Mapping[str, str]) -> Iterator[int]:
    """
    Yield the middleware domain of one run: ROS_DOMAIN_ID, or else a domain that no other run uses until the block ends.

    Raises
    ------
    ValueError
        ROS_DOMAIN_ID is not a valid domain, or no domain is free.
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
    Return the domain of the graph to connect to.

    It is the requested domain, else ROS_DOMAIN_ID, else the domain of the only run on this machine, or 0 without a run.

    Raises
    ------
    ValueError
        Several runs are active, or ROS_DOMAIN_ID is not a valid domain.
    """
    given = environment.get("ROS_DOMAIN_ID")
    if wanted is not None or given:
        text = str(wanted) if wanted is not None else str(given)
        if not text.isdigit() or int(text) > 232:
            raise ValueError(f"domain {text}: expected a number from 0 to 101")
        return int(text)
    running = []
    for domain in _DOMAINS:
        # A run holds a lock on the file of its domain, so skip domains without a file.
        if (_own_folder() / f"domain_{domain}.lock").exists():
            lock = _locked(f"domain_{domain}")
            if lock is None:
                running.append(domain)
            else:
                lock.close()
    if len(running) > 1:
        raise ValueError(f"runs are active in domains {', '.join(map(str, running))}: choose one with --domain")
    return running[0] if running else 0


def graph_environment(environment: Mapping[str, str], domain: int, log_folder: Path | str) -> dict[str, str]:
    """Return the environment of the nodes; discovery is limited to this machine unless the caller sets it."""
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
        # Write a decimal point and no exponent: ROS would read 30 as an integer, and 1e-05 as text.
        return repr(value) if math.isfinite(value) and "e" not in repr(value) else f"{value:.12f}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(_text(one) for one in value) + "]"
    # Quote a text, so that ROS does not read it as a date or a number.
    return "'" + str(value).replace("'", "''") + "'" if isinstance(value, str) else str(value)


def _locked(what: str) -> TextIO | None:
    """Return a lock file that only one run at a time can hold; None if another run holds it, or it cannot be opened."""
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
    Return a folder for locks that only this user can write.

    In the shared temporary folder another user could create a predictable name beforehand, as a link or with a lock
    that is never released. Runs of other users are detected by the ports that they use.

    Raises OSError if the folder cannot be created, or other users can write to it (PermissionError).
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(runtime) / "mwd" if runtime else Path(tempfile.gettempdir()) / f"mwd-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise PermissionError(errno.EPERM, "is not a folder that only this user can write to", str(folder))
    return folder


def _quiet(domain: int) -> bool:
    """Return whether the first unicast port of a domain is free, so that the domain has no participant."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", _BASE_PORT + _PER_DOMAIN * domain + 10))
        except OSError:
            return False
    return True
