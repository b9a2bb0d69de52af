# SPDX-License-Identifier: Apache-2.0
"""The `mwd` command: one line for each command, and one way to end with an error."""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Annotated, Any

# Print the help of commands without rich, the library that draws frames: importing it takes longer than all the rest.
os.environ.setdefault("TYPER_USE_RICH", "0")
import typer
from typer.core import TyperGroup

from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.linear_algebra import use_one_thread
from mwd_surface.commands import downlink, memory
from mwd_surface.commands.assembly import sag, spacing
from mwd_surface.commands.bag import bag, recover
from mwd_surface.commands.batch import batch
from mwd_surface.commands.bundle import bundle
from mwd_surface.commands.calibrate import calibrate
from mwd_surface.commands.clearance import clearance
from mwd_surface.commands.compare import compare
from mwd_surface.commands.decode import decode
from mwd_surface.commands.doctor import doctor
from mwd_surface.commands.emulate import emulate
from mwd_surface.commands.export import export, report
from mwd_surface.commands.finalize import finalize
from mwd_surface.commands.forecast import forecast
from mwd_surface.commands.graph import call, param, topic
from mwd_surface.commands.help_text import with_spoken_help
from mwd_surface.commands.inspect import inspect
from mwd_surface.commands.listen import listen
from mwd_surface.commands.log import log
from mwd_surface.commands.node import PASS_ON, node
from mwd_surface.commands.path import path
from mwd_surface.commands.plot import plot
from mwd_surface.commands.process import process
from mwd_surface.commands.replay import replay
from mwd_surface.commands.rig import rig
from mwd_surface.commands.run import run
from mwd_surface.commands.scenario import scenario, simulate
from mwd_surface.commands.security import security
from mwd_surface.commands.speech import choose, say
from mwd_surface.commands.survey import survey
from mwd_surface.commands.terminal import PrintableStream
from mwd_surface.commands.tool import tool
from mwd_surface.commands.tools import tools
from mwd_surface.commands.trajectory import trajectory
from mwd_surface.commands.version import version
from mwd_surface.commands.view import view


class _Panels(TyperGroup):
    """Group whose help lists the commands by panel."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write one section for each panel, in the order of their first commands."""
        panels: dict[str, list[tuple[str, str]]] = {}
        # Two spaces before each name, and two after the longest name.
        limit = formatter.width - 6 - max(map(len, self.commands))
        for name, command in self.commands.items():
            panel = getattr(command, "rich_help_panel", "")
            panels.setdefault(panel, []).append((name, command.get_short_help_str(limit)))
        for panel, rows in panels.items():
            with formatter.section(panel):
                formatter.write_dl(rows)


app = typer.Typer(
    name="mwd",
    cls=_Panels,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Measurement while drilling on ROS 2: run, record, replay and reprocess.",
)


def _versions(wanted: bool) -> None:
    if wanted:
        version()
        raise typer.Exit


def _language(code: str | None) -> None:
    if code is not None:
        choose(code)


@app.callback()
def _top(
    _version_option: Annotated[
        bool, typer.Option("--version", help="Print the versions and exit.", is_eager=True, callback=_versions)
    ] = False,
    _language_option: Annotated[
        str | None,
        typer.Option(
            "--language",
            metavar="CODE",
            help="Language of help and messages, e.g. zh_CN; by default from the environment variable LANGUAGE, "
            "LC_ALL, LC_MESSAGES or LANG.",
            is_eager=True,
            callback=_language,
        ),
    ] = None,
) -> None:
    """Options of `mwd` itself."""


