"""The driller's page in a real browser: content, age, units, controls, keyboard, reading aids, sizes."""

import contextlib
import dataclasses
import json
import math
import re
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_surface.bags.recorder.status import RecorderState, RecorderStatus
from mwd_surface.live.alarms import AlarmBook, Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.well_state import NodeDiagnostic, ReferenceField, SurveyProgress
from mwd_surface.page.page_server import PageServer
from mwd_surface.page.settings import PageSettings
from mwd_surface.page.state_json import StateJson
from mwd_surface.surveys.clearance import Clearance, ClearanceRule
from mwd_surface.surveys.plan import Offset, plan_of
from mwd_surface.surveys.slide_sheet import SlideSheet, yields
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import North, Survey, Verdict
from mwd_surface.surveys.well import Well

webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed (pip install selenium)")
from selenium.common.exceptions import StaleElementReferenceException  # noqa: E402
from selenium.webdriver.chrome.options import Options  # noqa: E402
from selenium.webdriver.chrome.service import Service  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.ui import WebDriverWait  # noqa: E402

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
CHROMEDRIVER = shutil.which("chromedriver")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (CHROMIUM and CHROMEDRIVER),
        reason="no chromium and chromedriver here (apt install chromium chromium-driver)",
    ),
]
AXE = Path(__file__).parent / "vendor" / "axe.min.js"
TOKEN = "drill-baby-drill"  # noqa: S105
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
)
EVIL = "<img src=x onerror=document.title='owned'>"
SIZES = ((1024, 768), (1920, 1080), (390, 844))


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    options = Options()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(CHROMEDRIVER))
    driver.set_page_load_timeout(20)
    yield driver
    driver.quit()


RECORDING = RecorderStatus(RecorderState.RECORDING, "", Path("bags/a"), 7, 0, 0, 0, 0, 0, -1, 61.0, 1, 0.0, ())


def near(name, least):
    """An offset well that is nearest at 1250 m."""
    md = np.array([1200.0, 1250.0, 1300.0])
    distance, allowed, away = least + np.abs(md - 1250.0), np.full(3, 10.0), np.full(3, 0.5)
    return Clearance(name, md, md, distance, allowed, distance / allowed, away, away, ClearanceRule())


class Rig:
    """A surface unit without a node: state, alarms, surveys and the page's server."""

    def __init__(self, token=TOKEN):
        self.state, self.tables = LiveState(), StateJson()
        self.book, self.calls = AlarmBook(), []
        self.list = SurveyList(well=Well(name="Nordlys 7 H", north_reference="grid", section_azimuth_deg=60.0))
        self.server = PageServer(PageSettings(port=0), self.command, token=token)

    def command(self, name, arguments):
        self.calls.append((name, arguments))
        if name == "accept_survey":
            self.list = self.list.accept(arguments["sequence"], arguments["operator_name"], arguments["reason"], 9)
            self.publish()
        if name == "acknowledge_alarm":
            answer = self.book.acknowledge(arguments["id"], arguments["operator_name"], 9)
            self.publish()
            return answer
        return True, f"{name} done"

    def fill(self):
        for k in range(1, 5):
            odd = {"verdict": int(Verdict.DOUBTFUL), "reasons": ("total field is 380 nT over",), "b_total": 50.38e-6}
            odd |= {"verdict_azimuth": int(Verdict.DOUBTFUL), "headline": "External field: use a gyro"}
            odd |= {"alternatives": (1.0,), "alternative_odds": (0.04,)}
            self.list = self.list.add(survey(k, **(odd if k == 4 else {})), 300.0 * k, 1.0, comment=EVIL)
        self.book.raise_alarm(
            "mag.field", Severity.WARNING, f"total field is off {EVIL}", "check", time.time_ns() - 75 * 10**9
        )
        self.live()
        self.publish()

    def publish(self):
        now = time.monotonic()
        reference = ReferenceField(declination=-0.014, convergence=-0.0157, source="WMM2025")
        self.state.on_well(self.list.well, now, reference)
        self.state.on_records(self.list.records, now)
        path = self.list.definitive(bit_depth=1220.0)
        self.state.on_trajectory(path, now, np.tile(np.diag([9.0, 4.0, 1.0]), (len(path.md), 1, 1)))
        plan = plan_of([0.0, 600.0, 1800.0], [0.0, 0.3, 1.0], [1.0, 1.0, 1.0], name="C")
        self.state.on_plan(plan, now)
        self.state.on_clearance((near("A-3", 9.0), near(EVIL, 40.0)), now)
        self.state.on_alarms(self.book.alarms(), self.book.events(), now, time.time_ns())
        self.state.on_diagnostics([NodeDiagnostic(EVIL, 1, "slow", "look")], now)
        self.push()

    def live(self, inclination_deg=44.62, toolface_deg=127.0, status=65536):
        now = time.monotonic()
        a = wire.ATTITUDE.empty(1)
        a["stamp_ns"] = 1_795_000_000 * 10**9
        a["inclination"], a["azimuth"] = math.radians(inclination_deg), math.radians(359.999)
        a["gravity_toolface"], a["magnetic_toolface"] = math.radians(toolface_deg), math.radians(33.0)
        for name in ("inclination", "azimuth", "gravity_toolface", "magnetic_toolface"):
            a["sigma_" + name] = math.radians(0.5)
        a["north"], a["status"] = 3, status
        self.state.on_attitude(a, now)
        g = wire.GRAVITY.empty(1)
        g["sigma"], g["non_gravity"], g["rotary_speed"] = 0.001, 19.6133, 0.0
        self.state.on_gravity(g, now)
        r = wire.RIG_STATE.empty(1)
        r["bit_depth"], r["hole_depth"], r["valid"] = 1220.0, 1250.0, 3
        self.state.on_rig_state(r, now)
        self.state.on_recorder(RECORDING, now)
        self.push()

    def push(self):
        self.server.push(self.tables.snapshot(self.state.at(time.monotonic())))


