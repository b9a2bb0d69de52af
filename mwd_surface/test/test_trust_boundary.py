# SPDX-License-Identifier: Apache-2.0
"""What stands in a file goes to nobody else, and what a file or peer sends moves no terminal."""

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core.input_files import without_contents
from mwd_sensors.core.settings import printable
from mwd_surface.commands.terminal import PrintableStream
from mwd_surface.list_files.list_columns import ListFileError
from mwd_surface.nodes.plan_server import PlanServer
from mwd_surface.nodes.settings import PlanSettings

SECRET = "hunter2-correct-horse"  # noqa: S105


@pytest.mark.parametrize(
    "text",
    [
        SECRET,
        f"{SECRET}\n{SECRET}\n",
        f"md_m,inc_deg,azi_deg\n0,0,0\n{SECRET},1,2\n",
        f"md_m,inc_deg,azi_deg,{SECRET}\n0,0,{SECRET},1\n",
        f"~V\nVERS. 2.0:\n~{SECRET}\n{SECRET}.{SECRET}:{SECRET}\n~A\n{SECRET}",
        f"<{SECRET}><a>{SECRET}</b></{SECRET}>",
    ],
)
def test_a_secret_named_as_the_plan_is_in_no_alarm_and_on_no_terminal(tmp_path, text, capfd):
    file = tmp_path / "plan.csv"
    file.write_text(text)
    found = PlanServer.read(PlanSettings(file=str(file)), "true")
    assert isinstance(found, ListFileError)
    assert SECRET not in str(found)
    assert str(file) in str(found)
    assert SECRET not in "".join(capfd.readouterr())


def test_a_line_and_an_error_of_the_disk_are_still_named(tmp_path):
    file = tmp_path / "plan.csv"
    file.write_text("md_m,inc_deg,azi_deg\n0,0,0\nx,1,2\n")
    assert "line 3" in str(PlanServer.read(PlanSettings(file=str(file)), "true"))
    assert "No such file" in str(PlanServer.read(PlanSettings(file=str(tmp_path / "none.csv")), "true"))
    assert "no regular file" in without_contents("x", OSError(22, "is no regular file"))


class Terminal(io.StringIO):
    def isatty(self):
        return True


@given(st.text())
def test_no_control_character_reaches_a_terminal(text):
    plain, terminal = io.StringIO(), Terminal()
    PrintableStream(plain).write(text)
    PrintableStream(terminal).write(text)
    for written in (plain.getvalue(), terminal.getvalue()):
        assert all(c in "\n\t" or not (ord(c) < 32 or 127 <= ord(c) < 160) for c in written)
    assert printable("inc 5.2°\tm\n") == "inc 5.2°\tm\n"


def test_colours_pass_on_a_terminal_alone_and_nothing_that_moves_its_cursor_does():
    plain, terminal = io.StringIO(), Terminal()
    for stream in (plain, terminal):
        PrintableStream(stream).write("\x1b[31mred\x1b[0m \x1b[2J\x1b]0;title\x07")
    assert terminal.getvalue() == "\x1b[31mred\x1b[0m \\x1b[2J\\x1b]0;title\\x07"
    assert "\x1b" not in plain.getvalue()
