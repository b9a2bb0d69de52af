# SPDX-License-Identifier: Apache-2.0
"""`mwd security`: write the SROS2 policy of a well."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mwd_surface.commands.speech import say


def security(
    well: Annotated[str, typer.Argument(help="Namespace of the well.")] = "well_1",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write; if omitted, the policy is printed.")
    ] = None,
) -> None:
    """
    Write the SROS2 policy of a well: what each node may publish, subscribe to, serve and call.

    The policy has one enclave for each node, and one for an operator, who may read everything and call services. `ros2
    security create_permission` makes signed permissions from the policy.

    \b
    Example:
      mwd security well_1 -o policy.xml
    """
    from mwd_surface.ros import security_policy

    text = security_policy.policy_xml(security_policy.shipped(), well)
    if output is None:
        typer.echo(text, nl=False)
    else:
        output.write_text(text, encoding="utf-8")
        typer.echo(say(f"written: {output}"))