def survey(sequence, **changes):
    base = Survey(
        stamp_ns=(1_795_000_000 + sequence) * 10**9,
        uuid=f"u{sequence}",
        sequence=sequence,
        inclination=0.2 * sequence,
        azimuth=1.0,
        north=int(North.GRID),
        covariance=(1e-6, 0, 0, 0, 1e-4, 0, 0, 0, 1e-6),
        azimuth_method="corrected",
        g_total=9.82,
        b_total=50e-6,
        dip=1.2,
        g_reference=9.82,
        b_reference=50e-6,
        dip_reference=1.2,
    )
    return dataclasses.replace(base, **changes)


@contextlib.contextmanager
def rig_on(browser, size=(1024, 768), path="", **options):
    rig = Rig(**options)
    rig.fill()
    rig.server.start()
    try:
        show(browser, rig, size, path)
        yield rig
    finally:
        rig.server.stop()


def show(browser, rig, size=(1024, 768), path=""):
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False},
    )
    browser.get(rig.server.address + path)
    wait(browser, lambda: text(browser, "#well-name") == "Nordlys 7 H")


def wait(browser, condition, seconds=5.0):
    WebDriverWait(browser, seconds, poll_frequency=0.02).until(lambda _: condition())


def text(browser, selector):
    return browser.execute_script("return document.querySelector(arguments[0])?.textContent ?? null", selector)


def state_of(browser, cell):
    return browser.execute_script("return document.querySelector(arguments[0])?.dataset.state", f'[data-cell="{cell}"]')


def click(browser, selector):
    browser.find_element(By.CSS_SELECTOR, selector).click()


def tab(browser, name):
    click(browser, f"#select-{name}")


def objections(browser, part):
    found = browser.execute_async_script("axe.run(arguments[0]).then(arguments[1])", part)
    assert len(found["passes"]) > 5, "axe looked at nothing"
    return [(v["id"], [n["target"] for n in v["nodes"]][:4]) for v in found["violations"]]


def test_the_first_screen_says_where_the_tool_points_with_unit_sigma_and_age(browser):
    with rig_on(browser) as rig:
        rig.live()
        wait(browser, lambda: text(browser, ".dial-number") == "127°")
        assert text(browser, ".dial-side") == "127 R"
        assert "high side up" in text(browser, "#dial-legend")
        inclination = text(browser, '[data-cell="attitude.inclination"]')
        assert "44.62°" in inclination
        assert "± 0.50 1σ" in inclination
        # 359.999 rounds to north, not to 360.
        assert "0.00°" in text(browser, '[data-cell="attitude.azimuth"]')
        assert "grid north" in text(browser, '[data-cell="attitude.azimuth"]')
        datum = text(browser, "#datum")
        assert all(word in datum for word in ("Depth from RKB", "grid north", "total correction +0.10°", "WMM2025"))
        assert "recording" in text(browser, "#pills")


def test_a_value_that_never_came_is_no_data_and_not_zero(browser):
    with rig_on(browser):
        box = text(browser, '[data-cell="drilling.temperature"]')
        assert "no data" in box
        assert "0" not in box
        assert state_of(browser, "drilling.temperature") == "none"


def test_the_dial_follows_within_200_ms_of_the_message(browser):
    with rig_on(browser) as rig:
        took = []
        for k in range(7):
            wanted = 10 + 20 * k
            started = time.monotonic()
            rig.live(toolface_deg=wanted)
            wait(browser, lambda wanted=wanted: text(browser, ".dial-number") == f"{wanted}°")
            took.append(time.monotonic() - started)
        assert sorted(took)[3] < 0.2


