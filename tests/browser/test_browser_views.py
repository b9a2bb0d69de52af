# SPDX-License-Identifier: Apache-2.0
"""Views of the page: one tab that fills it, the large chart, the clock, and how alarms look and sound."""

import time

import pytest

from browser_page import TOKEN, By, Keys, Rig, box, click, resize, rig_on, show, sign_in, tab, text, wait
from mwd_surface.live.alarms import Severity
from mwd_surface.page.page_server import PageServer
from mwd_surface.page.settings import PageSettings

pytestmark = pytest.mark.slow(2)

TABS = ("surveys", "path", "charts", "steering", "link", "alarms", "system", "controls")
SIZES = ((3840, 2160), (1920, 1080), (1280, 800), (1024, 768), (390, 844))


def view_of(browser):
    return browser.execute_script("return document.body.dataset.view")


# In the gate a small screen and a phone; lists that fill the largest screen are tested below.
@pytest.mark.parametrize("size", [*(pytest.param(size, marks=pytest.mark.nightly) for size in SIZES[:3]), *SIZES[3:]])
def test_every_tab_fills_the_page_by_its_address(browser, size):
    with rig_on(browser, size) as rig:
        for name in TABS:
            show(browser, rig, size, path=f"?view={name}")
            wait(browser, lambda name=name: browser.find_element(By.ID, f"tab-{name}").is_displayed())
            _, _, wide, tall = box(browser, f"#tab-{name}")
            assert wide > 0.9 * size[0], name
            assert tall > (0.6 if size[0] > size[1] else 0.5) * size[1], name
            assert not browser.find_element(By.ID, "dial-panel").is_displayed()
            width, inner = browser.execute_script("return [document.documentElement.scrollWidth, innerWidth]")
            assert width <= inner, name


LINE_HEIGHT = """const range = document.createRange();
range.selectNodeContents(document.querySelector(arguments[0]));
return range.getBoundingClientRect().height;"""


@pytest.mark.parametrize("size", [SIZES[0], pytest.param(SIZES[1], marks=pytest.mark.nightly)])
def test_lists_that_fill_a_large_screen_have_larger_letters(browser, size):
    """Letters of the same cell beside the other panels, and on the whole page without a sideways scroll."""
    with rig_on(browser, size) as rig:
        for name, cell in (("surveys", ".surveys tbody td"), ("alarms", ".alarms strong")):
            show(browser, rig, size)
            if name != "surveys":
                tab(browser, name)
            beside = browser.execute_script(LINE_HEIGHT, f"#tab-{name} {cell}")
            show(browser, rig, size, path=f"?view={name}")
            filled = browser.execute_script(LINE_HEIGHT, f"#tab-{name} {cell}")
            assert filled > 1.2 * beside, name
            wide, inner = browser.execute_script(
                "const t = document.getElementById(arguments[0]); return [t.scrollWidth, t.clientWidth]", f"tab-{name}"
            )
            assert wide <= inner, name


def test_button_key_and_the_browser_s_back_button_lead_into_a_full_tab_and_out(browser):
    with rig_on(browser):
        tab(browser, "path")
        click(browser, "#fill")
        assert "view=path" in browser.current_url
        tab(browser, "charts")
        assert "view=charts" in browser.current_url
        browser.back()
        wait(browser, lambda: view_of(browser) == "all")
        body = browser.find_element(By.TAG_NAME, "body")
        body.send_keys("f")
        wait(browser, lambda: "view=charts" in browser.current_url)
        body.send_keys(Keys.ESCAPE)
        wait(browser, lambda: view_of(browser) == "all")
        assert browser.find_element(By.ID, "dial-panel").is_displayed()
        # A letter typed into a text field does not act as a shortcut key.
        tab(browser, "controls")
        browser.find_element(By.ID, "operator-name").send_keys("fd")
        assert view_of(browser) == "all"


