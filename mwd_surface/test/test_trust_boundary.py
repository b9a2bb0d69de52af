# SPDX-License-Identifier: Apache-2.0
"""What stands in a file goes to nobody else, and what a file or peer sends moves no terminal."""

import ast
import contextlib
import dataclasses
import io
import sys
from types import SimpleNamespace

import example_surveys as example
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.pipeline.external_field import Observatory
from mwd_estimation.settings import derivation
from mwd_estimation.settings.place import Place
from mwd_estimation.settings.tool import Tool
from mwd_sensors.core.foreign_text import first_of, printable, without_contents
from mwd_sensors.nodes.sonde import SondeNode, SondeSettings
from mwd_sensors.telemetry import tool_configuration
from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.cli import main
from mwd_surface.commands.terminal import PrintableStream, facts, output, remark, table
from mwd_surface.control.lease_numbers import LeaseNumbers
from mwd_surface.downlink.memory import Memory
from mwd_surface.live.alarms import AlarmLog, Severity
from mwd_surface.live.plan_monitor import PlanMonitor, _compare
from mwd_surface.live.settings import PlanSettings
from mwd_surface.page import commands
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.survey_store import SurveyStore
from mwd_surface.surveys.well import Well
from project import ROOT

LOGGERS = tuple(f"get_logger().{level}" for level in ("debug", "info", "warning", "error", "fatal"))
SECRET = "hunter2-correct-horse"  # noqa: S105


@given(names=st.lists(st.text(max_size=1000), max_size=500))
def test_names_of_a_peer_never_fill_a_screen_and_the_rest_is_counted(names):
    said = first_of(names)
    assert len(said) < 20 * 210
    assert len(names) <= 20 or said.endswith(f"and {len(names) - 20} more")