def test_a_wanted_toolface_is_a_sector_with_a_word_for_inside_and_outside(browser):
    with rig_on(browser) as rig:
        rig.state.on_advisory(math.radians(120.0), math.radians(15.0))
        rig.live(toolface_deg=127.0)
        wait(browser, lambda: "INSIDE" in text(browser, ".dial-note"))
        assert "wanted 120° ± 15°" in text(browser, "#dial-legend")
        rig.live(toolface_deg=160.0)
        wait(browser, lambda: "OUTSIDE" in text(browser, ".dial-note"))
        rig.live(toolface_deg=160.0, status=4)
        wait(browser, lambda: text(browser, ".dial-note") == "ROTATING")


def test_near_vertical_the_dial_turns_north_up(browser):
    with rig_on(browser) as rig:
        rig.live(inclination_deg=2.0, status=65536 | int(Status.NEAR_VERTICAL))
        wait(browser, lambda: text(browser, ".dial-number") == "33°")
        assert "MTF · grid north up" in text(browser, "#dial-legend")
        script = "return [...document.querySelectorAll('.cardinal')].map((t) => t.textContent).join(' ')"
        assert browser.execute_script(script) == "N E S W"


def test_a_tool_that_falls_silent_is_stale_within_three_seconds_while_the_link_lives(browser):
    with rig_on(browser) as rig:
        rig.live()
        wait(browser, lambda: state_of(browser, "attitude.inclination") == "live")
        started = time.monotonic()
        wait(browser, lambda: state_of(browser, "attitude.inclination") == "stale")
        assert time.monotonic() - started < 3.0
        wait(browser, lambda: "STALE" in text(browser, ".dial-note"))
        assert "STALE" in text(browser, '[data-cell="attitude.inclination"]')
        assert browser.find_element(By.ID, "banner").is_displayed() is False
        wait(browser, lambda: "no sonde" in text(browser, "#pills"))
        rig.live()
        wait(browser, lambda: state_of(browser, "attitude.inclination") == "live")


def test_a_surface_unit_that_goes_is_shown_within_three_seconds_and_found_again(browser):
    with rig_on(browser) as rig:
        rig.live()
        started = time.monotonic()
        rig.server.stop()
        wait(browser, lambda: browser.find_element(By.ID, "banner").is_displayed())
        assert time.monotonic() - started < 3.2
        assert "DISCONNECTED" in text(browser, "#banner")
        assert state_of(browser, "attitude.inclination") == "stale"


def test_the_page_comes_back_by_itself_when_the_unit_does(browser):
    with rig_on(browser) as rig:
        address = rig.server.address
        port = int(address.rstrip("/").rsplit(":", 1)[1])
        rig.server.stop()
        wait(browser, lambda: browser.find_element(By.ID, "banner").is_displayed())
        rig.server = PageServer(PageSettings(port=port), rig.command, token=TOKEN)
        rig.live(toolface_deg=200.0)
        rig.server.start()
        wait(browser, lambda: not browser.find_element(By.ID, "banner").is_displayed(), 8.0)
        wait(browser, lambda: text(browser, ".dial-number") == "200°")


@pytest.mark.fault_case(96)
def test_a_browser_whose_clock_is_hours_off_shows_the_right_age(browser):
    with rig_on(browser) as rig:
        source = "const real = Date.now; Date.now = () => real() + 7200000;"
        script = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": source})
        try:
            show(browser, rig)
            rig.live()
            wait(browser, lambda: state_of(browser, "attitude.inclination") == "live")
            assert "< 1 s" in text(browser, '[data-cell="attitude.inclination"]')
        finally:
            browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)


@pytest.mark.fault_case(95)
def test_where_no_websocket_gets_through_the_page_polls(browser):
    with rig_on(browser) as rig:
        source = "window.WebSocket = class { constructor() { setTimeout(() => this.onclose?.(), 10); } close() {} };"
        script = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": source})
        try:
            show(browser, rig)
            rig.live(toolface_deg=77.0)
            wait(browser, lambda: text(browser, ".dial-number") == "77°")
            assert not browser.find_element(By.ID, "banner").is_displayed()
        finally:
            browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)


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


def test_offset_wells_stand_beside_the_path_with_level_factor_and_distance(browser):
    with rig_on(browser) as rig:
        tab(browser, "path")
        wait(browser, lambda: "A-3" in (text(browser, "#clearance") or ""))
        shown = text(browser, "#clearance")
        assert shown.index("stop 0.90") < shown.index("clear 4.00")
        said = browser.find_element(By.CSS_SELECTOR, "#clearance dd").get_attribute("title")
        assert said == "9.00 m away at 1250.00 m; least allowed 10.00 m"
        assert shown.index("A-3") < shown.index(EVIL)
        rig.state.on_clearance((), time.monotonic())
        rig.push()
        wait(browser, lambda: text(browser, "#clearance") is None)


