# SPDX-License-Identifier: Apache-2.0
"""The state of the page in one line: a missing value is a dash, an old one carries its age."""

import math

from mwd_surface.page.summary_line import summary_line


def value(number, state="live", age=0.0):
    return {"value": number, "state": state, "age": age}


def test_a_live_page_is_one_line():
    sections = {
        "attitude": {"inclination": value(math.radians(35.12)), "azimuth": value(math.radians(50.0)), "north": "grid"},
        "toolface": {"angle": value(math.radians(12.4)), "mode": "gravity"},
        "rig": {"bit_depth": value(74.84)},
        "surveys": {"rows": [{}, {}]},
        "recorder": {"state": "recording", "messages": 120},
    }
    assert summary_line(sections) == "incl 35.1  azi 50.0 grid  gtf 12  bit 74.8 m  2 surveys  rec 120"


def test_a_missing_value_is_a_dash():
    assert summary_line({}) == "incl -  azi -  gtf -  bit - m  0 surveys  no recorder 0"


def test_an_old_value_says_how_old_it_is():
    sections = {
        "attitude": {"inclination": value(1.0, "stale", 7.2)},
        "toolface": {"angle": value(0.5), "mode": "magnetic"},
        "surveys": {"rows": [{}]},
        "recorder": {"state": "paused: disk full", "messages": 3},
    }
    words = summary_line(sections)
    assert "incl 57.3 (7 s old)" in words
    assert "mtf 29" in words
    assert "1 survey  paused: disk full 3" in words
