# SPDX-License-Identifier: Apache-2.0
"""The page in another language: all its texts, the sentences of the surface unit, and the choice of language."""

import json
import re

import pytest

from browser_page import EVIL, By, click, rig_on, steered, tab, text, wait
from mwd_surface.language.language import language

pytestmark = pytest.mark.slow(2)

CHINESE = language("zh_CN")
TABS = ("surveys", "path", "charts", "logs", "steering", "link", "alarms", "system", "controls")
# Units, names of wells, zones and models, abbreviations that drillers use in Chinese as well, and names of settings.
KEPT = {
    "CSV",
    "DXF",
    "XLSX",
    "LAS",
    "PDF",
    "HTML",
    "WITSML",
    "MWD",
    "UTC",
    "RKB",
    "Nordlys",
    "NORDLYS",
    "WMM",
    "pygeomag",
    "min",
} | {*("Esc", "English", "Shanghai", "WebSocket", "bags", "control", "enabled")}
# Words that the test itself typed into the page.
TYPED = frozenset(["External", "field", "use", "gyro", "total", "over", "off", "check", "slow", "look", "mag"])


def in_chinese(browser):
    browser.get(f"{browser.current_url.partition('?')[0]}?lang=zh_CN")
    wait(browser, lambda: browser.find_element(By.TAG_NAME, "html").get_attribute("lang") == "zh-CN")
    wait(browser, lambda: "井斜角" in text(browser, "#numbers"))


@pytest.fixture
def forget(browser):
    """Return the browser to its own language afterwards."""
    yield
    browser.execute_script("localStorage.removeItem('language')")


def test_no_text_of_the_page_is_left_in_english(browser, forget):
    with rig_on(browser) as rig:
        steered(rig)
        in_chinese(browser)
        found = {}
        for name in TABS:
            tab(browser, name)
            rig.live()
            shown = browser.execute_script(
                "return [document.body.innerText, ...[...document.querySelectorAll('[aria-label],[title]')]"
                ".flatMap((e) => [e.getAttribute('aria-label') || '', e.getAttribute('title') || ''])].join('\\n')"
            )
            for line in shown.replace(EVIL, "").splitlines():
                words = [w for w in re.findall(r"[A-Za-z]{3,}", line) if w not in KEPT | TYPED]
                if words:
                    found.setdefault(line, name)
        assert not found, sorted(found.items())


def test_the_page_says_a_sentence_as_the_report_does(browser, forget):
    """The script of the page and Python translate every template, and texts that match none, in the same way."""
    templates = [one for one in CHINESE.entries if "{" in one and "{0}" not in one]
    sentences = [re.sub(r"\{\w+\}", lambda m: f"{len(m[0])}.5", one) for one in templates]
    sentences += [f"{a}; {b}" for a, b in zip(sentences, sentences[7:], strict=False)]
    sentences += ["", "nobody wrote this", "survey 4: Ann's own words", "x is -y", "12.5 deg", "stop drilling"]
    sentences += ["Salt and Pepper", "north: Salt.csv", "tool at 12:30", "A, B or C", "tool; Ann's", "recorder: stop"]
    sentences += [f"accepted by {name} against the automatic verdict reject" for name in ("north", "tool; rig", "x: y")]
    sentences += [
        "no : is of at , ; " * 900,
        "; ".join(sentences[:40]),
        " and ".join([*templates[:80], "zz"]),
        "a" * 99_999,
    ]
    with rig_on(browser):
        in_chinese(browser)
        said = browser.execute_async_script(
            "const done = arguments[1]; import('./words.js').then(({ say }) => done(arguments[0].map(say)))", sentences
        )
    assert said == [CHINESE.say(one) for one in sentences]


FONT_IS_THERE = """return document.fonts.check('1em "Noto Sans SC Subset"', '中')"""


def test_chinese_texts_have_a_font_before_they_are_drawn(browser, forget):
    """The font comes from the surface unit, for screens that have none."""
    with rig_on(browser):
        in_chinese(browser)
        assert browser.execute_script(FONT_IS_THERE)
        for part in ("body", "#tabs button"):
            family = f"return getComputedStyle(document.querySelector('{part}')).fontFamily"
            assert "Noto Sans SC Subset" in browser.execute_script(family)


def test_what_a_person_typed_about_a_survey_is_shown_as_it_is(browser, forget):
    """Reason and name of a person are no texts of the catalogue, even where it has the same words."""
    assert CHINESE.unknown("no data") == 0
    with rig_on(browser) as rig:
        rig.list = rig.list.reject(4, "no data", "stop", 9)
        rig.publish()
        in_chinese(browser)
        click(browser, "[data-keep=row-4]")
        wait(browser, lambda: "no data: stop" in text(browser, ".detail"))


def test_the_language_is_chosen_on_the_page_and_kept(browser, forget):
    with rig_on(browser):
        assert browser.find_element(By.TAG_NAME, "html").get_attribute("lang") == "en"
        click(browser, "#language option[value=zh_CN]")
        wait(browser, lambda: "测斜" in text(browser, "#tabs, #tab-surveys"))
        browser.get(browser.current_url.partition("?")[0])
        wait(browser, lambda: "井斜角" in text(browser, "#numbers"))
        assert json.loads(browser.execute_script("return JSON.stringify([localStorage.language])")) == ["zh_CN"]
