# SPDX-License-Identifier: Apache-2.0
"""A sentence in another language: its template, its values, and what nobody can translate."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.reason_text import text
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_surface.language.language import MARKS, Language, language, languages

CHINESE = language("zh_CN")
TEMPLATES = [one for one in CHINESE.entries if "{" in one and "{0}" not in one]
GERMAN = Language("de", {"inclination {value}": "Neigung {value}", "north": "Nord", "{a} of {b}": "{a} von {b}"}, ",")


def names(template):
    return [part.partition("}")[0] for part in template.split("{")[1:]]


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_sentence_of_every_template_is_translated_whole(template):
    values = {name: f"{k + 1.5}" for k, name in enumerate(names(template))}
    said = CHINESE.say(template.format(**values))
    assert CHINESE.unknown(template.format(**values)) == 0
    for value in set(values.values()):
        assert value in said


def test_every_reason_is_translated_with_its_numbers():
    reasons = [
        Reason(code, 0.123, 0.456, (0.3, 0.4), ("gyro", "magnetometer"), (Reason(ReasonCode.NO_MAGNETOMETER),))
        for code in ReasonCode
        if "FAULT" not in code.name
    ]
    for reason in reasons:
        english = text(reason)
        assert CHINESE.unknown(english) == 0, (english, CHINESE.say(english))


def test_the_words_of_a_sentence_stay_with_its_values():
    off = text(Reason(ReasonCode.DIP_OFF, math.radians(0.4), math.radians(0.25)))
    assert CHINESE.say(off).startswith("磁倾角偏离参考值 +0.40°，限值 0.25°")


@given(st.text(max_size=80))
def test_a_text_that_nobody_wrote_is_never_lost(name):
    """A name, a path or a comment comes back as it is, alone and within a sentence."""
    assert (
        GERMAN.say(name) == name
        or any(word in name for word in ("inclination", "north", " of ", *MARKS))
        or (name[:1].isdigit() or name[:1] in "+-−")
    )
    assert name in Language("de", {"plan {plan} not used": "Plan {plan} nicht benutzt"}).say(
        f"plan {name} not used"
    ) or (any(mark in name for mark in MARKS))


@given(st.text("abc :;,0123456789.{}", max_size=200))
def test_any_text_is_read_in_a_bounded_time(text_):
    assert isinstance(GERMAN.say(text_ * 20), str)


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
