# SPDX-License-Identifier: Apache-2.0
"""A sentence in another language: its template, its values, and what nobody can translate."""

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_estimation.core.reason_text import text
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_surface.language import language as language_module
from mwd_surface.language.language import _WORK, MARKS, Language, _TemplateSearch, language, languages

CHINESE = language("zh_CN")
TEMPLATES = [one for one in CHINESE.entries if "{" in one and "{0}" not in one]
GERMAN = Language("de", {"inclination {value}": "Neigung {value}", "north": "Nord", "{a} of {b}": "{a} von {b}"}, ",")


def names(template):
    return [part.partition("}")[0] for part in template.split("{")[1:]]


def test_a_sentence_of_every_template_is_translated_whole():
    for template in TEMPLATES:
        values = {name: f"{k + 1.5}" for k, name in enumerate(names(template))}
        said = CHINESE.say(template.format(**values))
        assert CHINESE.unknown(template.format(**values)) == 0, template
        assert all(value in said for value in values.values()), template


SENTENCES = [
    text(Reason(code, 0.123, 0.456, (0.3, 0.4), ("gyro", "magnetometer"), (Reason(ReasonCode.NO_MAGNETOMETER),)))
    for code in ReasonCode
    if "FAULT" not in code.name
]


def test_every_reason_is_translated_with_its_numbers():
    for english in SENTENCES:
        assert CHINESE.unknown(english) == 0, (english, CHINESE.say(english))


@settings(deadline=None, max_examples=60)
@given(st.lists(st.sampled_from(SENTENCES), min_size=2, max_size=3, unique=True))
def test_joined_reasons_are_translated_each_also_where_a_reason_has_the_mark_that_joins_them(reasons):
    joined = "; ".join(reasons)
    said, alone = CHINESE.say(joined), [CHINESE.say(one) for one in reasons]
    assert CHINESE.unknown(joined) == 0
    # The mark between reasons may be read as one of a list within a reason.
    assert sorted(filter(str.isalnum, said)) == sorted(filter(str.isalnum, "".join(alone)))


def test_the_words_of_a_sentence_stay_with_its_values():
    off = text(Reason(ReasonCode.DIP_OFF, math.radians(0.4), math.radians(0.25)))
    assert CHINESE.say(off).startswith("磁倾角偏离参考值 +0.40°，限值 0.25°")


# Names that people type: words of the catalogue and others, joined as sentences are.
WORDS = sorted(one for one in CHINESE.entries if one.isalpha() and one.isascii())
FOREIGN = ("Salt", "Pepper", "Nordlys", "Åsgard", "B-12", "Ann")
JOINTS = (" ", " at ", *MARKS)


@st.composite
def typed_names(draw):
    """Return a name with at least one word that the catalogue does not have."""
    words = draw(st.lists(st.sampled_from([*WORDS, *FOREIGN]), min_size=0, max_size=4))
    words.insert(draw(st.integers(0, len(words))), draw(st.sampled_from(FOREIGN)))
    joints = draw(st.lists(st.sampled_from(JOINTS), min_size=len(words), max_size=len(words)))
    return "".join(part for pair in zip(words, joints, strict=True) for part in pair).strip(" ,;:·")


@settings(deadline=None)
@given(typed_names())
def test_a_name_comes_through_unchanged_alone_and_in_a_sentence(name):
    assert CHINESE.say(name) == name
    said = CHINESE.say(f"{name} loses control to {name}")
    assert said == CHINESE.entries["{name} loses control to {name1}"].format(name=name, name1=name)


@pytest.mark.parametrize(
    "name", ["north", "the tool", "tool and rig", "stop: no data at all", "recording at 3.5 m", "7.5"]
)
def test_what_a_person_typed_stays_even_where_the_catalogue_has_it(name):
    """In a place of a template that is marked as typed, a text of the catalogue is not translated either."""
    said = CHINESE.say(f"accepted by {name} against the automatic verdict reject")
    assert name in said
    assert CHINESE.entries["reject"] in said
    assert f": {name}" in CHINESE.say(f"Ann took control back: {name}")


