# SPDX-License-Identifier: Apache-2.0
"""The page of a surface unit without a node in a real browser: what its tests share."""

import contextlib
import dataclasses
import math
import time

import numpy as np
from selenium.common.exceptions import StaleElementReferenceException as StaleElementReferenceException
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys as Keys
from selenium.webdriver.support.ui import WebDriverWait

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core import wire
from mwd_surface.bags.recorder.status import RecorderState, RecorderStatus
from mwd_surface.clearance.clearance import Clearance, ClearanceRule
from mwd_surface.live.alarms import AlarmLog, Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.well_state import AlarmState, DiagnosticLevel, NodeDiagnostic, ReferenceFieldState
from mwd_surface.page.page_server import PageServer
from mwd_surface.page.settings import PageSettings
from mwd_surface.page.state_json import StateJson
from mwd_surface.surveys.leg import Leg, TieOn
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import plan_of
from mwd_surface.trajectory.slide_sheet import SlideSheet, yields

TOKEN = "drill-baby-drill"  # noqa: S105


EVIL = "<img src=x onerror=document.title='owned'>"


SIZES = ((1024, 768), (1920, 1080), (390, 844))
ALL_SIZES = (*SIZES, (1280, 800), (844, 390))


# What a test has shown stays live for as long as a slow machine needs to look; tests of silence take LiveSettings().
PATIENT = LiveSettings(
    **{field.name: 30.0 for field in dataclasses.fields(LiveSettings) if field.name.endswith("_period")}
)


RECORDING = RecorderStatus(RecorderState.RECORDING, path="bags/a", messages=7, duration=61.0)


def near(name, least):
    """An offset well that is nearest at 1250 m."""
    md = np.array([1200.0, 1250.0, 1300.0])
    distance, allowed, away = least + np.abs(md - 1250.0), np.full(3, 10.0), np.full(3, 0.5)
    return Clearance(name, md, md, distance, allowed, distance / allowed, away, away, ClearanceRule())


class Rig:
    """A surface unit without a node: state, alarms, surveys and the page's server."""

    def __init__(self, token=TOKEN, settings=PATIENT):
        self.state, self.tables = LiveState(settings), StateJson()
        self.alarm_log, self.calls = AlarmLog(lambda: time.time_ns() - self.alarm_age_ns), []
        self.alarm_age_ns = 0
        well = Well(name="Nordlys 7 H", depth_datum="RKB", north_reference="grid", section_azimuth_deg=60.0)
        self.list = SurveyList(well=well, legs=(Leg(tie_on=TieOn.given(0.0, 0.0, 0.0)),))
        self.server = PageServer(PageSettings(port=0), self.command, token=token)

    def command(self, name, arguments):
        self.calls.append((name, arguments))
        if name == "accept_survey":
            self.list = self.list.accept(arguments["sequence"], arguments["operator_name"], arguments["reason"], 9)
            self.publish()
        if name == "acknowledge_alarm":
            answer = self.alarm_log.acknowledge(arguments["id"], arguments["operator_name"])
            self.publish()
            return answer
        return True, f"{name} done"

    def fill(self):
        for k in range(1, 5):
            odd = {"verdict": int(Verdict.DOUBTFUL), "reasons": ("total field is 380 nT over",), "b_total": 50.38e-6}
            odd |= {"verdict_azimuth": int(Verdict.DOUBTFUL), "headline": "External field: use a gyro"}
            odd |= {"alternatives": (1.0,), "alternative_odds": (0.04,)}
            self.list = self.list.add(survey(k, **(odd if k == 4 else {})), 300.0 * k, 1.0, comment=EVIL)
        self.alarm_age_ns = 75 * 10**9
        self.alarm_log.raise_alarm("mag.field", Severity.WARNING, f"total field is off {EVIL}", "check")
        self.alarm_age_ns = 0
        self.live()
        self.publish()

    def publish(self, **server):
        now = time.monotonic()
        reference = ReferenceFieldState(declination=-0.014, convergence=-0.0157, source="WMM2025 (pygeomag)")
        self.state.show(now, well=self.list.well, reference_given=reference, surveys=self.list)
        path = self.list.definitive(bit_depth=1220.0)
        self.state.show(now, path=path, covariance=np.tile(np.diag([9.0, 4.0, 1.0]), (len(path.md), 1, 1)))
        plan = plan_of([0.0, 600.0, 1800.0], [0.0, 0.3, 1.0], [1.0, 1.0, 1.0], name="C")
        self.state.show(now, plan=plan)
        self.state.show(now, clearance=(near("A-3", 9.0), near(EVIL, 40.0)))
        alarms = AlarmState(self.alarm_log.alarms(), (), time.time() - now)
        self.state.show(now, alarms=alarms, events=self.alarm_log.events())
        self.state.show(now, diagnostics=(NodeDiagnostic(EVIL, DiagnosticLevel.WARNING, "slow", "look"),))
        self.push(**server)

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

    def push(self, **server):
        """Send the state; server: tables that the server says about itself."""
        self.server.push({**self.tables.snapshot(self.state.at(time.monotonic())), "server": server})


