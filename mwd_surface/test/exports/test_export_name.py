# SPDX-License-Identifier: Apache-2.0
"""File names from whatever people call their wells."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.exports.export import LONGEST, RESERVED, safe_name


@pytest.mark.fault_case(93)
@pytest.mark.parametrize(
    ("parts", "name"),
    [
        (("Åsgard Ω-1", "report"), "Asgard_Ω-1-report"),
        (("../../etc/passwd",), "etc_passwd"),
        (("CON",), "_CON"),
        (("nul.csv",), "_nul.csv"),
        (("",), "unnamed"),
        (("井戸", "测斜报告"), "井戸-测斜报告"),
        (("井" * 50,), "井" * 26),
        ((".hidden",), "hidden"),
        (("a/b\\c:d*e?f",), "a_b_c_d_e_f"),
        (("W" * 300,), "W" * 80),
    ],
)
def test_names_are_made_safe(parts, name):
    assert safe_name(*parts) == name


@pytest.mark.fault_case(80, 93)
@given(st.lists(st.text(max_size=120), max_size=4))
def test_no_text_makes_a_name_that_any_system_refuses(parts):
    name = safe_name(*parts)
    assert 0 < len(name.encode()) <= LONGEST + 1
    assert all(letter.isalnum() or letter in "._-" for letter in name)
    assert name[0] != "."
    assert name.split(".")[0].lower() not in RESERVED