@pytest.mark.parametrize("typed", ["no data at all", "north", "tool or rig", "Salt and Pepper"])
def test_every_sentence_keeps_what_people_typed_in_it(typed):
    for template in [one for one in TEMPLATES if language_module.TYPED & set(names(one))]:
        values = {name: typed if name in language_module.TYPED else "7.5" for name in names(template)}
        assert CHINESE.say(template.format(**values)) == CHINESE.entries[template].format(**values)


@pytest.mark.parametrize("name", ["Salt and Pepper", "Salt at Pepper", "Ax, B or C", "north: Salt.csv", "tool; Ann's"])
def test_a_list_is_split_only_where_every_piece_is_known(name):
    assert CHINESE.say(name) == name


def test_a_depth_and_another_number_after_at_are_not_confused():
    assert "测深" not in CHINESE.say("tool at 12:30")
    assert " at " not in CHINESE.entries


HOSTILE = (
    "; ".join(["a b: c, d and e or f"] * 200),
    " is ".join(["x y"] * 300),
    "survey " * 5000,
    "the {a} of : ; , and or at " * 500,
    "no : is of at , ; " * 3000,
    "m, deg, " * 400,
    "a" * 1_000_000,
    " and ".join([*TEMPLATES, "zz"]),
    "; ".join(f"{a}: {b}; zz" for a, b in itertools.pairwise(TEMPLATES)),
    *(f" {mark} ".join(["tool", "survey 4", "x is y"] * 60) for mark in MARKS),
)


@pytest.mark.parametrize("text_", HOSTILE, ids=lambda one: one[:12])
def test_any_text_is_read_with_bounded_work_by_the_real_catalogue(text_, monkeypatch):
    """Without a bound, some of these search templates for minutes."""
    search, letters = _TemplateSearch._by_template, []

    def counted(self, templates, text, depth, best):
        letters.append(len(text))
        return search(self, templates, text, depth, best)

    monkeypatch.setattr(_TemplateSearch, "_by_template", counted)
    assert CHINESE.unknown(text_) <= len(text_)
    assert sum(letters) < 2 * _WORK


@settings(deadline=2000, max_examples=30)
@given(st.lists(st.sampled_from([*MARKS, *TEMPLATES[::7], "tool", "zz", " "]), max_size=60))
def test_any_mixture_of_marks_and_templates_is_read_in_time(parts):
    assert isinstance(CHINESE.say("".join(parts)), str)


@pytest.mark.parametrize("value", ["7.5", "the tool turns", "Foo bar"])
def test_the_limit_of_work_is_far_above_what_a_sentence_needs(value):
    """A text of the sources needs at most a fifth of it, so the limit changes no translation."""
    for template in TEMPLATES:
        reader = language_module._TemplateSearch(CHINESE)
        reader.read(template.format(**dict.fromkeys(names(template), value)), 6)
        assert reader._work > 0.8 * language_module._WORK, template


def test_no_more_languages_are_kept_than_there_are_catalogues():
    """The code comes from the address of a page that needs no login."""
    for k in range(300):
        for code in (f"en_{k}", f"en-{k}", f"zh_CN.{k}", f"zh_{k}"):
            assert language(code) in (language("en"), CHINESE)
    assert language_module._catalogue.cache_info().currsize <= len(languages())


def test_numbers_follow_the_decimal_mark_of_the_language():
    assert GERMAN.say("inclination 45.25 deg") == "Neigung 45,25°"
    assert CHINESE.say("inclination 45.25 deg").endswith("45.25 deg") or "45.25" in CHINESE.say("inclination 45.25 deg")
    assert GERMAN.number("3.5") == "3,5"


def test_a_language_is_found_by_the_forms_of_its_code():
    for code in ("zh_CN", "zh-CN", "zh_CN.UTF-8", "zh"):
        assert language(code).code == "zh_CN"
    for code in ("", "C", "POSIX", "en", "en_GB.UTF-8"):
        assert language(code).say("north") == "north"
    assert next(iter(languages())) == "en"
    with pytest.raises(ValueError, match="choose one of en, zh_CN"):
        language("xx")
