# SPDX-License-Identifier: Apache-2.0
"""Sizes, keyboard, reading aids, and a browser without complaints."""

import json
import time
from pathlib import Path

import pytest

from browser_page import (
    SIZES,
    TOKEN,
    By,
    Keys,
    box,
    click,
    font_sizes,
    in_each_size,
    rig_on,
    sign_in,
    state_of,
    steered,
    tab,
    text,
    wait,
)
from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_surface.live.alarms import Severity
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.supervision import TABLE
from mwd_surface.live.well_state import SurveyProgress

pytestmark = pytest.mark.slow(2)

AXE = Path(__file__).parent / "vendor" / "axe.min.js"


def objections(browser, part):
    found = browser.execute_async_script("axe.run(arguments[0]).then(arguments[1])", part)
    assert len(found["passes"]) > 5, "axe looked at nothing"
    return [(v["id"], [n["target"] for n in v["nodes"]][:4]) for v in found["violations"]]


def test_the_keyboard_alone_reaches_tabs_and_survey_lines(browser):
    with rig_on(browser):
        browser.find_element(By.ID, "select-surveys").send_keys(Keys.ARROW_RIGHT)
        assert browser.switch_to.active_element.get_attribute("id") == "select-path"
        browser.switch_to.active_element.send_keys(Keys.HOME)
        seen = []
        for _ in range(6):
            browser.switch_to.active_element.send_keys(Keys.TAB)
            seen.append(browser.switch_to.active_element.get_attribute("data-keep"))
        assert "row-4" in seen
        browser.find_element(By.CSS_SELECTOR, "[data-keep=row-4]").send_keys(Keys.ENTER)
        assert browser.switch_to.active_element.get_attribute("data-keep") == "row-4"
        assert text(browser, ".detail")


def test_nothing_moves_when_alarms_surveys_faults_and_silence_come_and_go(browser):
    places = ("#dial-panel", "#dial svg", "#numbers", "#small", "#quality", "#lights", "#tabs", "#alarm")

    def layout():
        return {size: [box(browser, place) for place in places] for size in in_each_size(browser, SIZES)}

    def shows_disturbance():
        rig.live(status=int(Status.ROTATING | Status.NO_MAG | Status.CLIPPED | Status.MAG_DISTURBED))
        return "magnetic disturbance" in text(browser, "#pills")

    with rig_on(browser, settings=LiveSettings()) as rig:
        rig.live()
        wait(browser, lambda: state_of(browser, "attitude.inclination") in ("live", "stale"))
        before = layout()
        rig.state.show(time.monotonic(), survey_progress=SurveyProgress(True, "averaging", 7.0, 9.0, waits_for="gyro"))
        rig.alarm_log.raise_alarm("a", Severity.CRITICAL, 9 * "a long text of an alarm ", 9 * "do this ")
        rig.publish()
        wait(browser, shows_disturbance)
        assert layout() == before, "trouble"
        wait(browser, lambda: state_of(browser, "attitude.inclination") == "stale")
        assert layout() == before, "stale"
        rig.server.stop()
        wait(browser, lambda: browser.find_element(By.ID, "banner").is_displayed())
        assert layout() == before, "disconnected"


def test_nothing_is_wider_than_the_screen(browser):
    with rig_on(browser) as rig:
        rig.live()
        for size in in_each_size(browser, SIZES):
            for name in ("surveys", "path", "charts", "steering", "alarms", "system", "controls"):
                if browser.find_elements(By.ID, f"select-{name}"):
                    tab(browser, name)
                width, inner = browser.execute_script(
                    "return [document.documentElement.scrollWidth, window.innerWidth]"
                )
                assert width <= inner, name
            if size[0] >= 1024:
                height, inner = browser.execute_script("return [document.documentElement.scrollHeight, innerHeight]")
                assert height <= inner
            table = "const t = document.querySelector('.table-box'); return [t.scrollWidth, t.clientWidth]"
            if browser.find_elements(By.ID, "select-surveys"):
                tab(browser, "surveys")
            wide, room = browser.execute_script(table)
            assert wide <= room
            if size[0] >= 1024:
                # Whole lines: the lower edge of the table's room is that of a line.
                edges = """
                  const room = document.querySelector(".table-box").getBoundingClientRect();
                  return [...document.querySelectorAll(".surveys tr")].map((r) => r.getBoundingClientRect())
                    .filter((r) => r.top < room.bottom - 2 && r.bottom > room.bottom + 2).map((r) => [r.top, r.bottom]);
                """
                assert browser.execute_script(edges) == []


def test_what_is_touched_is_large_enough_for_gloves(browser):
    with rig_on(browser):
        sizes = browser.execute_script(
            "return [...document.querySelectorAll('#tabs button, .switches button')]"
            ".map((b) => b.getBoundingClientRect()).map((r) => [r.width, r.height])"
        )
        assert all(height >= 44 and width >= 44 for width, height in sizes)


def test_values_are_at_least_24_pixels_high(browser):
    with rig_on(browser) as rig:
        rig.live()
        wait(browser, lambda: state_of(browser, "rig.bit_depth") == "live")
        assert min(font_sizes(browser, ".value[data-state=live] .number")) >= 24


