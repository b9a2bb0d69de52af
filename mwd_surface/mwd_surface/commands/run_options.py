# SPDX-License-Identifier: Apache-2.0
"""Options of `mwd run` in addition to the scenario: node settings, parameter files, plan, secret of the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

_SETTINGS = "Settings"
_LEAST_SECRET = 8  # characters, as required by the page

Hold = Annotated[bool, typer.Option("--hold", help="Keep running after the scenario, until Ctrl-C.")]
SingleProcess = Annotated[
    bool,
    typer.Option("--single-process", help="Sonde, estimator and surface in one process: less CPU load, no restarts."),
]
Token = Annotated[
    str | None,
    typer.Option(
        help="Secret for the operator controls of the page, 8 characters or more; `new` creates and prints one.",
        rich_help_panel=_SETTINGS,
    ),
]
Plan = Annotated[
    Path | None, typer.Option(help="Planned path, CSV or WITSML, for the page.", rich_help_panel=_SETTINGS)
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="One parameter of a node, e.g. estimator.survey.duration_s=12; the node's name is optional if only one "
        "has it. May be repeated.",
        metavar="NAME=VALUE",
        rich_help_panel=_SETTINGS,
    ),
]
Params = Annotated[
    Path | None,
    typer.Option("--params", help="ROS parameter file for the nodes named in it.", rich_help_panel=_SETTINGS),
]


def set_parameters(parameters: dict[str, dict[str, Any]], given: Sequence[str] | None) -> None:
    """
    Add the parameters of --set to those of the nodes.

    parameters : by name of the node; changed in place.

    Raises
    ------
    SettingsError
        No node has the parameter (similar names are listed), several have it, or its value is not allowed.
    """
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_sensors.core import settings
    from mwd_sensors.nodes.sonde import SondeSettings
    from mwd_surface.commands.reference_options import assignments
    from mwd_surface.nodes.settings import SurfaceSettings

    usual: dict[str, Any] = {"estimator": EstimatorSettings(), "surface": SurfaceSettings(), "sonde": SondeSettings()}
    known = {node: settings.flat(one) for node, one in usual.items()}
    changes: dict[str, dict[str, Any]] = {}
    for name, value in assignments(given).items():
        node, _, rest = name.partition(".")
        if node in known:
            changes.setdefault(node, {})[rest] = value
            continue
        owners = [owner for owner, table in known.items() if name in table]
        if len(owners) > 1:
            raise settings.SettingsError(
                f"{name}: both {' and '.join(owners)} have it; write for example {owners[0]}.{name}"
            )
        if not owners:
            there = [*known["estimator"], *(f"{o}.{n}" for o in ("surface", "sonde") for n in known[o])]
            raise settings.SettingsError(settings.unknown_key(name, there, ""))
        changes.setdefault(owners[0], {})[name] = value
    for node, table in changes.items():
        checked = settings.flat(settings.changed(usual[node], table))
        parameters[node] |= {name: checked[name][0] for name in table}


def page_secret(token: str | None, folder: Path) -> dict[str, Any]:
    """
    Return surface parameters for a secret of the page's controls; it is stored in a file readable only by its owner.

    Raises
    ------
    ValueError
        The secret is too short.
    """
    import os
    import secrets

    if token is None:
        return {}
    if token == "new":  # noqa: S105  (a word, not a secret)
        token = secrets.token_urlsafe(9)
        typer.echo(f"token of the page: {token}")
    if len(token) < _LEAST_SECRET:
        raise ValueError(f"--token: write {_LEAST_SECRET} characters or more, or `new`")
    file = folder / "page_token"
    file.unlink(missing_ok=True)
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as opened:
        opened.write(token + "\n")
    return {"page.token_file": str(file.resolve())}


def parameter_file(params: Path | None) -> list[str]:
    """
    Return the ROS arguments for a parameter file; the parameters of the node itself have priority over it.

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