def test_sizes_grow_with_the_screen(browser):
    with rig_on(browser) as rig:
        numbers = []
        for size in ((1920, 1080), (2560, 1440), (3840, 2160)):
            show(browser, rig, size)
            numbers.append(box(browser, '[data-cell="rig.bit_depth"] .number')[3])
        assert numbers[2] == pytest.approx(2.0 * numbers[0], rel=0.05)
        assert numbers[0] < numbers[1] < numbers[2]


def history(rig, seconds=8):
    """Let a few seconds of attitude and rig data come."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rig.live()
        time.sleep(0.2)


def test_the_large_chart_shows_chosen_signals_values_at_the_cursor_and_zooms(browser):
    with rig_on(browser, (1280, 800), path="?view=charts") as rig:
        browser.execute_script("localStorage.removeItem('signals')")
        show(browser, rig, (1280, 800), path="?view=charts")
        history(rig)
        wait(browser, lambda: "44.62" in text(browser, ".chart-stack"))
        titles = "return [...document.querySelectorAll('.chart-stack .name')].map((e) => e.textContent)"
        assert len(browser.execute_script(titles)) == 4
        chosen = browser.find_element(By.XPATH, "//div[@class='signal-choices']/button[.='Bit depth']")
        chosen.click()
        assert browser.execute_script(titles)[-1] == "Bit depth, m"
        stack = browser.find_element(By.CSS_SELECTOR, ".chart-stack")
        stack.send_keys(Keys.ARROW_LEFT)
        wait(browser, lambda: "−" in text(browser, ".chart-moment"))
        axis = (
            "return [...document.querySelectorAll('.chart-ranges .choice')].map((b) => b.getAttribute('aria-pressed'))"
        )
        assert browser.execute_script(axis)[0] == "true"
        stack.send_keys("+")
        whole = browser.find_element(By.XPATH, "//button[.='Whole range']")
        wait(browser, whole.is_displayed)
        whole.click()
        browser.find_element(By.XPATH, "//button[.='24 h']").click()
        assert browser.execute_script(axis)[3] == "true"
        assert [m for m in browser.get_log("browser") if m["level"] == "SEVERE"] == []


def strip(browser):
    return browser.execute_script("return {...document.getElementById('alarm').dataset}")


def test_an_alarm_has_another_look_in_each_state_and_active_ones_come_first(browser):
    with rig_on(browser) as rig:
        tab(browser, "alarms")
        wait(browser, lambda: strip(browser)["state"] == "unacknowledged")
        rig.alarm_log.raise_alarm("sonde", Severity.CRITICAL, "no sonde", "check")
        rig.publish()
        wait(browser, lambda: strip(browser) == {"severity": "critical", "state": "unacknowledged"})
        rig.alarm_log.clear_alarm("sonde")
        rig.publish()
        # The critical alarm has ended unacknowledged: it is still listed, after the active warning.
        states = "return [...document.querySelectorAll('#tab-alarms .alarm')].map((e) => e.dataset.state)"
        wait(browser, lambda: browser.execute_script(states) == ["unacknowledged", "returned"])
        rig.alarm_log.acknowledge("mag.field", "A. Berg")
        rig.publish()
        wait(browser, lambda: browser.execute_script(states) == ["acknowledged", "returned"])
        rig.alarm_log.clear_alarm("mag.field")
        rig.publish()
        # No alarm is active: the strip loses the colour of an alarm and names the alarms that wait to be acknowledged.
        wait(browser, lambda: strip(browser) == {"severity": "none", "state": "returned"})
        assert "no sonde" in text(browser, ".alarm-remedy")
        rig.alarm_log.acknowledge("", "A. Berg")
        rig.publish()
        wait(browser, lambda: text(browser, ".alarm-what") == "✓ No alarms")


def test_the_sound_repeats_until_the_alarm_is_acknowledged_or_silenced_here(browser):
    with rig_on(browser) as rig:
        browser.execute_script("""
          window.tones = 0;
          const real = AudioContext.prototype.createOscillator;
          AudioContext.prototype.createOscillator = function () { window.tones += 1; return real.call(this); };
        """)
        tones = lambda: browser.execute_script("return window.tones")  # noqa: E731
        click(browser, "#sound")
        assert text(browser, "#sound") == "Silence"
        wait(browser, lambda: tones() >= 2)
        click(browser, "#sound")
        assert text(browser, "#sound") == "Turn sound off"
        before = tones()
        rig.alarm_log.raise_alarm("sonde", Severity.CRITICAL, "no sonde", "check")
        rig.publish()
        # A silenced alarm stays silent; a new alarm sounds.
        wait(browser, lambda: tones() > before)
        rig.alarm_log.acknowledge("sonde", "A. Berg")
        rig.publish()
        wait(browser, lambda: text(browser, "#sound") == "Turn sound off")


def test_an_export_is_downloaded_and_listed(browser, tmp_path):
    rig = Rig()

    def command(name, arguments):
        (tmp_path / "exports").mkdir(exist_ok=True)
        (tmp_path / "exports" / "list.csv").write_text("md_m\n")
        return True, f"{name} {arguments['format']}"

    rig.server = PageServer(PageSettings(port=0), command, token=TOKEN, exports=tmp_path / "exports")
    rig.fill()
    rig.server.start()
    try:
        taken = {"behavior": "allow", "downloadPath": str(tmp_path / "taken")}
        browser.execute_cdp_cmd("Page.setDownloadBehavior", taken)
        show(browser, rig)
        sign_in(browser, TOKEN)
        click(browser, "#export")
        wait(browser, lambda: "list.csv" in (text(browser, ".exported") or ""))
        wait(browser, (tmp_path / "taken" / "list.csv").exists)
        assert (tmp_path / "taken" / "list.csv").read_text() == "md_m\n"
    finally:
        rig.server.stop()


def test_over_a_telemetry_link_the_first_screen_and_the_charts_show_the_rig_s_values(browser):
    with rig_on(browser, (1280, 800)) as rig:
        shown = lambda cell: browser.find_element(By.CSS_SELECTOR, f'#small [data-cell="{cell}"]').is_displayed()  # noqa: E731
        wait(browser, lambda: shown("drilling.vibration"))
        rig.state.show(time.monotonic(), over_link=True)
        rig.publish()
        wait(browser, lambda: shown("rig.pressure"))
        assert not shown("drilling.vibration")
        rig.live()
        tab(browser, "charts")
        wait(browser, lambda: "Standpipe pressure" in text(browser, ".charts"))


def test_the_clock_shows_utc_and_the_time_at_the_rig(browser):
    with rig_on(browser) as rig:
        rig.publish(time_zone="Asia/Shanghai")
        wait(browser, lambda: "Shanghai" in text(browser, "#clock"))
        utc, there = (part.split()[0] for part in text(browser, "#clock").split(" · "))
        assert abs(int(there[:2]) - int(utc[:2])) % 24 in (8, 16)
        assert utc[3:] == there[3:]


@pytest.mark.parametrize("path", ["", "?view=charts"])
def test_the_type_of_charts_follows_a_window_that_changes_its_size(browser, path):
    room = """const plot = [...document.querySelectorAll('.u-over')].find((one) => one.offsetWidth);
    const type = parseFloat(getComputedStyle(document.documentElement).fontSize);
    return plot ? parseFloat(plot.style.left) / type : null;"""
    with rig_on(browser, (1280, 800), path=path) as rig:
        history(rig, 3)
        tab(browser, "charts")
        wait(browser, lambda: browser.execute_script(room) is not None)
        before = browser.execute_script(room)
        resize(browser, (3840, 2160))
        wait(browser, lambda: abs(browser.execute_script(room) - before) < 0.1)