def survey(sequence, **changes):
    base = Survey(
        stamp_ns=(1_795_000_000 + sequence) * 10**9,
        uuid=f"u{sequence}",
        sequence=sequence,
        inclination=0.2 * sequence,
        azimuth=1.0,
        north=int(North.GRID),
        covariance=(1e-6, 0, 0, 0, 1e-4, 0, 0, 0, 1e-6),
        azimuth_method="fused",
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


def resize(browser, size):
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False},
    )


def in_each_size(browser, sizes=ALL_SIZES):
    """Yield sizes of the window, each when the page has been drawn in it."""
    for size in sizes:
        resize(browser, size)
        browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        yield size


def show(browser, rig, size=(1024, 768), path=""):
    resize(browser, size)
    browser.get(rig.server.address + path)
    wait(browser, lambda: text(browser, "#well-name") == "Nordlys 7 H")


def wait(browser, condition, seconds=20.0):
    WebDriverWait(browser, seconds, poll_frequency=0.02).until(lambda _: condition())


def text(browser, selector):
    return browser.execute_script("return document.querySelector(arguments[0])?.textContent ?? null", selector)


def state_of(browser, cell):
    return browser.execute_script("return document.querySelector(arguments[0])?.dataset.state", f'[data-cell="{cell}"]')


def click(browser, selector):
    browser.find_element(By.CSS_SELECTOR, selector).click()


def tab(browser, name):
    click(browser, f"#select-{name}")


def sign_in(browser, token, name="A. Berg"):
    tab(browser, "controls")
    for field, value in (("operator-name", name), ("operator-token", token)):
        box = browser.find_element(By.ID, field)
        box.clear()
        box.send_keys(value)


def steered(rig):
    """A slide between two stretches of rotation, as the rig and the tool report it."""
    sheet, now = SlideSheet(), time.monotonic()
    for k in range(121):
        depth, slide = 870.0 + 0.5 * k, 40 <= k < 80
        sheet.update((1_795_000_000 + k) * 10**9, depth, 0.0 if slide else 12.0, 2.2)
        rig.state.on_log_depth(depth)
        d = wire.DYNAMICS.empty(1)
        d["stick_slip_index"], d["lateral_rms"], d["shocks"] = np.nan if slide else 0.4, 9.0, k % 3
        rig.state.on_dynamics(d, now)
        rig.live(status=4 if k < 100 else 4 | 1024)
    gave = tuple(yields(sheet.stretches, rig.list.definitive()))
    rig.state.show(now, stretches=tuple(sheet.stretches), yields=gave)
    rig.push()


def box(browser, selector):
    script = "const r = document.querySelector(arguments[0]).getBoundingClientRect();"
    return browser.execute_script(f"{script} return [r.x, r.y, r.width, r.height]", selector)


def font_sizes(browser, selector):
    script = "return [...document.querySelectorAll(arguments[0])].map((e) => parseFloat(getComputedStyle(e).fontSize))"
    return browser.execute_script(script, selector)
