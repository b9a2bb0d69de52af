# SPDX-License-Identifier: Apache-2.0
"""What the page does when tool, surface unit, clock or network fail."""

import re

import pytest

from browser_page import TOKEN, By, rig_on, show, state_of, text, wait
from mwd_estimation.core.status import Status
from mwd_surface.live.settings import LiveSettings
from mwd_surface.page.page_server import PageServer
from mwd_surface.page.settings import PageSettings

pytestmark = pytest.mark.slow(2)


def test_a_tool_that_falls_silent_is_stale_while_the_link_lives(browser):
    with rig_on(browser, settings=LiveSettings()) as rig:
        rig.live()
        wait(browser, lambda: state_of(browser, "attitude.inclination") == "live")
        wait(browser, lambda: state_of(browser, "attitude.inclination") == "stale")
        wait(browser, lambda: "STALE" in text(browser, ".dial-note"))
        assert "STALE" in text(browser, '[data-cell="attitude.inclination"]')
        assert browser.find_element(By.ID, "banner").is_displayed() is False
        wait(browser, lambda: "no sonde" in text(browser, "#pills"))
        rig.live()
        wait(browser, lambda: state_of(browser, "attitude.inclination") == "live")


def test_a_surface_unit_that_goes_is_shown_and_found_again(browser):
    with rig_on(browser) as rig:
        rig.live()
        rig.server.stop()
        wait(browser, lambda: browser.find_element(By.ID, "banner").is_displayed())
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
            # The age stands there once it is more than usual: seconds, and no hours.
            wait(browser, lambda: re.search(r"σ\d\d? s$", text(browser, '[data-cell="attitude.inclination"]')))
        finally:
            browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)


@pytest.mark.fault_case(95)
@pytest.mark.parametrize(
    "constructor",
    ["setTimeout(() => this.onclose?.(), 10);", "throw new Error('forbidden');", "/* a proxy that never answers */"],
)
def test_where_no_websocket_gets_through_the_page_polls(browser, constructor):
    with rig_on(browser) as rig:
        source = f"window.WebSocket = class {{ constructor() {{ {constructor} }} close() {{}} }};"
        script = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": source})
        try:
            show(browser, rig)
            rig.live(toolface_deg=77.0)
            wait(browser, lambda: text(browser, ".dial-number") == "77°")
            assert not browser.find_element(By.ID, "banner").is_displayed()
        finally:
            browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)


def test_in_silence_no_pill_says_what_tool_or_rig_do(browser):
    with rig_on(browser, settings=LiveSettings()) as rig:

        def shows(*words):
            rig.live(status=int(Status.STILL | Status.NO_MAG))
            pills = text(browser, "#pills")
            return all(one in pills for one in words)

        wait(browser, lambda: shows("tool still", "no magnetometer"))
        wait(browser, lambda: "no estimator" in text(browser, "#pills"))
        assert "tool" not in text(browser, "#pills")
        assert "magnetometer" not in text(browser, "#pills")


def test_a_connection_that_falls_silent_without_closing_is_opened_again(browser):
    # The other end is gone without a word, as behind a switch that lost power: nothing comes, and nothing closes.
    source = """
      const Real = window.WebSocket;
      window.sockets = [];
      window.WebSocket = class extends Real {
        constructor(address) { super(address); window.sockets.push(this); }
        set onmessage(handler) { super.onmessage = (event) => { if (!this.deaf) handler?.(event); }; }
      };
    """
    with rig_on(browser) as rig:
        script = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": source})
        try:
            show(browser, rig)
            browser.execute_script("window.sockets[0].deaf = true")
            wait(browser, lambda: browser.find_element(By.ID, "banner").is_displayed())
            rig.live(toolface_deg=211.0)
            wait(browser, lambda: text(browser, ".dial-number") == "211°", 12.0)
            assert browser.execute_script("return window.sockets.length") == 2
        finally:
            browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)