def test_names_and_comments_with_markup_stay_text(browser):
    with rig_on(browser):
        click(browser, "[data-keep=row-2]")
        assert EVIL in text(browser, ".detail")
        for name in ("alarms", "system"):
            tab(browser, name)
            assert EVIL in text(browser, f"#tab-{name}")
        assert browser.execute_script("return document.querySelectorAll('img').length") == 0
        assert "owned" not in browser.title


def test_one_switch_changes_every_unit_and_is_remembered(browser):
    with rig_on(browser) as rig:
        rig.live()
        wait(browser, lambda: "1220.0" in text(browser, '[data-cell="rig.bit_depth"]'))
        click(browser, "#units")
        wait(browser, lambda: "4003" in text(browser, '[data-cell="rig.bit_depth"]'))
        assert "ft" in text(browser, '[data-cell="rig.bit_depth"]')
        assert "2.00" in text(browser, '[data-cell="drilling.vibration"]')
        assert "°/100 ft" in text(browser, "table.surveys thead")
        show(browser, rig)
        wait(browser, lambda: "4003" in text(browser, '[data-cell="rig.bit_depth"]'))
        click(browser, "#units")
        wait(browser, lambda: "1220.0" in text(browser, '[data-cell="rig.bit_depth"]'))


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


def test_without_a_token_on_the_server_there_is_nothing_to_press(browser):
    with rig_on(browser, token=""):
        tab(browser, "controls")
        assert "read-only" in text(browser, "#tab-controls")
        assert browser.execute_script("return document.querySelectorAll('#tab-controls button, .judging').length") == 0


def test_without_the_token_in_the_browser_nothing_can_be_pressed(browser):
    with rig_on(browser) as rig:
        tab(browser, "controls")
        buttons = browser.find_elements(By.CSS_SELECTOR, "#tab-controls button")
        assert buttons
        assert not any(b.is_enabled() for b in buttons)
        tab(browser, "surveys")
        click(browser, "[data-keep=row-4]")
        assert browser.find_elements(By.CSS_SELECTOR, ".judging") == []
        assert rig.calls == []


def sign_in(browser, token, name="A. Berg"):
    tab(browser, "controls")
    for field, value in (("operator-name", name), ("operator-token", token)):
        box = browser.find_element(By.ID, field)
        box.clear()
        box.send_keys(value)


def test_a_wrong_token_is_refused_in_words(browser):
    with rig_on(browser) as rig:
        sign_in(browser, "guess-guess")
        click(browser, "#take-survey")
        wait(browser, lambda: "token is missing or wrong" in (text(browser, "#answer") or ""))
        assert rig.calls == []


def test_with_name_and_token_a_person_takes_judges_and_acknowledges(browser):
    with rig_on(browser) as rig:
        sign_in(browser, TOKEN)
        click(browser, "#take-survey")
        wait(browser, lambda: "take_survey done" in (text(browser, "#answer") or ""))
        tab(browser, "surveys")
        click(browser, "[data-keep=row-4]")
        browser.find_element(By.CSS_SELECTOR, ".judging input").send_keys("gyro agrees")
        click(browser, "[data-keep=accept]")
        line = 'tr[data-sequence="4"]'
        wait(browser, lambda: "A. Berg" in text(browser, line))
        assert "accepted" in text(browser, line)
        tab(browser, "alarms")
        click(browser, ".alarm button")
        wait(browser, lambda: "seen by A. Berg" in text(browser, "#tab-alarms"))
        assert [name for name, _ in rig.calls] == ["take_survey", "accept_survey", "acknowledge_alarm"]
        assert rig.calls[1][1] == {"sequence": 4, "operator_name": "A. Berg", "reason": "gyro agrees"}


def test_a_depth_typed_in_feet_goes_out_in_metres_with_the_wish_to_replace(browser):
    with rig_on(browser) as rig:
        sign_in(browser, TOKEN)
        click(browser, "#units")
        tab(browser, "surveys")
        click(browser, "[data-keep=row-4]")
        browser.find_element(By.CSS_SELECTOR, "[data-keep=depth]").send_keys("deep")
        click(browser, "[data-keep=accept]")
        wait(browser, lambda: "deep is no number of ft" in text(browser, ".judging"))
        assert rig.calls == []
        box = browser.find_element(By.CSS_SELECTOR, "[data-keep=depth]")
        box.clear()
        box.send_keys("4000")
        click(browser, "[data-keep=replace]")
        click(browser, "[data-keep=accept]")
        wait(browser, lambda: rig.calls)
        click(browser, "#units")
        assert rig.calls[0][1]["replace"] is True
        assert rig.calls[0][1]["measured_depth"] == pytest.approx(1219.2)


