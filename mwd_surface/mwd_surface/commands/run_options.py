# SPDX-License-Identifier: Apache-2.0
"""Parameters that the user of `mwd run` gives to the nodes: settings, parameter files, secret of the page."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import typer

from mwd_sensors.core import settings
from mwd_sensors.core.settings import SettingsError
from mwd_surface.commands.shared_options import assignments, flattened
from mwd_surface.commands.speech import say

_LEAST_SECRET = 8  # least number of characters of a secret, as required by the page

# Parameters that only an option of `mwd run` may set, with the name of the option or the remedy.
OF_OPTIONS = {
    "surface.folder": "mwd run keeps recording, lists and logs in one folder; choose the folder with -o",
    "surface.serve_page": "mwd run reads the state of the nodes from the page, so it cannot run without a page; start "
    "the nodes by a launch file instead",
    "sonde.scenario": "name the scenario as the argument of mwd run, because other parameters follow from it",
}
# Parameters that an option of `mwd run` also sets, with the name of the option.
_ALSO = {
    "surface.page.port": "--port",
    "surface.plan.file": "--plan",
    "surface.page.token_file": "--token",
    "surface.record.enabled": "--no-record",
    "estimator.gravity.method": "--method",
    "sonde.rate": "--rate",
    "sonde.seed": "--seed",
}


def give_parameters(
    parameters: dict[str, dict[str, Any]],
    namespace: str,
    *,
    changes: Sequence[str] | None = None,
    params: Path | None = None,
    options: Mapping[str, Any] | None = None,
) -> None:
    """
    Replace parameters that `mwd run` computes by those that the user gives; --set has precedence over --params.

    parameters: computed parameters by node name; changed in place. namespace: namespace of the well.
    options: values of the given options, by name.

    Raises
    ------
    SettingsError
        A parameter of --set is refused by `set_parameters`, may be set only by an option, or is set to another value by
        an option.
    """
    given: dict[str, dict[str, Any]] = {node: {} for node in parameters}
    in_file = [] if params is None else [f"{node}.{name}" for node, name in _take_file(given, params, namespace)]
    set_parameters(given, changes)
    for node, table in given.items():
        for name, value in table.items():
            full = f"{node}.{name}"
            where = f"{full} in {params}" if full in in_file else f"--set {full}"
            if full in OF_OPTIONS and not (full == "surface.serve_page" and value):
                raise SettingsError(f"{where}: {OF_OPTIONS[full]}")
            option = _ALSO.get(full, "")
            if option in (options or {}) and (options or {})[option] != value:
                raise SettingsError(f"{where} and {option} contradict each other: give one of them")
        parameters[node] |= table


def _take_file(given: dict[str, dict[str, Any]], params: Path, namespace: str) -> list[tuple[str, str]]:
    """Add the values of a parameter file to `given`; return the node and name of each parameter in the file."""
    usual, found = _usual(), []
    for node in given:
        if node in usual:
            known = settings.flat(usual[node])
            table = {k: v for k, v in file_parameters(params, f"/{namespace}/{node}").items() if k in known}
            checked = settings.flat(settings.changed(usual[node], table))
            given[node] |= {name: checked[name][0] for name in table}
            found += [(node, name) for name in table]
    return found


def file_parameters(params: Path, node: str) -> dict[str, Any]:
    """
    Return the parameters that a ROS parameter file has for a node; node: full name.

    A section has the name of a node, or a pattern with `*` for one part of the name and `**` for any number of parts.
    If several sections set a parameter, the last one holds, as in ROS.

    Raises
    ------
    ValueError
        The file is not a ROS parameter file in YAML.
    """
    from mwd_sensors.core.input_files import read_yaml

    sections = read_yaml(params)
    found: dict[str, Any] = {}
    for path, table in _sections(sections if isinstance(sections, dict) else {}):
        if _matches(path, node.strip("/").split("/")):
            found |= flattened(table)
    return found


def _sections(table: Mapping[Any, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[list[str], Mapping[Any, Any]]]:
    for key, value in table.items():
        if key == "ros__parameters" and isinstance(value, dict):
            yield [part for part in "/".join(path).split("/") if part], value
        elif isinstance(value, dict):
            yield from _sections(value, (*path, str(key)))


def _matches(pattern: Sequence[str], parts: Sequence[str]) -> bool:
    if not pattern:
        return not parts
    if pattern[0] == "**":
        return any(_matches(pattern[1:], parts[k:]) for k in range(len(parts) + 1))
    return bool(parts) and pattern[0] in ("*", parts[0]) and _matches(pattern[1:], parts[1:])


def _usual() -> dict[str, Any]:
    """Return the default settings of each node that has parameters, by name of the node."""
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_sensors.nodes.sonde import SondeSettings
    from mwd_surface.nodes.receiver_settings import ReceiverSettings
    from mwd_surface.nodes.settings import SurfaceSettings

    usual = {"estimator": EstimatorSettings(), "surface": SurfaceSettings(), "sonde": SondeSettings()}
    return {**usual, "receiver": ReceiverSettings()}


def set_parameters(parameters: dict[str, dict[str, Any]], given: Sequence[str] | None) -> None:
    """
    Add the parameters of --set to the parameters of the nodes.

    parameters: parameters by node name; changed in place.

    Raises
    ------
    SettingsError
        No node has the parameter (similar names are listed), several have it, its value is not allowed, or the node
        is not in `parameters`.
    """
    usual = _usual()
    known = {node: settings.flat(one) for node, one in usual.items()}
    changes: dict[str, dict[str, Any]] = {}
    for name, value in assignments(given).items():
        node, _, rest = name.partition(".")
        if node in known:
            changes.setdefault(node, {})[rest] = value
            continue
        # The receiver has parameters of the same names; they are set as receiver.NAME.
        owners = [owner for owner, table in known.items() if name in table and owner != "receiver"]
        if len(owners) > 1:
            raise SettingsError(
                f"{name}: {' and '.join(owners)} have this parameter; write for example {owners[0]}.{name}"
            )
        if not owners:
            there = [*known["estimator"], *(f"{o}.{n}" for o in ("surface", "sonde") for n in known[o])]
            raise SettingsError(settings.unknown_key(name, there, ""))
        changes.setdefault(owners[0], {})[name] = value
    for node, table in changes.items():
        checked = settings.flat(settings.changed(usual[node], table))
        if node not in parameters:
            raise SettingsError(f"--set {node}: this run has no node {node}")
        parameters[node] |= {name: checked[name][0] for name in table}


def page_secret(token: str | None, folder: Path) -> dict[str, Any]:
    """
    Return the surface parameters for a secret that protects the page's controls; empty if `token` is None.

    The secret is stored in a file in `folder` that only its owner can read. "new" makes and prints a random secret.

    Raises
    ------
    ValueError
        The secret is too short.
    OSError
        The file cannot be written.
    """
    import secrets

    if token is None:
        return {}
    if token == "new":  # noqa: S105  (a word, not a secret)
        token = secrets.token_urlsafe(9)
        typer.echo(say(f"token of the page: {token}"))
    if len(token) < _LEAST_SECRET:
        raise ValueError(f"--token: must have {_LEAST_SECRET} characters or more, or be `new`")
    file = folder / "page_token"
    file.unlink(missing_ok=True)
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as opened:
        opened.write(token + "\n")
    return {"page.token_file": str(file.resolve())}


def parameter_file(params: Path | None) -> list[str]:
    """
    Return the ROS arguments for a parameter file; an empty list if `params` is None.

    Other parameters of the node follow these arguments and have precedence over the file.

    Raises
    ------
    OSError
        The file does not exist.
    """
    if params is None:
        return []
    if not params.is_file():
        raise FileNotFoundError(2, "parameter file not found", str(params))
    return ["--params-file", str(params.resolve())]
