# SPDX-License-Identifier: Apache-2.0
import dataclasses
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core.foreign_text import printable, unprintable
from mwd_sensors.core.hidden_characters import escaped, hidden
from mwd_sensors.core.settings import SettingsError, from_mapping, setting


@dataclasses.dataclass(frozen=True)
class Named:
    name: str = setting("", "name of something")


MARKS = (
    "\u061c\u200b\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2060\u2064\u2066\u2067\u2068\u2069\ufeff\u00ad\U000e0041"
)
WITHOUT_SHAPE = "\u034f\u115f\u1160\u2800\u3164\uffa0\U000e0101"
NAMES = ("Ågård Ø-7", "Скв. №12", "井一号", "بئر ١٢", "नॉर्वे", "چاه\u200cنفت", "Well 7 ½ °", "a\u00a0b\u202f1", "⚠️")


@given(st.text())
def test_an_escaped_text_has_no_character_that_nobody_sees(text):
    shown = escaped(text)
    assert all(unicodedata.category(c) not in ("Cc", "Cf", "Cs", "Zl", "Zp") or c in "\n\t\u200c\u200d" for c in shown)
    assert not list(hidden(shown))
    assert escaped(shown) == shown


@pytest.mark.parametrize("mark", [*MARKS, *WITHOUT_SHAPE, "\x1b", "\x9b", "\x07", "\u2028", "\ud800", "\u200d"])
def test_a_name_with_a_mark_that_nobody_sees_is_refused_wherever_the_mark_stands(mark):
    for name in (f"{mark}well", f"we{mark}ll", f"well{mark}", mark):
        assert mark not in printable(name)
        assert "invisible character" in unprintable(name)
        with pytest.raises(SettingsError, match="invisible character"):
            from_mapping(Named, {"name": name})


@pytest.mark.parametrize("name", NAMES)
def test_names_of_all_scripts_stay_as_they_are(name):
    assert printable(name) == name
    assert unprintable(name) == ""
    assert from_mapping(Named, {"name": name}).name == name


def test_lines_and_tabs_stay_in_what_is_shown_and_are_refused_in_a_name():
    assert printable("a\tb\nc") == "a\tb\nc"
    assert "one line" in unprintable("a\nb")
    assert "one line" in unprintable("a\tb")
