# SPDX-License-Identifier: Apache-2.0
"""Logs over depth: gaps of the whole hole are named, held sectors are faded, gaps are empty, doubt is marked."""

import dataclasses
import math
import time

import pytest

from browser_page import rig_on, tab, text, wait
from mwd_sensors.telemetry.log_channels import FROM_WORD, SATURATED, LogSample
from mwd_surface.logs.depth_log import FIRST, DepthLog

pytestmark = pytest.mark.slow(0.1)
S = 10**9
T0 = 10**18


def word(at_s, sector=None, **more):
    """A word of gamma, or of one of four sectors."""
    seen = [k == sector for k in range(4)]
    value = LogSample(T0 + at_s * S, "gamma", "gAPI", 10.0, 10.0, 80.0, 5.0, sensor_to_bit=10.0, quality=FROM_WORD)
    of_sector = {
        "value": 80.0 if sector is None else math.nan,
        "sectors": tuple(80.0 + 5.0 * k if one else math.nan for k, one in enumerate(seen)),
        "sigma_sectors": (5.0,) * 4,
        "sector_durations": tuple(2.5 if one else 0.0 for one in seen),
    }
    return dataclasses.replace(value, **{**of_sector, **more})


def test_the_logs_name_their_gaps_fade_what_is_held_and_mark_what_is_doubtful(browser):
    """One metre in 100 s; each sector has a word each 40 s, and none between 1000 and 2000 s."""
    log = DepthLog()
    for at in range(3001):
        log.add_depth(T0 + at * S, 1000.0 + 0.01 * at)
    times = [at for at in range(5, 3000, 10) if not 1000 < at < 2000]
    log.add(word(at, sector=at // 10 % 4) for at in times)
    log.add(word(at, quality=FROM_WORD | (SATURATED if at > 2900 else 0)) for at in times)
    with rig_on(browser) as rig:
        rig.state.show(time.monotonic(), logs=log.curves(FIRST, 150), newest_logs=log.newest())
        rig.push()
        tab(browser, "logs")
        wait(browser, lambda: "1000.0" in (text(browser, "#log-gaps") or ""))
        count = "return document.querySelectorAll('#tab-logs ' + arguments[0]).length"
        # Each word fills the step of 0.1 m of its interval; three steps between are held, those of the gap are empty.
        fresh, held = (browser.execute_script(count, f"rect[fill]{part}") for part in (":not(.log-held)", ".log-held"))
        assert fresh > 90
        assert 2.0 * fresh < held < 3.2 * fresh
        assert browser.execute_script(count, ".log-doubt") == pytest.approx(10, abs=1)
        assert "saturated" in text(browser, "#tab-logs .log-doubt title")
