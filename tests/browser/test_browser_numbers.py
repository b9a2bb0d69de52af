# SPDX-License-Identifier: Apache-2.0
"""The numbers of the first screen: unit, sigma, age, what is missing and why."""

import dataclasses
import math
import time

import numpy as np
import pytest

from browser_page import SIZES, click, in_each_size, rig_on, show, state_of, text, wait
from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_sensors.core.angle_convention import AngleConvention
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.well_state import ReferenceFieldState
from mwd_surface.trajectory.plan import Offset

pytestmark = pytest.mark.slow(0.8)


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


def test_the_page_converts_the_vertical_angle_as_the_program_does(browser):
    inclinations = [0.0, 0.7788, math.pi / 2, 1.66, math.pi]
    with rig_on(browser):
        for convention in AngleConvention:
            said = browser.execute_async_script(
                "const [angles, name, done] = arguments; import('./units.js').then((u) => { u.setConvention(name);"
                "done(angles.map((v) => [u.plain('inclination', v), Number(u.size('inclination', v))])) })",
                inclinations,
                convention.value,
            )
            shown = np.degrees([convention.shown(angle) for angle in inclinations])
            np.testing.assert_allclose([value for value, _ in said], shown, atol=1e-9)
            # A sigma has no direction.
            np.testing.assert_allclose([size for _, size in said], np.degrees(inclinations), atol=0.006)


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


def test_the_pumps_are_named_on_or_off_and_not_at_all_where_the_rig_is_silent(browser):
    with rig_on(browser, settings=LiveSettings()) as rig:
        r = wire.RIG_STATE.empty(1)

        def pills():
            rig.state.on_rig_state(r, time.monotonic())
            rig.push()
            return text(browser, "#pills")

        for flow, word in ((0.03, "pumps on"), (0.0, "pumps off")):
            r["flow_rate"], r["valid"] = flow, 128
            wait(browser, lambda word=word: word in pills())
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
        assert "no magnetometer" in text(browser, '[data-cell="drilling.total_field"]')


def test_why_a_direction_is_withheld_stands_beside_its_name(browser):
    with rig_on(browser) as rig:
        a = wire.ATTITUDE.empty(1)
        a["inclination"], a["sigma_inclination"], a["sigma_azimuth"], a["north"] = 0.02, 0.001, np.nan, 3
        a["sigma_gravity_toolface"], a["sigma_magnetic_toolface"] = np.nan, 0.01
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
        field = ReferenceFieldState(declination=0.02, source="typed in")
        rig.state.show(time.monotonic(), well=well, reference_given=field)
        rig.push()
        wait(browser, lambda: "sensor 14.25 m above bit" in text(browser, "#datum"))
        assert "conv. not given" in text(browser, "#datum")
        assert "total correction not given" in text(browser, "#datum")
        rig.state.on_vertical_limit(math.radians(3.0))
        rig.live()
        wait(browser, lambda: "MTF below 3° inclination" in text(browser, "#dial-legend"))


def test_how_far_off_plan_the_well_is_and_how_to_come_back_stand_on_the_first_screen(browser):
    with rig_on(browser) as rig:
        offset = Offset(0.4, 1200.0, -0.12, 0.38, 0.3, 0.1, math.radians(72.0), math.radians(2.6) / 30.0)
        rig.state.show(time.monotonic(), offset=offset)
        rig.push()
        wait(browser, lambda: "0.12 m below, 0.38 m right" in text(browser, "#offset"))
        assert "72° GTF" in text(browser, "#offset")
        assert "2.60°/30 m" in text(browser, "#offset")


def test_what_stands_in_the_upper_panels_ends_inside_them(browser):
    with rig_on(browser) as rig:
        offset = Offset(12.4, 1200.0, -10.12, 11.38, 0.3, 0.1, math.radians(72.0), math.radians(2.6) / 30.0)
        rig.live()
        rig.state.show(time.monotonic(), offset=offset)
        rig.push()
        wait(browser, lambda: "10.12 m below, 11.38 m right" in text(browser, "#offset"))
        beyond = "const end = e => e.getBoundingClientRect().right;"
        beyond += " return ['numbers', 'quality'].flatMap(id => { const panel = document.getElementById(id);"
        beyond += " return [...panel.querySelectorAll('dd, .unit, .name, .each')].filter(e => e.offsetParent)"
        beyond += ".map(e => end(e) - end(panel)); })"
        for size in in_each_size(browser, [*SIZES, (1280, 800), (1600, 860), (1820, 910)]):
            assert max(browser.execute_script(beyond)) <= 0.0, size


def test_the_facts_of_the_well_are_never_cut_off(browser):
    with rig_on(browser) as rig:
        rig.live(status=int(Status.ROTATING | Status.NO_MAG | Status.SENSOR_FAULT | Status.CLIPPED))
        wait(browser, lambda: "no magnetometer" in text(browser, "#pills"))
        fits = "const d = document.querySelector('#datum');"
        fits += " return [d.scrollHeight - d.clientHeight, d.scrollWidth - d.clientWidth]"
        for size in in_each_size(browser, [*SIZES, (1280, 800)]):
            assert max(browser.execute_script(fits)) <= 1, size
