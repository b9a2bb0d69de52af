# SPDX-License-Identifier: Apache-2.0
"""The Chinese documents say what the English ones say: the same commands, names and numbers, in the same terms."""

import re
from collections import Counter

import pytest

from mwd_surface.language.language import language, language_of_commands
from project import ROOT

DOCS = ROOT / "docs"
CHINESE = DOCS / "zh"
PAIRS = {
    "readme.md": ROOT / "README.md",
    "quickstart.md": DOCS / "quickstart.md",
    "first_run.md": DOCS / "tutorials" / "first_run.md",
    "judging_a_survey.md": DOCS / "tutorials" / "judging_a_survey.md",
    "real_sensors.md": DOCS / "guide" / "real_sensors.md",
}
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\([^)]*\)|\{doc\}`[^`]*`")
# Marks of a programmer's text that a translation writes otherwise: words in Chinese are quoted or set as they are.
NUMBER = re.compile(r"(?<![\w.])\.?\d[\d ]*(?:\.\d+)?")
TERM = re.compile(r"^\| ([^|]*[一-鿿][^|]*) \| ([a-z][^|]*) \| [^|]+ \|$", re.MULTILINE)
# Values of options that the Chinese documents have in addition: how to switch the language.
OWN = {"LANGUAGE", "zh_CN", "表盘"}


def text(path):
    return path.read_text(encoding="utf-8")


def blocks(path):
    """Return the blocks of a document, comments of commands taken off."""
    return [
        (kind, [re.sub(r"\s+#.*$", "", line) for line in body.splitlines()]) for kind, body in FENCE.findall(text(path))
    ]


def spans(path):
    """Return the inline code of a document without links, each with the number of its places."""
    prose = LINK.sub("", FENCE.sub("", text(path)))
    return Counter(" ".join(one.split()) for one in re.findall(r"`([^`]+)`", prose)) - Counter(OWN)


def numbers(path):
    """Return the numbers of the prose and tables of a document."""
    prose = re.sub(r"`[^`]*`", "", LINK.sub("", FENCE.sub("", text(path))))
    prose = re.sub(r"\[!\[|!\[[^\]]*\]", "", prose)
    return Counter(re.sub(r"\s", "", one) for one in NUMBER.findall(prose))


@pytest.mark.parametrize("name", PAIRS)
def test_a_chinese_document_has_the_commands_of_the_english_one(name):
    assert blocks(CHINESE / name) == blocks(PAIRS[name])


@pytest.mark.parametrize("name", PAIRS)
def test_a_chinese_document_has_the_names_of_the_english_one(name):
    """Files, parameters and options within sentences; a name may stand once more or less often, but none is missing."""
    ours, theirs = spans(CHINESE / name), spans(PAIRS[name])
    assert not set(theirs) - set(ours)


@pytest.mark.parametrize("name", PAIRS)
def test_a_chinese_document_has_the_numbers_of_the_english_one(name):
    ours, theirs = numbers(CHINESE / name), numbers(PAIRS[name])
    assert not set(theirs) - set(ours)
    assert not set(ours) - set(theirs)


@pytest.mark.parametrize("name", PAIRS)
def test_a_chinese_document_has_the_sections_and_rows_of_the_english_one(name):
    def shape(path):
        prose = FENCE.sub("", text(path))
        return [len(re.findall(mark, prose, re.MULTILINE)) for mark in (r"^#", r"^\|", r"^\d\. ")]

    assert shape(CHINESE / name) == shape(PAIRS[name])


def test_every_document_is_linked_and_every_link_leads_to_a_file():
    index = text(CHINESE / "index.md")
    assert {path.stem for path in CHINESE.glob("*.md")} - {"index"} <= set(index.split())
    assert "zh/index" in text(DOCS / "index.md")
    assert "docs/zh/readme.md" in text(ROOT / "README.md")
    for path in CHINESE.glob("*.md"):
        for link in re.findall(r"\]\(([^)#:]+)\)", text(path)):
            assert (CHINESE / link).is_file(), (path.name, link)


GLOSSARY = [(chinese, english) for chinese, english in TERM.findall(text(CHINESE / "glossary.md"))]
ENTRIES = {**language_of_commands({"LANGUAGE": "zh_CN"}).entries, **language("zh_CN").entries}


@pytest.mark.parametrize(("chinese", "english"), GLOSSARY, ids=lambda one: one)
def test_a_term_of_the_glossary_is_the_one_that_the_program_uses(chinese, english):
    """Its English stands in the catalogue, the glossary or the documents, and texts with it have its Chinese."""
    stem = re.compile(rf"\b{re.escape(english)}(?:s|es)?\b", re.IGNORECASE)
    where = [entry for entry in ENTRIES if stem.search(entry)]
    written = " ".join(" ".join(text(path).split()) for path in (DOCS / "glossary.md", ROOT / "README.md"))
    assert where or stem.search(written), "no text has the English term"
    said = [ENTRIES[entry] for entry in where] or ENTRIES.values()
    documents = " ".join(text(path) for path in CHINESE.glob("*.md") if path.name != "glossary.md")
    assert any(chinese in one for one in said) or chinese in documents
    for entry in where:
        if stem.fullmatch(entry):
            assert chinese in ENTRIES[entry], (entry, ENTRIES[entry])


def test_the_glossary_has_each_term_once_and_is_long_enough():
    english = [term for _, term in GLOSSARY]
    assert len(set(english)) == len(english) > 60