_LIVE, _RECORDINGS, _PLANNING, _MACHINE = "Live", "Recordings", "Planning", "This machine"
app.command(rich_help_panel=_LIVE)(run)
app.command(rich_help_panel=_LIVE, context_settings=PASS_ON)(replay)
app.command(rich_help_panel=_LIVE, context_settings=PASS_ON)(node)
app.command(rich_help_panel=_LIVE)(emulate)
app.add_typer(downlink.app, name="downlink", rich_help_panel=_LIVE)
app.command(rich_help_panel=_RECORDINGS)(inspect)
app.command(rich_help_panel=_RECORDINGS)(process)
app.command(rich_help_panel=_RECORDINGS)(log)
app.add_typer(memory.app, name="memory", rich_help_panel=_RECORDINGS)
app.command(rich_help_panel=_RECORDINGS)(batch)
app.command(rich_help_panel=_RECORDINGS)(compare)
app.command(rich_help_panel=_RECORDINGS)(survey)
app.command(rich_help_panel=_RECORDINGS)(path)
app.command(rich_help_panel=_RECORDINGS)(trajectory)
app.command(rich_help_panel=_RECORDINGS)(clearance)
app.command(rich_help_panel=_RECORDINGS)(forecast)
app.command(rich_help_panel=_RECORDINGS)(export)
app.command(rich_help_panel=_RECORDINGS)(report)
app.command(rich_help_panel=_RECORDINGS)(finalize)
app.command(rich_help_panel=_RECORDINGS)(simulate)
app.command(rich_help_panel=_RECORDINGS)(decode)
app.command(rich_help_panel=_RECORDINGS)(view)
app.command(rich_help_panel=_RECORDINGS)(listen)
app.command(rich_help_panel=_RECORDINGS)(plot)
app.command(rich_help_panel=_RECORDINGS)(calibrate)
app.command(rich_help_panel=_RECORDINGS)(recover)
app.command(rich_help_panel=_LIVE)(call)
app.add_typer(param, name="param", rich_help_panel=_LIVE)
app.add_typer(topic, name="topic", rich_help_panel=_LIVE)
app.add_typer(rig, name="rig", rich_help_panel=_LIVE)
app.add_typer(bag, name="bag", rich_help_panel=_RECORDINGS)
app.add_typer(tool, name="tool", rich_help_panel=_RECORDINGS)
app.add_typer(scenario, name="scenario", rich_help_panel=_RECORDINGS)
app.command(rich_help_panel=_PLANNING)(tools)
app.command(rich_help_panel=_PLANNING)(sag)
app.command(rich_help_panel=_PLANNING)(spacing)
app.command(rich_help_panel=_MACHINE)(doctor)
app.command(rich_help_panel=_MACHINE)(security)
app.command(rich_help_panel=_MACHINE)(version)
app.command(rich_help_panel=_MACHINE)(bundle)

# Base class of the errors of click, which reads the arguments; newer versions of typer include their own click.
_ClickError: Any = typer.BadParameter.__mro__[2]
_FULL = ": free some space on this disk, or write to another disk"
_REMEDIES = {
    errno.ENOSPC: _FULL,
    errno.EDQUOT: _FULL,
    errno.EROFS: ": write to another folder",
    errno.EMFILE: ": close other programs, or raise the limit on open files (ulimit -n)",
}


def main() -> None:
    """
    Run one command and end the process.

    Status 0 means success, 2 (with one sentence) a fault of input, settings or disk, and 130 an interrupt by a person.
    """
    # Sourcing a ROS environment would set this variable; the packages of this Python are found without an environment.
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    # By default nodes find only nodes on this machine, and users outside the group cannot read the files.
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    use_one_thread()
    os.umask(os.umask(0o077) | 0o027)
    sys.stdout = PrintableStream(sys.stdout)
    sys.stderr = PrintableStream(sys.stderr)
    try:
        _run()
    except BrokenPipeError:
        # The reader of the pipe has closed it: redirect the output, so that Python reports no error on exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except (ValueError, OSError) as error:
        _end(error)
    except Exception as error:
        from mwd_surface.bags.bag_reader import BagError
        from mwd_surface.bags.definitions import DefinitionError
        from mwd_surface.exports.export import ExportError

        if not isinstance(error, (BagError, DefinitionError, ExportError)):
            raise
        _end(error)


def _run() -> None:
    """
    Run the command of the arguments, and end the process with its status.

    The library that reads the arguments writes its messages in English; they are translated as all other texts are.
    """
    # The language is needed before the tree of the commands is made, because it has their help.
    given = next((pair[1] for pair in zip(sys.argv[1:], sys.argv[2:], strict=False) if pair[0] == "--language"), None)
    given = next((one.partition("=")[2] for one in sys.argv[1:] if one.startswith("--language=")), given)
    if given is not None:
        choose(given)
    command = with_spoken_help(typer.main.get_command(app))
    try:
        status = command(prog_name="mwd", standalone_mode=False)
    except _ClickError as error:
        page = io.StringIO()
        error.show(file=page)
        sys.stderr.write(say(page.getvalue()))
        sys.exit(error.exit_code)
    sys.exit(status if isinstance(status, int) else 0)


def _end(error: BaseException) -> None:
    sentence = str(error)
    if isinstance(error, OSError) and error.strerror:
        sentence = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
        sentence += _REMEDIES.get(error.errno or 0, "")
    print("mwd:", printable(say(sentence)), file=sys.stderr)
    sys.exit(2)


if __name__ == "__main__":
    main()