def test_the_operator_sets_the_bit_depth_and_asks_for_a_report_and_a_snapshot(browser):
    with rig_on(browser) as rig:
        sign_in(browser, TOKEN)
        browser.find_element(By.ID, "bit-depth").send_keys("1221,5")
        click(browser, "#set-depth")
        wait(browser, lambda: "set_depth done" in text(browser, "#answer"))
        click(browser, "#export")
        wait(browser, lambda: "export done" in text(browser, "#answer"))
        click(browser, "#snapshot-recording")
        wait(browser, lambda: "snapshot_recording done" in text(browser, "#answer"))
        assert rig.calls == [
            ("set_depth", {"bit_depth": 1221.5, "operator_name": "A. Berg"}),
            ("export", {"format": "html"}),
            ("snapshot_recording", {}),
        ]


def steered(rig):
    """A slide between two stretches of rotation, as the rig and the tool report it."""
    sheet, now = SlideSheet(), time.monotonic()
    for k in range(121):
        depth, slide = 870.0 + 0.5 * k, 40 <= k < 80
        sheet.update((1_795_000_000 + k) * 10**9, depth, 0.0 if slide else 12.0, 2.2)
        rig.state.on_log_depth(depth)
        d = wire.DYNAMICS.empty(1)
        d["stick_slip_index"], d["lateral_rms"], d["shocks"] = -1.0 if slide else 0.4, 9.0, k % 3
        rig.state.on_dynamics(d, now)
        rig.live(status=4 if k < 100 else 4 | 1024)
    rig.state.on_steering(sheet.stretches, yields(sheet.stretches, rig.list.definitive()), now)
    rig.push()


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


def test_the_quill_is_a_second_pointer_that_goes_with_its_age(browser):
    with rig_on(browser) as rig:
        rig.state.on_quill(math.radians(57.0), time.monotonic())
        rig.live()
        wait(browser, lambda: "quill 57°" in text(browser, "#dial-legend"))
        shown = "return document.querySelector('.quill').getAttribute('visibility')"
        assert browser.execute_script(shown) == "visible"
        wait(browser, lambda: browser.execute_script(shown) == "hidden")


def test_a_person_without_a_name_is_asked_for_it(browser):
    with rig_on(browser) as rig:
        sign_in(browser, TOKEN, name=" ")
        tab(browser, "alarms")
        click(browser, ".alarm button")
        tab(browser, "controls")
        wait(browser, lambda: "give your name" in text(browser, "#answer"))
        assert rig.calls == []


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


def box(browser, selector):
    script = "const r = document.querySelector(arguments[0]).getBoundingClientRect();"
    return browser.execute_script(f"{script} return [r.x, r.y, r.width, r.height]", selector)


def font_sizes(browser, selector):
    script = "return [...document.querySelectorAll(arguments[0])].map((e) => parseFloat(getComputedStyle(e).fontSize))"
    return browser.execute_script(script, selector)


# Distance of the needle from the centre in widths of the dial, frame by frame until the number has followed.
NEEDLE = """
const [wanted, done] = arguments, seen = [], part = (name) => document.querySelector(name).getBoundingClientRect();
const middle = (r) => [r.x + r.width / 2, r.y + r.height / 2];
const look = () => {
  const [x, y] = middle(part(".needle")), [cx, cy] = middle(part(".bezel"));
  seen.push(Math.hypot(x - cx, y - cy) / part(".bezel").width);
  if (document.querySelector(".dial-number").textContent === wanted && seen.length > 15) done(seen);
  else requestAnimationFrame(look);
};
look();
"""


def test_the_needle_stays_in_its_ring_while_the_tool_turns(browser):
    with rig_on(browser) as rig:
        rig.live()
        wait(browser, lambda: text(browser, ".dial-number") == "127°")
        distances = []
        for degrees in (350.0, 10.0, 100.0, 190.0, 280.0, 5.0):
            rig.live(toolface_deg=degrees, status=int(Status.ROTATING))
            distances += browser.execute_async_script(NEEDLE, f"{degrees:.0f}°")
        assert min(distances) > 0.38
        assert max(distances) < 0.5


def test_in_silence_no_pill_says_what_tool_or_rig_do(browser):
    with rig_on(browser) as rig:
        rig.live(status=int(Status.STILL | Status.NO_MAG))
        wait(browser, lambda: "tool still" in text(browser, "#pills"))
        assert "no usable magnetometer" in text(browser, "#pills")
        wait(browser, lambda: "no estimator" in text(browser, "#pills"))
        assert "tool" not in text(browser, "#pills")
        assert "magnetometer" not in text(browser, "#pills")