@pytest.mark.parametrize(
    ("theme", "size"),
    [("night", SIZES[0]), pytest.param("day", SIZES[1], marks=pytest.mark.nightly), ("day", SIZES[2])],
)
def test_axe_finds_nothing_to_object_to_on_any_tab(browser, theme, size):
    with rig_on(browser, size) as rig:
        steered(rig)
        if browser.execute_script("return document.documentElement.dataset.theme") != theme:
            click(browser, "#theme")
        browser.execute_script(AXE.read_text(encoding="utf-8"))
        sign_in(browser, TOKEN)
        for name in ("controls", "path", "charts", "steering", "alarms", "system", "surveys"):
            if browser.find_elements(By.ID, f"select-{name}"):
                tab(browser, name)
            if name != "surveys":
                assert objections(browser, f"#tab-{name}") == [], name
            if name == "charts":
                click(browser, "#tab-charts .choice")
                assert objections(browser, "#tab-charts") == [], "over depth"
        click(browser, "[data-keep=row-4]")
        assert objections(browser, "html") == []


def test_the_browser_has_nothing_to_complain_about(browser):
    with rig_on(browser) as rig:
        rig.live()
        wait(browser, lambda: text(browser, ".dial-number") == "127°")
        for name in ("path", "charts", "steering", "alarms", "system", "controls", "surveys"):
            tab(browser, name)
        assert [m for m in browser.get_log("browser") if m["level"] in ("SEVERE", "WARNING")] == []
        names = browser.execute_script(
            "return JSON.stringify(performance.getEntriesByType('resource').map((e) => e.name))"
        )
        assert all(name.startswith(rig.server.address) for name in json.loads(names))


def test_whether_it_is_recorded_and_what_the_alarm_is_stay_in_view_beside_trouble(browser):
    with rig_on(browser) as rig:
        rig.alarm_log.raise_alarm("mag", Severity.CRITICAL, "magnetometer no longer sends samples", "plug")
        rig.publish()
        rig.live(status=int(Status.SENSOR_FAULT | Status.NO_MAG | Status.ROTATING))
        wait(browser, lambda: "no magnetometer" in text(browser, "#pills"))
        wait(browser, lambda: "no longer" in text(browser, ".alarm-what"))
        cut = """
          const row = document.getElementById("pills").getBoundingClientRect();
          const pill = [...document.querySelectorAll("#pills .pill")].find((p) => p.textContent.includes("recording"));
          const place = pill.getBoundingClientRect(), what = document.querySelector(".alarm-what");
          return [place.bottom - row.bottom, place.right - row.right, what.scrollHeight - what.clientHeight,
            what.scrollWidth - what.clientWidth];
        """
        for size in in_each_size(browser, SIZES):
            assert max(browser.execute_script(cut)) <= 1, size
        with_pumps = wire.RIG_STATE.empty(1)
        with_pumps["flow_rate"], with_pumps["valid"] = 0.03, 128
        rig.state.on_rig_state(with_pumps, time.monotonic())
        rig.state.on_stream("sonde", 1, time.monotonic())
        rig.push()
        wait(browser, lambda: "pumps on" in text(browser, "#pills"))
        for size in in_each_size(browser, SIZES):
            assert browser.execute_script(OUT_OF_THE_ROW) == [], size


# Pills that do not fit in their row, or on a phone upright in their two rows.
OUT_OF_THE_ROW = """
  const row = document.getElementById("pills").getBoundingClientRect();
  return [...document.querySelectorAll("#pills .pill")].map((p) => [p.getBoundingClientRect(), p.textContent])
    .filter(([place]) => row.width > 0 && (place.bottom > row.bottom + 1 || place.right > row.right + 1))
    .map(([, words]) => words);
"""

# Elements whose text is wider or higher than their room.
CUT = """
  return [...document.querySelectorAll(arguments[0])].filter((e) => e.clientWidth > 0)
    .filter((e) => e.scrollWidth > e.clientWidth + 1 || e.scrollHeight > e.clientHeight + 1).map((e) => e.textContent);
"""


def test_alarms_troubles_and_what_a_survey_waits_for_are_read_to_their_ends(browser):
    words = "#alarm, .alarm-what, .alarm-remedy, .alarm-age, #pills .pill, #datum, .taking, .doing, .value .under"

    def cut_off():
        return {size: cut for size in in_each_size(browser) if (cut := browser.execute_script(CUT, words))}

    with rig_on(browser, settings=LiveSettings()) as rig:
        waits = SurveyProgress(True, "averaging on", 12.0, 108.0, waits_for="gyro azimuth sigma 2.1 deg")

        def shown():
            # Again and again: on a slow machine it is stale before the page has drawn it.
            rig.state.show(time.monotonic(), survey_progress=waits)
            rig.live(status=int(Status.SENSOR_FAULT | Status.NO_MAG | Status.ROTATING))
            return "WAITS" in text(browser, ".taking")

        wait(browser, shown)
        for number, row in enumerate(one for one in TABLE if one.severity == Severity.CRITICAL):
            what = row.what.format(limit=row.limit, value=12.0)
            rig.alarm_log.raise_alarm(f"a{number}", Severity.CRITICAL, what, row.remedy)
            rig.publish()
            wait(browser, lambda what=what: what in text(browser, ".alarm-what"))
            assert cut_off() == {}
        wait(browser, lambda: state_of(browser, "attitude.inclination") == "stale")
        assert cut_off() == {}
        # The dial alone has less room for them.
        click(browser, "#view")
        assert cut_off() == {}


def test_the_bar_of_a_replay_leaves_room_for_the_bit_and_the_last_survey(browser):
    with rig_on(browser) as rig:
        rig.push(replay={"at": 1.0, "length": 60.0, "playing": False, "rate": 1.0})
        wait(browser, lambda: browser.find_element(By.ID, "replay").is_displayed())
        bottom = box(browser, "#replay")[1]
        rows = browser.find_elements(By.CSS_SELECTOR, "table.surveys tbody tr")
        assert all(row.rect["y"] + row.rect["height"] <= bottom for row in rows[:2])
