# SPDX-License-Identifier: Apache-2.0
"""Surveys: the table, verdicts, the last one and the one under way."""

import re
import time

import pytest

from browser_page import EVIL, By, click, in_each_size, rig_on, survey, tab, text, wait
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.well_state import SurveyProgress
from mwd_surface.surveys.mine_hole import CONSISTENT, Branch, Closure

pytestmark = pytest.mark.slow


def test_the_survey_table_has_words_for_verdicts_and_a_projected_last_line(browser):
    with rig_on(browser):
        rows = browser.execute_script(
            "return [...document.querySelectorAll('table.surveys tbody tr')].map((r) => r.innerText)"
        )
        assert "projected" in rows[0]
        assert "1220.00" in rows[0]
        assert "doubtful" in rows[1]
        assert "I✓ A? T✓" in rows[1]
        assert all("accepted" in row and "auto" in row for row in rows[2:])
        click(browser, "[data-keep=row-4]")
        detail = text(browser, ".detail")
        assert "total field is 380 nT over" in detail
        assert "External field: use a gyro" in detail
        assert "accept, doubtful, accept" in detail
        assert "(4.0 %)" in detail
        assert browser.find_element(By.CSS_SELECTOR, "[data-keep=row-4]").get_attribute("aria-expanded") == "true"
        assert "doubtful" in text(browser, '[data-light="doubtful"]')


def test_names_and_comments_with_markup_stay_text(browser):
    with rig_on(browser):
        click(browser, "[data-keep=row-2]")
        assert EVIL in text(browser, ".detail")
        for name in ("alarms", "system"):
            tab(browser, name)
            assert EVIL in text(browser, f"#tab-{name}")
        assert browser.execute_script("return document.querySelectorAll('img').length") == 0
        assert "owned" not in browser.title


def test_a_survey_counts_down_by_itself_and_what_it_waits_for_is_said_with_its_time(browser):
    def seconds(words):
        found = re.search(rf"{words} (\d+) s|(\d+) s {words}", text(browser, "#progress"))
        return int(found[1] or found[2]) if found else None

    with rig_on(browser, settings=LiveSettings()) as rig:

        def counts_down_from(high, low, words):
            rig.live()
            left = seconds(words)
            return left is not None and low <= left <= high

        rig.state.show(time.monotonic(), survey_progress=SurveyProgress(True, "averaging", 7.0, 4.9))
        wait(browser, lambda: counts_down_from(5, 1, "to go"))

        def finishes():
            rig.live()
            return "finishing" in text(browser, "#progress")

        wait(browser, finishes)
        # Samples stopped: the countdown does not pretend.
        wait(browser, lambda: "SURVEY HELD UP" in text(browser, "#progress"))
        waits = SurveyProgress(True, "averaging on", 12.0, 108.0, waits_for="gyro azimuth sigma 2.1 deg")
        rig.state.show(time.monotonic(), survey_progress=waits)
        wait(browser, lambda: counts_down_from(108, 100, "at most"))
        assert "SURVEY WAITS" in text(browser, "#progress")
        assert "gyro azimuth sigma 2.1 deg" in text(browser, "#progress")
        begun = seconds("at most")
        wait(browser, lambda: counts_down_from(begun - 1, 50, "at most"))
        rig.state.show(time.monotonic(), survey_progress=SurveyProgress(result="no survey taken: the tool turns"))
        rig.push()
        wait(browser, lambda: "Last: no survey taken: the tool turns" in text(browser, "#progress"))
        assert "No survey under way" in text(browser, "#progress")


def test_each_line_of_the_survey_table_shows_its_deviations_with_their_verdict(browser):
    with rig_on(browser):
        words = "[...document.querySelectorAll('tr[data-sequence=\"4\"] .word')]"
        found = browser.execute_script(f"return {words}.map((e) => [e.className, e.textContent])")
        assert found == [["word good", "0.00 ✓"], ["word doubtful", "+380 ▲"], ["word good", "0.00 ✓"]]