def test_a_recording_with_thousands_of_topics_names_the_first_of_them(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(3000):
            writer.write(writer.topic(f"/t{k}", "std_msgs/msg/Float64"), bytes(12), 10**18 + k)
    with Bag(tmp_path / "bag") as bag, pytest.raises(BagError, match="and 2980 more") as found:
        bag.find_topic("sensor_msgs/msg/Imu", "imu/data_raw")
    assert len(str(found.value)) < 2000


def test_a_line_and_an_error_of_the_disk_are_still_named(tmp_path):
    file = tmp_path / "plan.csv"
    file.write_text("md_m,inc_deg,azi_deg\n0,0,0\nx,1,2\n")
    assert "line 3" in str(PlanMonitor.read(PlanSettings(file=str(file)), Well()))
    assert "No such file" in str(PlanMonitor.read(PlanSettings(file=str(tmp_path / "none.csv")), Well()))
    assert "not a regular file" in without_contents("x", OSError(22, "is not a regular file"))


def plan(file):
    return str(PlanMonitor.read(PlanSettings(file=str(file)), Well()))


def offset_wells(file):
    return str(_compare(example.surveys(dataclasses.replace(example.WELL, offset_wells=str(file))), None, None))


def list_of_an_offset_well(file, entry="file: {0}"):
    wells = file.with_name("wells.yaml")
    wells.write_text(f"wells: [{{name: A-3, {entry.format(file.name)}}}]")
    found = _compare(example.surveys(dataclasses.replace(example.WELL, offset_wells=str(wells))), None, None)
    return str(found.remarks if hasattr(found, "remarks") else found)


def programme_of_an_offset_well(file):
    file.with_name("beside.csv").write_text("md_m,inc_deg,azi_deg\n0,0,0\n30,1,2\n")
    return list_of_an_offset_well(file, "file: beside.csv, programme: {0}")


def survey_list(file):
    file.rename(file.with_name("surveys.json"))
    return "\n".join(SurveyStore(file.parent).load(example.WELL, ListRules()).messages)


def error_of(read, *values):
    try:
        read(*values)
    except (ValueError, OSError, RuntimeError) as error:
        return str(error)
    return ""


def scenario(file):
    node = SimpleNamespace(settings=SondeSettings(scenario=str(file)))
    return error_of(SondeNode.configure, node)


def recording(ending):
    """What the replay node says of a file with this ending."""

    def said(file):
        named = file.rename(file.with_name(f"recording{ending}"))
        try:
            with Bag(named) as bag:
                return "\n".join(bag.notes)
        except BagError as error:
            return str(error)

    return said


def metadata(file):
    folder = file.parent / "bag"
    folder.mkdir()
    file.rename(folder / "metadata.yaml")
    try:
        bag_metadata.read(folder)
    except bag_metadata.MetadataError as error:
        return str(error)
    return ""


def test_every_text_that_a_node_logs_is_constant_or_made_printable():
    raw = []
    for package in ("sensors", "estimation", "surface"):
        for path in (ROOT / f"mwd_{package}" / f"mwd_{package}").rglob("*.py"):
            source = path.read_text()
            for call in ast.walk(ast.parse(source)):
                if not isinstance(call, ast.Call) or not ast.unparse(call.func).endswith(LOGGERS):
                    continue
                text = call.args[0]
                made = isinstance(text, ast.Call) and ast.unparse(text.func) == "printable"
                if not made and not isinstance(text, ast.Constant):
                    raw.append(f"{path.relative_to(ROOT)}:{call.lineno}")
    assert raw == []


# Each reader of a file whose path is a parameter of a node, or that lies where a node keeps its own.
READERS = {
    "plan.file": plan,
    "well.offset_wells": offset_wells,
    "list of an offset well": list_of_an_offset_well,
    "programme of an offset well": programme_of_an_offset_well,
    "surveys.json": survey_list,
    "scenario": scenario,
    "tool_file": lambda file: error_of(tool_configuration.read_several, [file]),
    "place.observatory_file": lambda file: error_of(Observatory, Place(observatory_file=str(file))),
    "tool.assembly_file": lambda file: error_of(derivation.assembly, Tool(assembly_file=str(file))),
    "page.token_file": lambda file: error_of(commands.read_token, str(file), {}),
    "downlink.json": lambda file: error_of(Memory(file).read, tool_configuration.ToolConfiguration()),
    "metadata.yaml of replay.bag": metadata,
    "replay.bag, MCAP": recording(".mcap"),
    "replay.bag, db3": recording(".db3"),
    "replay.bag, ROS 1": recording(".bag"),
    "leases": lambda file: error_of(LeaseNumbers(file).first, 1),
}
CONTENTS = [
    "{0}",
    "{0}\n{0}\n",
    "{0}: {0}\n",
    "a: [{0}\n",
    "*{0}",
    "!!{0} x",
    "&{0} {0}: {0}",
    "code: {0}\n",
    "pulse_width_s: {0}\n",
    "survey_sequences: ['{0}']\n",
    "wells: {0}",
    "wells: [{{name: x, {0}: {0}}}]",
    "wells: [{{name: x, file: y, rule: {0}}}]",
    "legs: [{{code: {0}}}]",
    "hole_mm: {0}",
    "hole_mm: 200\nsensor_m: 1\ncomponents: [{{name: {0}, od_mm: 1e9, id_mm: 0, length_m: 1}}]",
    "duration_s: {0}\n",
    "profile: [{{{0}: {0}}}]\n",
    '{{"{0}": "{0}"}}',
    '{{"format": "{0}", "version": "{0}", "list": {{"{0}": "{0}"}}}}',
    '{{"reserved_below": "{0}"}}',
    '{{"in_force": {{"{0}": 1}}, "counter": "{0}"}}',
    '{{"{0}": [',
    "DATE TIME DOY {0}X {0}Y {0}Z |\n{0} {0} {0}\n",
    "DATE TIME DOY BOUX BOUY BOUZ |\n2026-01-01 {0} 1 1 2 3\n",
    "md_m,inc_deg,azi_deg\n0,0,0\n{0},1,2\n",
    "md_m,inc_deg,azi_deg,{0}\n0,0,{0},1\n",
    "md_m,inc_deg,azi_deg\n0,0,0\n10,170,{0}\n",
    "~V\nVERS. 2.0:\n~{0}\n{0}.{0}:{0}\n~A\n{0}",
    "<{0}><a>{0}</b></{0}>",
    "IOGP,{0},7\nP7,{0},{0}\n",
]


@pytest.mark.parametrize("reader", READERS)
def test_no_word_of_a_file_that_a_node_cannot_use_leaves_it(reader, tmp_path, capfd):
    for k, contents in enumerate(CONTENTS):
        folder = tmp_path / str(k)
        folder.mkdir()
        file = folder / "given.csv"
        file.write_text(contents.format(SECRET))
        said = READERS[reader](file)
        assert SECRET not in said, contents
        assert reader != "plan.file" or str(file) in said, contents
        assert SECRET not in "".join(capfd.readouterr()), contents
        # Any text is a token; every other reader refuses a file of one word.
        assert said or contents != "{0}" or reader == "page.token_file"


@given(st.text(), st.text(), st.text())
def test_no_control_character_reaches_alarms_events_or_the_log_of_a_node(text, remedy, source):
    told = []
    log = AlarmLog(lambda: 1, lambda words, _severity: told.append(words))
    log.raise_alarm("a", Severity.WARNING, text, remedy)
    log.set_alarms("b.", {"b.1": (1, text, remedy)})
    log.log_event(source, text)
    log.acknowledge("a", f"x{source}")
    words = [*told, *(w for a in log.alarms() for w in (a.text, a.remedy, a.acknowledged_by))]
    words += [w for event in log.events() for w in (event.text, event.source)]
    assert all(word == printable(word) for word in words)


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


@given(st.text(st.sampled_from("\x1b[8m3;1]0\x07a\u202e\n")))
def test_nothing_that_a_file_says_colours_a_terminal_or_hides_text(text):
    terminal = Terminal()
    with contextlib.redirect_stderr(PrintableStream(terminal)), contextlib.redirect_stdout(PrintableStream(terminal)):
        remark(text)
        facts([("name", text)])
        output().print(table([text]), text, markup=False)
    # Remove the dim style of table headings, which the program itself writes.
    shown = terminal.getvalue().replace("\x1b[2m", "").replace("\x1b[0m", "")
    assert "\x1b" not in shown
    assert "\u202e" not in shown


def test_an_error_that_quotes_a_file_colours_no_terminal(tmp_path, monkeypatch):
    (tmp_path / "list.csv").write_text("\x1b[8mmd,inc\u202e,azi\n0,0,0\n")
    terminal = Terminal()
    monkeypatch.setattr(sys, "argv", ["mwd", "path", str(tmp_path / "list.csv"), "-o", str(tmp_path / "out")])
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(sys, "stdout", terminal)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "\\x1b[8m" in terminal.getvalue()
    assert "\x1b[8m" not in terminal.getvalue()


def test_colours_pass_on_a_terminal_alone_and_nothing_that_moves_its_cursor_does():
    plain, terminal = io.StringIO(), Terminal()
    for stream in (plain, terminal):
        PrintableStream(stream).write("\x1b[31mred\x1b[0m \x1b[2J\x1b]0;title\x07")
    assert terminal.getvalue() == "\x1b[31mred\x1b[0m \\x1b[2J\\x1b]0;title\\x07"
    assert "\x1b" not in plain.getvalue()