def test_the_pumps_are_named_on_or_off_and_not_at_all_where_the_rig_is_silent(browser):
    with rig_on(browser) as rig:
        r = wire.RIG_STATE.empty(1)
        for flow, word in ((0.03, "pumps on"), (0.0, "pumps off")):
            r["flow_rate"], r["valid"] = flow, 128
            rig.state.on_rig_state(r, time.monotonic())
            rig.push()
            wait(browser, lambda word=word: word in text(browser, "#pills"))
        wait(browser, lambda: "pumps" not in text(browser, "#pills"))


def test_a_stuck_magnetometer_leaves_no_bright_total_field(browser):
    with rig_on(browser) as rig:
        m = wire.MAG.empty(1)
        m["magnetic_field"] = 50e-6, 0.0, 0.0

        def field(status):
            rig.live(status=status)
            rig.state.on_magnetic_field(m, time.monotonic())
            rig.push()
            return state_of(browser, "drilling.total_field")

        wait(browser, lambda: field(int(Status.STILL)) == "live")
        wait(browser, lambda: field(int(Status.STILL | Status.NO_MAG)) == "stale")
        assert "no usable magnetometer" in text(browser, '[data-cell="drilling.total_field"]')


def test_a_survey_counts_down_by_itself_and_what_it_waits_for_is_said_with_its_time(browser):
    with rig_on(browser) as rig:
        progress = SurveyProgress(True, "averaging", 7.0, 1.9)
        rig.live()
        rig.state.on_survey_progress(progress, time.monotonic())
        rig.push()
        wait(browser, lambda: "2 s to go" in text(browser, "#progress"))
        deadline = time.monotonic() + 8.0
        while "finishing" not in text(browser, "#progress"):
            assert time.monotonic() < deadline
            rig.live()
        # Samples stopped: the countdown does not pretend.
        wait(browser, lambda: "SURVEY HELD UP" in text(browser, "#progress"))
        rig.live()
        waits = SurveyProgress(True, "averaging on", 12.0, 108.0, waits_for="gyro azimuth sigma 2.1 deg")
        rig.state.on_survey_progress(waits, time.monotonic())
        rig.push()
        wait(browser, lambda: "SURVEY WAITS · 12 s so far, at most 108 s more" in text(browser, "#progress"))
        assert "gyro azimuth sigma 2.1 deg" in text(browser, "#progress")
        deadline = time.monotonic() + 8.0
        while "14 s so far, at most 106 s more" not in text(browser, "#progress"):
            assert time.monotonic() < deadline
            rig.live()
        rig.state.on_survey_progress(SurveyProgress(result="no survey taken: the tool turns"), time.monotonic())
        rig.push()
        wait(browser, lambda: "Last: no survey taken: the tool turns" in text(browser, "#progress"))
        assert "No survey under way" in text(browser, "#progress")


def test_the_worst_alarm_stands_above_all_with_text_remedy_and_age_and_opens_the_list(browser):
    with rig_on(browser) as rig:
        wait(browser, lambda: "for 7" in text(browser, "#alarm"))
        raised = time.time_ns() - 12 * 10**9
        rig.book.raise_alarm("input.attitude", Severity.CRITICAL, "no attitude", "is the estimator alive?", raised)
        rig.publish()
        wait(browser, lambda: "CRITICAL: no attitude" in text(browser, "#alarm"))
        assert "is the estimator alive?" in text(browser, "#alarm")
        assert "for 1" in text(browser, "#alarm")
        assert "+ 1 more" in text(browser, "#alarm")
        click(browser, "#alarm")
        assert browser.find_element(By.ID, "tab-alarms").is_displayed()
        rig.book.acknowledge("input.attitude", "A. Berg", time.time_ns())
        rig.publish()
        # An alarm that nobody has seen comes before one that somebody has.
        wait(browser, lambda: "WARNING: total field is off" in text(browser, "#alarm"))
        for alarm in rig.book.alarms():
            rig.book.acknowledge(alarm.id, "A. Berg", time.time_ns())
            rig.book.clear(alarm.id, time.time_ns())
        rig.publish()
        wait(browser, lambda: text(browser, "#alarm") == "✓ No alarms")


