# SPDX-License-Identifier: Apache-2.0
"""The command line in another language: help, errors, tables, and how the language is chosen."""

import io
import json
import os
import re
import subprocess
import sys

import example_surveys
import pytest
import typer
from babel.messages.pofile import read_po
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface import cli
from mwd_surface.commands import terminal
from mwd_surface.commands.help_text import paragraphs, width_of, wrapped
from mwd_surface.commands.speech import say
from mwd_surface.commands.survey_table import show_surveys
from mwd_surface.language import language as language_module
from mwd_surface.language.language import language, language_of_commands, read_catalogue

FOLDER = language_module._FOLDER
CHINESE = language_of_commands({"LANGUAGE": "zh_CN"})
OWN = read_catalogue(FOLDER / "commands" / "zh_CN.po")
# Three English words in a row; a command, a unit or a name of a setting is shorter or in another alphabet.
ENGLISH = re.compile(r"(?<![-\w.=/`'])[a-z]{2,} [a-z]{2,} [a-z]{2,}")


def leaves(command, context, *names):
    yield " ".join(names), command, context
    for name, below in getattr(command, "commands", {}).items():
        yield from leaves(below, below.context_class(below, info_name=name, parent=context), *names, name)


@pytest.fixture
def chinese(monkeypatch):
    monkeypatch.setenv("LANGUAGE", "zh_CN")