def test_the_last_survey_says_what_to_do_and_what_each_quantity_is_worth(browser):
    with rig_on(browser):
        wait(browser, lambda: "External field: use a gyro" in text(browser, "#reasons .headline"))
        assert "Azimuth may also be 57.3° (4.0 %)" in text(browser, "#reasons")
        assert text(browser, ".each") == "inclination ✓azimuth ▲toolface ✓"


# Rectangles of the lines of text in the box, that of the box, and how much of the text is out of view.
LINES = """
  const box = document.getElementById("reasons"), range = document.createRange(), lines = [];
  const texts = document.createTreeWalker(box, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    range.selectNodeContents(texts.currentNode);
    lines.push(...[...range.getClientRects()].map((r) => [r.top, r.bottom]));
  }
  const { top, bottom } = box.getBoundingClientRect();
  return [lines, top, bottom, box.scrollHeight - box.clientHeight];
"""


def test_the_box_of_reasons_shows_whole_lines_only(browser):
    with rig_on(browser) as rig:
        reasons = tuple(f"possible disturbances of the field: string magnetised {k} %, storm" for k in range(9))
        rig.list = rig.list.add(survey(5, headline="External field: use a gyro", reasons=reasons), 1500.0, 1.0)
        rig.publish()
        wait(browser, lambda: "magnetised 8 %" in text(browser, "#reasons"))
        for size in in_each_size(browser):
            lines, top, bottom, hidden = browser.execute_script(LINES)
            whole = [top - 1.0 <= first and last <= bottom + 1.0 for first, last in lines]
            outside = [last <= top + 1.0 or first >= bottom - 1.0 for first, last in lines]
            assert sum(whole) > 1, size
            assert all(inside or away for inside, away in zip(whole, outside, strict=True)), size
            # On a phone the page scrolls, not the box.
            assert hidden == 0 or size[0] >= 1024, size


LONG = (
    "external magnetic field (65 % probable: casing, fish or another well near), or a collar that is magnetised "
    "(21 %): move the sensor away, or use a gyro"
)


def test_the_instruction_of_a_doubtful_survey_is_read_to_its_end(browser):
    with rig_on(browser) as rig:
        doubtful = {"verdict": 1, "verdict_azimuth": 1, "headline": LONG, "reasons": ("total field is 380 nT over",)}
        rig.list = rig.list.add(survey(5, **doubtful), 1500.0, 1.0)
        rig.publish()
        wait(browser, lambda: text(browser, ".taking") == LONG)
        cut = """
          const words = document.querySelector(".taking"), room = document.querySelector("#progress");
          const bottom = words.getBoundingClientRect().bottom - room.getBoundingClientRect().bottom;
          return [words.scrollWidth - words.clientWidth, words.scrollHeight - words.clientHeight, bottom];
        """
        for size in in_each_size(browser):
            assert max(browser.execute_script(cut)) <= 1, size


def test_the_steering_tab_shows_the_branches_of_a_mine_hole_and_its_closure_with_the_verdict(browser):
    branch = Branch("B1", "main", True, 45.0, 1.5, 1.3, (10.0, 40.0, -2.0), 63.0)
    closed = Closure("B1", 63.0, -0.31, 0.12, 0.05, 0.2, 0.1, 0.02, 0.05, 0.34, 0.5, CONSISTENT)
    with rig_on(browser) as rig:
        tab(browser, "steering")
        assert not browser.find_element(By.ID, "closure").is_displayed()
        rig.state.show(time.monotonic(), branches=(branch,), closure=closed)
        rig.push()
        wait(browser, lambda: "consistent" in text(browser, "#closure"))
        shown = text(browser, "#closure")
        assert "B1 63.00 m" in shown
        assert "0.31 ± 0.20 left" in shown
        assert "0.12 ± 0.10 up" in shown
        assert "0.05 ± 0.02 beyond" in shown
        assert "45.00" in text(browser, "#branches")
        # Why a closure is not known is said instead of numbers.
        rig.state.show(time.monotonic(), closure=Closure("B1", note="the opening is missing"))
        rig.push()
        wait(browser, lambda: "the opening is missing" in text(browser, "#closure"))
        assert "not known" in text(browser, "#closure")
        assert browser.find_elements(By.CSS_SELECTOR, "#closure tbody tr") == []
