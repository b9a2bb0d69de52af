# SPDX-License-Identifier: Apache-2.0
"""The catalogues of the languages hold every text of the sources, with the same values."""

import importlib.machinery
import importlib.util
import re
from pathlib import Path

import pytest
from babel.messages.pofile import read_po

from mwd_surface.bags.recorder.status import RecorderState
from mwd_surface.control.status import ControlState
from mwd_surface.live.inputs import Role
from mwd_surface.live.link_state import LinkHealth, LinkWordState, WordStatus
from mwd_surface.live.well_state import WellState
from mwd_surface.page.state_json import word
from mwd_surface.surveys.leg import Origin
from mwd_surface.trajectory.advice import AdviceMode

ROOT = Path(__file__).resolve().parents[1]
CATALOGUES = sorted((ROOT / "mwd_surface/mwd_surface/language").glob("**/*.po"))
PLACES = re.compile(r"\{\w*\}")


@pytest.fixture(scope="module")
def words():
    """Load the script that collects the texts."""
    loader = importlib.machinery.SourceFileLoader("words", str(ROOT / ".ci/words"))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("words", loader))
    loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def every_text(words):
    """Texts of the page, alarms, reasons and report."""
    return frozenset(words.every_text())


@pytest.mark.parametrize("path", CATALOGUES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_text_has_a_translation_with_the_same_values(words, every_text, path):
    """Texts of the page, alarms, reasons and report; and those of the help and messages of the commands."""
    with path.open("rb") as file:
        catalogue = {m.id: m.string for m in read_po(file, locale=path.stem) if m.id}
    texts = set(words.command_texts()) if path.parent.name == "commands" else every_text
    assert not texts - {text for text, said in catalogue.items() if said}, "no translation: run `make words`, translate"
    assert not set(catalogue) - texts, "no source has these texts any more: run `make words`"
    for text, said in catalogue.items():
        assert set(PLACES.findall(text)) == set(PLACES.findall(said)), (text, said)


def test_the_values_of_a_template_have_fixed_text_between_them(every_text):
    for text in every_text:
        assert not re.search(r"\{[a-z]\w*\}\{", text), text


def test_the_collector_finds_texts_in_every_form(words, tmp_path):
    """A string, an f-string, parts joined by +, a name of a constant, and a choice within a text."""
    source = '''
_REST = "check the plug"
"""Not a text."""
def f(a, b):
    """Nor is this."""
    g("no data at all; ")
    g(f"no {a.name} for {b:.0f} s: {'try again' if a else 'go on drilling'}")
    g("the tool " + f"turns: {_REST}")
    g("{value:+.1f deg} is off by {values[0]:g}")
    g(setting("a parameter of something"))
'''
    path = tmp_path / "module.py"
    path.write_text(source, encoding="utf-8")
    found = words.texts_of(path)
    assert {
        "no data at all",
        "no {name} for {b} s: {a}",
        "try again",
        "go on drilling",
        "the tool turns: check the plug",
        "{value} is off by {values0}",
    } <= set(found)
    assert not any("Not a text" in text or "Nor is" in text or "parameter" in text for text in found)


def test_the_texts_of_the_page_are_found_with_templates_inside_templates(words):
    source = r't("a"); t`b ${x ? t`c ${y} d` : ""} e`; t("say \"f\"")'
    assert words.page_texts(source) == ["a", 'say "f"', "b {0} e", "c {0} d"]


@pytest.mark.parametrize("kind", [LinkHealth, WordStatus, RecorderState, Role, ControlState, Origin, AdviceMode])
def test_the_words_of_the_enumerations_on_the_page_are_texts(every_text, kind):
    """The words are made from the names of the members, so no source has them as a string."""
    for member in kind:
        assert word(member) in {*every_text, ""}, member


def test_the_enumerations_of_every_field_of_a_record_are_found(words):
    """A field of a field, a list of records and a property are looked through; codes for programs are not words."""
    assert words.state_words(LinkWordState).keys() == {"believed", "erased", "by consistency", "survey", "toolface"}
    assert set(words.state_words(WellState)) > set(words.state_words(LinkWordState)) | {"no pressure", "no flow"}
    assert not any("_" in one for one in words.state_words(WellState))


def test_of_a_reader_of_lists_only_the_remarks_are_texts_of_the_report(words, tmp_path):
    """Remarks are printed in the report; errors end the command, and are among the texts of the commands."""
    path = tmp_path / "reader.py"
    path.write_text(
        '_HOW = "taken once"\n'
        "def read(name, md):\n"
        '    text = f"{name}: the station at {md} m is {_HOW}"\n'
        "    if md < 0:\n"
        '        raise ValueError(f"{name}: no station in it")\n'
        "    return Remark(RemarkKind.STATION_REPEATED, text)\n"
        "def other():\n"
        '    return "not shown to anybody"\n',
        encoding="utf-8",
    )
    assert words.texts_of(path, "RemarkKind") == ["{name}: the station at {md} m is taken once"]
    assert words.errors_of(path) == ["{name}: no station in it"]


def test_the_help_of_every_command_is_among_the_texts(words):
    """Paragraphs of a command, the meaning of its options, and the headings of panels."""
    texts = words.help_texts()
    assert "Latitude, deg, north positive." in texts
    assert "Recordings" in texts
    assert "Compute the path of a survey list by minimum curvature, with its position uncertainty." in texts
    assert not any(text.startswith("mwd ") for text in texts), "an example of a command is not translated"


@pytest.mark.parametrize(
    ("modules", "text"),
    [
        ("mwd_surface/mwd_surface/receiver/**/*.py", r"\bno_words\(|\bFrameReport\(|def failure\("),
        ("mwd_*/mwd_*/**/*.py", r"\b(raise_alarm|log_event)\("),
    ],
    ids=["says why a receiver has no words", "raises an alarm or logs an event"],
)
def test_every_module_with_texts_of_the_page_is_among_its_sources(words, modules, text):
    sources = {path for pattern in words.PYTHON for path in ROOT.glob(pattern)}
    found = {path for path in ROOT.glob(modules) if re.search(text, path.read_text(encoding="utf-8"))}
    assert found
    assert found <= sources