def ended(monkeypatch, capsys, *words):
    """Run the command and return its status and output."""
    monkeypatch.setattr(sys, "argv", ["mwd", *words])
    # The command sets the variable; this restores it.
    monkeypatch.setenv("LANGUAGE", os.environ["LANGUAGE"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    told = capsys.readouterr()
    return end.value.code or 0, told.out, told.err


@pytest.mark.parametrize("path", sorted(FOLDER.glob("**/*.po")), ids=lambda path: path.parent.name)
def test_a_catalogue_is_read_as_babel_reads_it(path):
    with path.open("rb") as file:
        theirs = {m.id: m.string for m in read_po(file) if m.id and m.string and not m.fuzzy}
    assert read_catalogue(path) == theirs


def test_what_an_editor_of_catalogues_writes_is_read(tmp_path):
    """Entries that are fuzzy, obsolete or empty are no translations; quotes, tabs and lines are kept."""
    path = tmp_path / "xx.po"
    path.write_text(
        'msgid ""\nmsgstr ""\n"Language: xx\\n"\n\n'
        '#, fuzzy\nmsgid "one"\nmsgstr "eins"\n\n'
        '#~ msgid "two"\n#~ msgstr "zwei"\n\n'
        '# fuzzy logic\n#, python-format\nmsgid "a \\"b\\"\\n"\n"c\\\\d"\nmsgstr ""\n"ä \\"b\\"\\n"\n"\\tc\\\\d"\n\n'
        'msgid "e"\nmsgstr ""\n',
        encoding="utf-8",
    )
    assert read_catalogue(path) == {'a "b"\nc\\d': 'ä "b"\n\tc\\d'}


@pytest.mark.parametrize(
    ("environment", "code"),
    [
        ({}, "en"),
        ({"LANG": "zh_CN.UTF-8"}, "zh_CN"),
        ({"LANG": "zh_CN.UTF-8", "LC_ALL": "C"}, "en"),
        ({"LANG": "C", "LC_MESSAGES": "zh_SG"}, "zh_CN"),
        ({"LC_ALL": "en_GB.UTF-8", "LANGUAGE": "xx:zh"}, "zh_CN"),
        ({"LANGUAGE": "", "LANG": "zh"}, "zh_CN"),
        ({"LANGUAGE": "fr:en:zh"}, "en"),
        ({"LANG": "fr_FR.UTF-8"}, "en"),
    ],
)
def test_the_environment_chooses_the_language_as_gettext_does(environment, code):
    assert language_of_commands(environment).code == code


def test_no_sentence_of_the_help_is_left_in_english(chinese):
    top = typer.main.get_command(cli.app)
    found, count = {}, 0
    for name, command, context in leaves(top, top.context_class(top, info_name="mwd")):
        page = command.get_help(context)
        assert page.startswith("用法：mwd")
        count += 1
        # The first line and the examples have commands, up to an empty line.
        parts = [part for part in page.split("\n\n")[1:] if "示例：" not in part]
        lines = [line for part in parts for line in part.splitlines()]
        left = [line for line in lines if ENGLISH.search(line) or width_of(line.rstrip("，。）")) > 80]
        if left:
            found[name] = left
    assert not found
    assert count > 60


def test_the_english_help_is_that_of_the_library():
    top = typer.main.get_command(cli.app)
    for name, command, context in leaves(top, top.context_class(top, info_name="mwd")):
        ours = command.get_help(context)
        context.formatter_class = typer.Context.formatter_class
        assert command.get_help(context) == ours, name


@given(st.text(alphabet="孔深，方位角。（a b-c 12 mwd", max_size=200), st.integers(8, 60))
def test_a_wrapped_paragraph_has_all_its_letters_and_fits(text, width):
    lines = wrapped(text, width)
    assert "".join("".join(lines).split()) == "".join(text.split())
    longest = max(map(width_of, re.findall(r"[a-z0-9-]+", text)), default=0)
    # Closing marks may follow the last column.
    assert all(width_of(line.rstrip("，。）")) <= max(width, longest) for line in lines)


def test_paragraphs_are_the_texts_of_the_catalogue():
    text = "One\n    line.\n\n    \b\n    Examples:\n      mwd x\n"
    assert list(paragraphs(text)) == [("One line.", False), ("Examples:\n  mwd x", True)]


def test_errors_of_arguments_and_of_input_are_in_the_language(monkeypatch, capsys, tmp_path):
    status, _, told = ended(monkeypatch, capsys, "--language", "zh_CN", "repor")
    assert (status, "没有命令 'repor'" in told, "错误：" in told) == (2, True, True)
    status, _, told = ended(monkeypatch, capsys, "--language=zh_CN", "report")
    assert (status, "缺少参数 'SURVEYS'" in told) == (2, True)
    status, _, told = ended(monkeypatch, capsys, "--language", "zh_CN", "bag", "info", str(tmp_path / "none"))
    assert status == 2
    assert "不存在" in told
    assert str(tmp_path / "none") in told
    status, _, told = ended(monkeypatch, capsys, "--language", "xx", "--help")
    assert status == 2
    assert "choose one of en, zh_CN" in told or "请从 en, zh_CN 中选择" in told


def test_a_status_of_a_command_is_that_of_the_process(monkeypatch, capsys):
    assert ended(monkeypatch, capsys, "--version")[0] == 0
    assert ended(monkeypatch, capsys, "scenario", "list")[0] == 0


def test_a_table_of_surveys_is_in_the_language(chinese, capsys):
    show_surveys(example_surveys.table().surveys.records)
    told = capsys.readouterr().out
    assert "井斜角" in told
    assert CHINESE.entries["accept"] in told
    assert not re.search(r"\b(accept|reject|doubtful|verdict|azimuth|surveys)\b", told), told


def test_a_line_keeps_its_spaces_and_the_names_in_it(chinese):
    assert say("  waits because no command was sent yet") == "  等待，因为：尚未发送指令"
    assert say("written: out/north/surveys.csv") == "已写出：out/north/surveys.csv"
    assert say("run_7.mcap: the file is empty") == "run_7.mcap：文件为空"
    assert say("") == ""
    assert say("\n12.5 m\n") == "\n12.5 m\n"


@pytest.mark.slow(20)
def test_a_message_of_every_template_is_translated_whole():
    for template in OWN:
        values = {name: f"{k + 1.5}" for k, name in enumerate(re.findall(r"\{(\w*)\}", template))}
        text = re.sub(r"\{(\w*)\}", lambda m, values=values: values[m[1]], template).strip()
        if values:
            assert CHINESE.unknown(text) == 0, template
            assert all(value in CHINESE.say(text) for value in values.values()), template


def test_machine_readable_output_is_the_same_in_every_language(monkeypatch, capsys):
    english = ended(monkeypatch, capsys, "rig", "manifest")[1]
    monkeypatch.setenv("LANGUAGE", "zh_CN")
    assert ended(monkeypatch, capsys, "rig", "manifest")[1] == english
    assert json.loads(english)


def test_the_page_does_not_load_the_texts_of_the_commands():
    assert "Print the versions and exit." not in language("zh_CN").table()["entries"]


@pytest.mark.slow
@pytest.mark.parametrize("code", ["en", "zh_CN"])
def test_the_help_imports_no_library_that_it_does_not_need(code):
    """Slow imports: rich (tables), babel (languages) and numba (filters)."""
    program = (
        "import io, sys; from mwd_surface import cli; sys.argv = ['mwd', '--language', sys.argv[1], '--help']\n"
        "try:\n    cli.main()\nexcept SystemExit:\n    pass\n"
        "print(sorted({'babel', 'rich', 'numba', 'matplotlib', 'aiohttp'} & {*sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", program, code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_output_into_a_file_is_in_the_language_too(chinese):
    """The language follows the environment, not the terminal."""
    page = io.StringIO()
    console = terminal.output()
    console.file = page
    console.print("everything needed is present")
    assert page.getvalue() == "所需项目齐全\n"
