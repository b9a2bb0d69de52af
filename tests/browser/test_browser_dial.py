# SPDX-License-Identifier: Apache-2.0
"""The dial, also alone on the screen."""

import math
import time

import pytest

from browser_page import By, box, click, font_sizes, in_each_size, rig_on, show, text, wait
from mwd_estimation.core.status import Status
from mwd_surface.trajectory.advice import Advice, AdviceMode

pytestmark = pytest.mark.slow(0.8)


def test_the_dial_follows_the_message(browser):
    with rig_on(browser) as rig:
        for k in range(7):
            wanted = 10 + 20 * k
            rig.live(toolface_deg=wanted)
            wait(browser, lambda wanted=wanted: text(browser, ".dial-number") == f"{wanted}°")


def test_a_wanted_toolface_is_a_sector_with_a_word_for_inside_and_outside(browser):
    with rig_on(browser) as rig:
        rig.state.show(time.monotonic(), advice=Advice(AdviceMode.SLIDE, math.radians(120.0), limit=math.radians(15.0)))
        rig.live(toolface_deg=127.0)
        wait(browser, lambda: "INSIDE" in text(browser, ".dial-note"))
        assert "wanted 120° ± 15°" in text(browser, "#dial-legend")
        rig.live(toolface_deg=160.0)
        wait(browser, lambda: "OUTSIDE" in text(browser, ".dial-note"))
        rig.live(toolface_deg=160.0, status=4)
        wait(browser, lambda: text(browser, ".dial-note") == "ROTATING")
        rig.live(toolface_deg=160.0, status=int(Status.TOOLFACE_UNSETTLED))
        wait(browser, lambda: text(browser, ".dial-note") == "MAY TURN")


def test_the_needle_leaves_the_words_of_the_dial_readable(browser):
    covered = """
      const needle = document.querySelector(".needle").getBoundingClientRect();
      const word = [...document.querySelectorAll(".cardinal")].find((t) => t.textContent === arguments[0])
        .getBoundingClientRect();
      const dy = Math.min(needle.bottom, word.bottom) - Math.max(needle.top, word.top);
      const dx = Math.min(needle.right, word.right) - Math.max(needle.left, word.left);
      return dx > 0 && dy > 0 ? Math.min(dx / word.width, dy / word.height) : 0;
    """
    with rig_on(browser) as rig:
        for degrees, word in ((0.0, "HIGH"), (90.0, "90 R"), (180.0, "LOW"), (270.0, "90 L")):
            rig.live(toolface_deg=degrees)
            wait(browser, lambda degrees=degrees: text(browser, ".dial-number") == f"{degrees:.0f}°")
            # Boxes: between its two points the needle leaves room.
            assert browser.execute_script(covered, word) < 0.4, word


def test_near_vertical_the_dial_turns_north_up(browser):
    with rig_on(browser) as rig:
        rig.live(inclination_deg=2.0, status=65536 | int(Status.NEAR_VERTICAL))
        wait(browser, lambda: text(browser, ".dial-number") == "33°")
        assert "MTF · grid north up" in text(browser, "#dial-legend")
        script = "return [...document.querySelectorAll('.cardinal')].map((t) => t.textContent).join(' ')"
        assert browser.execute_script(script) == "N E S W"


def test_the_quill_is_a_second_pointer_that_goes_with_its_age(browser):
    with rig_on(browser) as rig:
        shown = "return document.querySelector('.quill').getAttribute('visibility')"

        def is_shown():
            rig.state.show(time.monotonic(), quill=math.radians(57.0))
            rig.live()
            return browser.execute_script(shown) == "visible" and "quill 57°" in text(browser, "#dial-legend")

        wait(browser, is_shown)
        wait(browser, lambda: browser.execute_script(shown) == "hidden")


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


def test_the_dial_alone_is_read_at_three_metres_and_touched_with_gloves(browser):
    with rig_on(browser, path="?view=toolface") as rig:
        rig.state.show(time.monotonic(), advice=Advice(AdviceMode.SLIDE, math.radians(120.0), limit=math.radians(15.0)))
        rig.live()
        for size in in_each_size(browser):
            # On a phone held upright the dial with its own numbers takes the width; elsewhere they stand beside it.
            upright = size[0] < size[1]
            number, note = (".dial-number", ".dial-note") if upright else (".far-number", ".far-note")
            wait(browser, lambda number=number: text(browser, number) == "127°")
            wait(browser, lambda note=note: text(browser, note) == "INSIDE")
            high = box(browser, number)[3]
            assert high >= (0.12 * size[0] if upright else 0.2 * size[1]), size
            left, top, wide, tall = box(browser, "#dial svg")
            assert min(wide, tall) > (0.9 if upright else 0.25) * min(size), size
            assert left >= 0, size
            assert top >= 0, size
            assert top + tall <= size[1], size
            left, _, wide, _ = box(browser, number)
            assert left + wide <= size[0], size
            touched = [box(browser, s)[2:] for s in ("#units", "#theme", "#view")]
            assert all(width >= 60 and height >= 60 for width, height in touched), size
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
