# SPDX-License-Identifier: Apache-2.0
"""
Output of all commands: results on standard output, remarks and progress on standard error.

The library for tables (rich) is imported at the first output, because the help of the commands does not need it.
"""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mwd_sensors.core.foreign_text import printable
from mwd_surface.commands.speech import say

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


class PrintableStream:
    """
    Standard output or error that escapes hidden characters.

    Names of topics and files, and data from peers, may contain control sequences for a terminal. On a terminal, colour
    codes are not escaped, because the help of the commands uses them. Text from other sources may also contain colour
    codes; print such text with `output` and `remarks`, which escape them. The bar of `progress` moves the cursor and
    therefore does not use this stream.
    """

    _COLOUR = re.compile(r"(\x1b\[[0-9;]*m)")

    def __init__(self, stream: Any) -> None:
        self.stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Write a text with hidden characters escaped; return the number of characters written."""
        if self.stream.isatty():
            parts = self._COLOUR.split(text)
            text = "".join(part if k % 2 else printable(part) for k, part in enumerate(parts))
        else:
            text = printable(text)
        return int(self.stream.write(text))

    def writelines(self, lines: Iterable[str]) -> None:
        """Write several texts with hidden characters escaped."""
        for line in lines:
            self.write(line)


def output() -> Console:
    """Return the console for results; lines are never wrapped, except in tables."""
    from mwd_surface.commands.spoken_console import escaping_console

    return escaping_console(stderr=False)


def remarks() -> Console:
    """Return the console for warnings and errors."""
    from mwd_surface.commands.spoken_console import escaping_console

    return escaping_console(stderr=True)


def facts(lines: Iterable[tuple[str, str]], width: int = 13) -> None:
    """Print lines of a name, right-aligned to `width` columns, and its value."""
    from rich.cells import cell_len

    console = output()
    for name, value in lines:
        said = say(name)
        # Translate name and value one by one: together they are not a sentence.
        console.print((f"{' ' * (width - cell_len(said))}{said}  {say(value)}"), markup=False)


def table(names: Iterable[str], left: Container[str] = ("",), *, title: str | None = None) -> Table:
    """Return a table without a frame and with these column names; columns in `left` are aligned left, others right."""
    from mwd_surface.commands.spoken_console import SpokenTable

    made = SpokenTable(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0), header_style="dim")
    for name in names:
        made.add_column(name, justify="left" if name in left else "right")
    return made


def write(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """
    Write files into a folder, created if missing, each completely or not at all, and print their paths.

    Raises
    ------
    OSError
        The folder or a file cannot be written.
    """
    from mwd_sensors.core.output_files import write_whole

    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        write_whole(folder / name, data)
    tell(f"written: {', '.join(str(folder / name) for name in files)}")


def tell(*lines: str) -> None:
    """Print lines of the result."""
    console = output()
    for line in lines:
        console.print(line, markup=False)


def warn(*sentences: str) -> None:
    """Print warnings."""
    from rich.text import Text

    console = remarks()
    for sentence in sentences:
        console.print(Text.assemble(("warning", "yellow"), ": ", sentence))


def remark(sentence: str) -> None:
    """Print a remark that is not a warning."""
    remarks().print(sentence, markup=False)


def _moving() -> Console:
    """Return the console for output that moves the cursor; it does not escape hidden characters."""
    from rich.console import Console

    return Console(file=getattr(sys.stderr, "stream", sys.stderr), soft_wrap=True, highlight=False)


@contextlib.contextmanager
def progress(words: str) -> Iterator[Callable[[float], None]]:
    """
    Show a progress bar during the block, if standard error is a terminal.

    Yield a function that sets the share done, 0 to 1; without a terminal it has no effect.
    """
    if not sys.stderr.isatty():
        yield lambda _share: None
        return
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    words = say(words)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=_moving(), transient=True) as bar:
        task = bar.add_task(printable(words), total=1.0)
        yield lambda share: bar.update(task, completed=share)


@contextlib.contextmanager
def waiting(words: str) -> Iterator[None]:
    """Show a spinner during the block if standard error is a terminal, else print one line."""
    if not sys.stderr.isatty():
        remarks().print(words, markup=False)
        yield
        return
    with _moving().status(printable(say(words))):
        yield


@contextlib.contextmanager
def live_line() -> Iterator[Callable[[str], None]]:
    """Yield a function that shows a line in place of the last line; without a terminal it has no effect."""
    if not sys.stderr.isatty():
        yield lambda _words: None
        return
    from rich.live import Live
    from rich.text import Text

    with Live(Text(""), console=_moving(), transient=True, auto_refresh=False) as live:
        yield lambda words: live.update(Text(printable(say(words)), no_wrap=True, overflow="ellipsis"), refresh=True)