@pytest.mark.parametrize("size", SIZES)
def test_nothing_moves_when_alarms_surveys_faults_and_silence_come_and_go(browser, size):
    places = ("#dial-panel", "#dial svg", "#numbers", "#small", "#quality", "#lights", "#tabs", "#alarm")

    def layout():
        return [box(browser, place) for place in places]

    with rig_on(browser, size) as rig:
        rig.live()
        wait(browser, lambda: state_of(browser, "attitude.inclination") == "live")
        before = layout()
        rig.state.on_survey_progress(SurveyProgress(True, "averaging", 7.0, 9.0, waits_for="gyro"), time.monotonic())
        rig.book.raise_alarm("a", Severity.CRITICAL, 9 * "a long text of an alarm ", 9 * "do this ", 10**18)
        rig.publish()
        rig.live(status=int(Status.ROTATING | Status.NO_MAG | Status.CLIPPED | Status.MAG_DISTURBED))
        wait(browser, lambda: "magnetic disturbance" in text(browser, "#pills"))
        assert layout() == before, "trouble"
        wait(browser, lambda: state_of(browser, "attitude.inclination") == "stale")
        assert layout() == before, "stale"
        rig.server.stop()
        wait(browser, lambda: browser.find_element(By.ID, "banner").is_displayed())
        assert layout() == before, "disconnected"


def test_why_a_direction_is_withheld_stands_beside_its_name(browser):
    with rig_on(browser) as rig:
        a = wire.ATTITUDE.empty(1)
        a["inclination"], a["sigma_inclination"], a["sigma_azimuth"], a["north"] = 0.02, 0.001, -1.0, 3
        a["sigma_gravity_toolface"], a["sigma_magnetic_toolface"] = -1.0, 0.01
        a["status"] = int(Status.NEAR_VERTICAL)
        rig.state.on_attitude(a, time.monotonic())
        rig.push()
        wait(browser, lambda: "not defined this near to vertical" in text(browser, '[data-cell="attitude.azimuth"]'))


def test_a_still_gyro_reads_zero_turns(browser):
    with rig_on(browser) as rig:
        g = wire.GRAVITY.empty(1)
        for speed, shown in ((0.12, "0r/min"), (-0.12, "0r/min"), (1.0, "10r/min")):
            g["sigma"], g["rotary_speed"] = 0.001, speed
            rig.live()
            rig.state.on_gravity(g, time.monotonic())
            rig.push()
            wait(browser, lambda shown=shown: shown in text(browser, '[data-cell="drilling.rotary_speed"]'))


def test_the_datum_names_what_is_not_given_and_where_the_sensor_sits(browser):
    with rig_on(browser) as rig:
        well = dataclasses.replace(rig.list.well, sensor_to_bit=14.25)
        rig.state.on_well(well, time.monotonic(), ReferenceField(declination=0.02, source="typed in"))
        rig.push()
        wait(browser, lambda: "sensor 14.25 m above bit" in text(browser, "#datum"))
        assert "conv. not given" in text(browser, "#datum")
        assert "total correction not given" in text(browser, "#datum")
        rig.state.on_vertical_limit(math.radians(3.0))
        rig.live()
        wait(browser, lambda: "MTF below 3° inclination" in text(browser, "#dial-legend"))


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


def test_how_far_off_plan_the_well_is_and_how_to_come_back_stand_on_the_first_screen(browser):
    with rig_on(browser) as rig:
        offset = Offset(0.4, 1200.0, -0.12, 0.38, 0.3, 0.1, math.radians(72.0))
        rig.state.on_offset(offset, time.monotonic(), math.radians(2.6) / 30.0)
        rig.push()
        wait(browser, lambda: "0.12 m below, 0.38 m right" in text(browser, "#offset"))
        assert "72° GTF" in text(browser, "#offset")
        assert "2.60°/30 m" in text(browser, "#offset")


def test_the_system_tab_gives_rate_age_and_losses_of_each_stream(browser):
    with rig_on(browser) as rig:
        rig.state.on_stream("sonde", 300, time.monotonic() - 2.0)
        rig.state.on_stream("sonde", 100, time.monotonic(), lost=7)
        rig.push()
        tab(browser, "system")
        rows = "return [...document.querySelectorAll('#tab-system tbody tr')].map((r) => r.innerText)"
        wait(browser, lambda: any("7" in row and "Sonde" in row for row in browser.execute_script(rows)))
        (sonde,) = [row for row in browser.execute_script(rows) if "Sonde" in row]
        assert re.search(r"Sonde\s+\S*\s*(live|STALE)\s+.*s\s+\d+(\.\d)?/s\s+7", sonde), sonde


@pytest.mark.parametrize("size", [*SIZES, (1280, 800)])
def test_the_facts_of_the_well_are_never_cut_off(browser, size):
    with rig_on(browser, size) as rig:
        rig.live(status=int(Status.ROTATING | Status.NO_MAG | Status.SENSOR_FAULT | Status.CLIPPED))
        wait(browser, lambda: "no usable magnetometer" in text(browser, "#pills"))
        fits = "const d = document.querySelector('#datum');"
        fits += " return [d.scrollHeight - d.clientHeight, d.scrollWidth - d.clientWidth]"
        assert max(browser.execute_script(fits)) <= 1


