# SPDX-License-Identifier: Apache-2.0
"""Path, charts, steering and system."""

import dataclasses
import math
import re
import time

import pytest

from browser_page import (
    EVIL,
    By,
    Keys,
    StaleElementReferenceException,
    click,
    rig_on,
    state_of,
    steered,
    tab,
    text,
    wait,
)
from mwd_surface.live.inputs import InputState, InputTable, Role, StampClock
from mwd_surface.live.link_state import LOCKED, SEARCHING, LinkStatus

pytestmark = pytest.mark.slow


def test_offset_wells_stand_beside_the_path_with_level_factor_and_distance(browser):
    with rig_on(browser) as rig:
        tab(browser, "path")
        wait(browser, lambda: "A-3" in (text(browser, "#clearance") or ""))
        shown = text(browser, "#clearance")
        assert shown.index("stop 0.90") < shown.index("clear 4.00")
        said = browser.find_element(By.CSS_SELECTOR, "#clearance dd").get_attribute("title")
        assert said == "9.00 m away at 1250.00 m; smallest allowed 10.00 m"
        assert shown.index("A-3") < shown.index(EVIL)
        rig.state.show(time.monotonic(), clearance=())
        rig.push()
        wait(browser, lambda: text(browser, "#clearance") is None)


def test_the_path_is_drawn_with_its_plan_in_map_section_and_space(browser):
    with rig_on(browser):
        tab(browser, "path")
        wait(browser, lambda: browser.execute_script("return document.querySelectorAll('.plots svg.plot').length") == 2)
        count = "return document.querySelectorAll('.plots ' + arguments[0]).length"
        assert browser.execute_script(count, ".planned") == 2
        assert browser.execute_script(count, ".bit") == 2
        assert browser.execute_script(count, ".ellipse") >= 4
        assert "North (grid), m" in text(browser, ".plots")
        click(browser, ".choice")

        def turned():
            # The page may draw the path anew in between: then the element is another one, and the key is pressed again.
            try:
                view = browser.find_element(By.CSS_SELECTOR, ".turnable")
                before = view.get_attribute("innerHTML")
                view.send_keys(Keys.ARROW_LEFT)
                return view.get_attribute("innerHTML") != before
            except StaleElementReferenceException:
                return False

        wait(browser, turned)


def test_strip_charts_are_drawn_from_the_history(browser):
    with rig_on(browser) as rig:
        end = time.monotonic() + 2.2
        while time.monotonic() < end:
            rig.live()
            wait(browser, lambda: state_of(browser, "drilling.vibration") == "live")
        tab(browser, "charts")
        assert browser.execute_script("return document.querySelectorAll('.charts canvas').length") == 9
        wait(browser, lambda: "≤ 19.6 m/s²" in text(browser, ".charts"))
        assert "no data" in text(browser, ".charts")


def test_the_slide_sheet_lists_what_was_slid_at_which_toolface_and_what_it_gave(browser):
    with rig_on(browser) as rig:
        steered(rig)
        tab(browser, "steering")
        wait(browser, lambda: "126° GTF 100 %" in text(browser, "#tab-steering"))
        shown_text = text(browser, "#tab-steering")
        assert "slid 20.00 m, rotated 40.00 m, 33 % slid" in shown_text
        rows = browser.execute_script(
            "return [...document.querySelectorAll('.sheet tbody tr')].map((r) => r.className)"
        )
        assert rows[:3] == ["rotate", "slide", "rotate"]


def test_over_depth_the_tracks_stand_beside_slides_surveys_and_shaded_doubt(browser):
    with rig_on(browser) as rig:
        steered(rig)
        tab(browser, "charts")
        click(browser, "#tab-charts .choice")
        count = "return document.querySelectorAll('.depth-box ' + arguments[0]).length"
        wait(browser, lambda: browser.execute_script(count, ".track") > 5)
        assert browser.execute_script(count, ".mode-slide") == 1
        assert browser.execute_script(count, ".mode-rotate") == 2
        assert browser.execute_script(count, ".shade-doubt") == 6
        # One station was accepted in the interval; it is a dot on the inclination.
        assert browser.execute_script(count, ".station") == 1
        assert not browser.find_element(By.CSS_SELECTOR, ".charts").is_displayed()


def test_the_system_tab_gives_rate_and_age_of_each_stream(browser):
    with rig_on(browser) as rig:
        rig.state.on_stream("sonde", 300, time.monotonic() - 2.0)
        rig.state.on_stream("sonde", 100, time.monotonic())
        rig.push()
        tab(browser, "system")
        rows = "return [...document.querySelectorAll('#tab-system tbody tr')].map((r) => r.innerText)"
        shown = re.compile(r"Sonde\s+\S*\s*(live|STALE)\s+.*s\s+\d+(\.\d)?/s")
        wait(browser, lambda: any(shown.search(row) for row in browser.execute_script(rows)))


def test_the_system_tab_gives_clock_offset_age_and_depth_of_each_input(browser):
    table = InputTable(
        (
            InputState("sonde", StampClock.TOOL, -0.25, 1.0, 0.125),
            InputState("rig_floor", StampClock.RIG, 1.5, 1.0, 0.5, Role.IN_FORCE, 1, 1234.5),
            InputState("rig_wits", StampClock.HOST, 0.0, 1.0, 0.5, Role.STANDBY, 3, 1222.5, "rig_floor is used"),
        ),
        "rig_floor",
        0.5,
        12.0,
    )
    with rig_on(browser) as rig:
        rig.state.show(time.monotonic(), inputs=table)
        rig.push()
        tab(browser, "system")
        rows = "return [...document.querySelectorAll('#inputs tbody tr')].map((r) => r.innerText)"
        wait(browser, lambda: len(browser.execute_script(rows)) == 3)
        sonde, floor, wits = (row.replace("\t", " ") for row in browser.execute_script(rows))
        assert re.search(r"sonde tool \u22120\.250 s < 1 s", sonde), sonde
        assert re.search(r"rig_floor rig \+1\.500 s .* 1234\.5 m\s+\S*\s*in force", floor, re.DOTALL), floor
        assert re.search(r"1222\.5 m\s+\S*\s*stands by", wits), wits


def test_the_azimuth_has_a_strip_over_time_and_over_depth(browser):
    with rig_on(browser) as rig:
        steered(rig)
        tab(browser, "charts")
        wait(browser, lambda: "Azimuth" in text(browser, ".charts"))
        click(browser, "#tab-charts .choice")
        wait(browser, lambda: "Azimuth, °" in text(browser, ".depth-box"))


def test_two_links_are_named_in_strip_and_tab(browser):
    pulses = LinkStatus(
        *("mud_pulse", LOCKED, "", 9.5, 3.5, 1e-4, 0.01, 0.4, "survey", 2, 7, 12.0, math.nan, 40.0, 50.0),
        stamp_ns=1,
        at=0.0,
    )
    em = LinkStatus("em", SEARCHING, "no marker yet", *[math.nan] * 5, "", 0, 0, *[math.nan] * 4, stamp_ns=1, at=0.0)
    with rig_on(browser) as rig:
        rig.state.on_link(dataclasses.replace(pulses, others=(em,)), time.monotonic())
        rig.push()
        wait(browser, lambda: "em: searching" in (text(browser, "#link-strip") or ""))
        assert "mud pulse: locked" in text(browser, "#link-strip")
        tab(browser, "link")
        wait(browser, lambda: "no marker yet" in (text(browser, ".link-others") or ""))
        assert text(browser, ".link-reason").startswith("In use: mud pulse.")
