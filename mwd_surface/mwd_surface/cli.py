# SPDX-License-Identifier: Apache-2.0
"""The `mwd` command: one line for each command, and one way to end with an error."""

from __future__ import annotations

import errno
import functools
import importlib
import io
import math
import os
import sys
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

# Print the help of commands without rich, the library that draws frames: importing it takes longer than all the rest.
os.environ.setdefault("TYPER_USE_RICH", "0")
import typer
from typer.core import TyperGroup

from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.linear_algebra import use_one_thread
from mwd_surface.commands.help_text import SpokenContext, summary, with_spoken_help
from mwd_surface.commands.speech import choose, say
from mwd_surface.commands.terminal import PrintableStream

# Panels of the help with their commands, in order. A command is the function, or group of functions, of its name in
# the module of the same name, unless `_MODULES` names another module.
PANELS = {
    "Live": ("run", "replay", "node", "emulate", "call", "downlink", "param", "topic", "rig"),
    "Recordings": (
        "inspect",
        "process",
        "log",
        "batch",
        "compare",
        "survey",
        "path",
        "trajectory",
        "clearance",
        "forecast",
        "export",
        "report",
        "finalize",
        "simulate",
        "decode",
        "view",
        "listen",
        "plot",
        "calibrate",
        "recover",
        "memory",
        "bag",
        "tool",
        "scenario",
    ),
    "Planning": ("tools", "sag", "spacing"),
    "This machine": ("doctor", "security", "version", "bundle"),
}
_MODULES = {
    "call": "graph",
    "param": "graph",
    "topic": "graph",
    "report": "export",
    "simulate": "scenario",
    "recover": "bag",
    "sag": "assembly",
    "spacing": "assembly",
}
# Commands that accept arguments for ROS, which they pass on.
_PASSING = ("replay", "node")


def with_finite_numbers(command: Any) -> Any:
    """
    Return a command and its subcommands, which refuse NaN and infinity in place of a number.

    NaN passes every comparison with a limit, so that a command would compute results from it without a word. An option
    whose default is infinity, such as a duration, accepts infinity.
    """
    run = command.callback

    @functools.wraps(run)
    def checked(**arguments: Any) -> Any:
        for parameter in command.params:
            value = arguments.get(parameter.name)
            if isinstance(value, float) and not math.isfinite(value) and value != parameter.default:
                raise typer.BadParameter(f"'{value}' is not a valid float.", param_hint=f"'{parameter.opts[0]}'")
        return run(**arguments)

    if run is not None:
        command.callback = checked
    for below in getattr(command, "commands", {}).values():
        with_finite_numbers(below)
    return command


class _Commands(Mapping[str, Any]):
    """Commands by name. The module of a command is imported, and the command is made, when it is first needed."""

    def __init__(self) -> None:
        self._names = [name for names in PANELS.values() for name in names]
        self._made: dict[str, Any] = {}

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names in the order of the help."""
        return iter(self._names)

    def __len__(self) -> int:
        """Return the number of commands."""
        return len(self._names)

    def __getitem__(self, name: str) -> Any:
        """Return the command of a name."""
        if name not in self._made:
            one = self.source(name)
            if isinstance(one, typer.Typer):
                command: Any = typer.main.get_group(one)
            else:
                alone = typer.Typer(add_completion=False)
                passes = name in _PASSING
                alone.command(context_settings={"allow_extra_args": passes, "ignore_unknown_options": passes})(one)
                command = typer.main.get_command(alone)
            command.name = name
            self._made[name] = with_finite_numbers(with_spoken_help(command))
        return self._made[name]

    def source(self, name: str) -> Any:
        """Return the function or the group of a command."""
        if name not in self._names:
            raise KeyError(name)
        return getattr(importlib.import_module(f"mwd_surface.commands.{_MODULES.get(name, name)}"), name)


class _Panels(TyperGroup):
    """Group of all commands; its help lists them by panel."""

    context_class = SpokenContext

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: Any = _Commands()

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write one section for each panel."""
        # Two spaces before each name, and two after the longest name.
        limit = formatter.width - 6 - max(map(len, self.commands))
        for panel, names in PANELS.items():
            with formatter.section(panel):
                formatter.write_dl([(name, summary(self.commands.source(name), limit)) for name in names])


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
        from mwd_surface.commands.version import version

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
    # Choose the language before the commands are created, because their help texts are made with them.
    given = next((pair[1] for pair in zip(sys.argv[1:], sys.argv[2:], strict=False) if pair[0] == "--language"), None)
    given = next((one.partition("=")[2] for one in sys.argv[1:] if one.startswith("--language=")), given)
    if given is not None:
        choose(given)
    command = typer.main.get_command(app)
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