def test_the_azimuth_has_a_strip_over_time_and_over_depth(browser):
    with rig_on(browser) as rig:
        steered(rig)
        tab(browser, "charts")
        wait(browser, lambda: "Azimuth" in text(browser, ".charts"))
        click(browser, "#tab-charts .choice")
        wait(browser, lambda: "Azimuth, °" in text(browser, ".depth-box"))


@pytest.mark.parametrize("size", [*SIZES, (1280, 800), (844, 390)])
def test_the_dial_alone_is_read_at_three_metres_and_touched_with_gloves(browser, size):
    with rig_on(browser, size, path="?view=toolface") as rig:
        rig.state.on_advisory(math.radians(120.0), math.radians(15.0))
        rig.live()
        wait(browser, lambda: text(browser, ".far-number") == "127°")
        wait(browser, lambda: "INSIDE" in text(browser, ".far-note"))
        (high,) = font_sizes(browser, ".far-number")
        # On a phone held upright the width is what limits.
        assert high >= (0.2 * size[1] if size[0] > size[1] else 0.3 * size[0])
        left, top, wide, tall = box(browser, "#dial svg")
        assert min(wide, tall) > 0.25 * min(size)
        assert left >= 0
        assert top >= 0
        assert top + tall <= size[1]
        left, _, wide, _ = box(browser, ".far-number")
        assert left + wide <= size[0]
        touched = [box(browser, s)[2:] for s in ("#units", "#theme", "#view")]
        assert all(width >= 60 and height >= 60 for width, height in touched)
        assert not browser.find_element(By.ID, "tabs").is_displayed()
        if size == (1920, 1080):
            shown = "#big .name, #big .under, #dial-legend span, #datum, .alarm-what, .alarm-age, .far-note"
            assert min(font_sizes(browser, shown)) >= 18


def test_a_button_fills_the_screen_with_the_dial_and_the_address_keeps_it(browser):
    with rig_on(browser) as rig:
        click(browser, "#view")
        wait(browser, lambda: "view=toolface" in browser.current_url)
        show(browser, rig, path="?view=toolface")
        assert not browser.find_element(By.ID, "tabs").is_displayed()
        click(browser, "#view")
        assert browser.find_element(By.ID, "tabs").is_displayed()
        assert "view=" not in browser.current_url


def test_a_phone_on_its_side_shows_the_whole_dial_and_both_directions(browser):
    with rig_on(browser, (844, 390)) as rig:
        rig.live()
        wait(browser, lambda: text(browser, ".dial-number") == "127°")
        for selector in ("#dial svg", '[data-cell="attitude.inclination"]', '[data-cell="attitude.azimuth"]', "#alarm"):
            left, top, wide, tall = box(browser, selector)
            assert top >= 0, selector
            assert top + tall <= 390, selector
            assert left + wide <= 844, selector


@pytest.mark.parametrize("size", SIZES)
def test_nothing_is_wider_than_the_screen(browser, size):
    with rig_on(browser, size) as rig:
        rig.live()
        for name in ("surveys", "path", "charts", "steering", "alarms", "system", "controls"):
            if browser.find_elements(By.ID, f"select-{name}"):
                tab(browser, name)
            width, inner = browser.execute_script("return [document.documentElement.scrollWidth, window.innerWidth]")
            assert width <= inner, name
        if size[0] >= 1024:
            height, inner = browser.execute_script("return [document.documentElement.scrollHeight, innerHeight]")
            assert height <= inner
        table = "const t = document.querySelector('#tab-surveys'); return [t.scrollWidth, t.clientWidth]"
        if browser.find_elements(By.ID, "select-surveys"):
            tab(browser, "surveys")
        wide, room = browser.execute_script(table)
        assert wide <= room


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


@pytest.mark.parametrize(("theme", "size"), [("night", SIZES[0]), ("day", SIZES[1]), ("day", SIZES[2])])
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
        browser.get_log("browser")
        show(browser, rig)
        rig.live()
        wait(browser, lambda: text(browser, ".dial-number") == "127°")
        for name in ("path", "charts", "steering", "alarms", "system", "controls", "surveys"):
            tab(browser, name)
        assert [m for m in browser.get_log("browser") if m["level"] in ("SEVERE", "WARNING")] == []
        names = browser.execute_script(
            "return JSON.stringify(performance.getEntriesByType('resource').map((e) => e.name))"
        )
        assert all(name.startswith(rig.server.address) for name in json.loads(names))
