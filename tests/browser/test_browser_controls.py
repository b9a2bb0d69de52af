# SPDX-License-Identifier: Apache-2.0
"""What a person may do: token, name, commands, alarms."""

import dataclasses
import math
import time

import pytest

from browser_page import TOKEN, By, click, rig_on, sign_in, tab, text, wait
from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.set_point import Mode, SetPoint
from mwd_surface.control.settings import ControlSettings
from mwd_surface.control.status import Achieved, ControlJudgement, ControlRequest, Sender
from mwd_surface.live.alarms import Severity
from mwd_surface.live.well_state import RodCount
from mwd_surface.surveys.survey_record import Value
from mwd_surface.trajectory.advice import Advice, AdviceMode

pytestmark = pytest.mark.slow


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
        wait(browser, lambda: "acknowledged by A. Berg" in text(browser, "#tab-alarms"))
        assert [name for name, _ in rig.calls] == ["take_survey", "accept_survey", "acknowledge_alarm"]
        assert rig.calls[1][1] == {"sequence": 4, "operator_name": "A. Berg", "reason": "gyro agrees"}


def test_a_revised_survey_shows_its_first_value_and_lets_a_person_accept_it(browser):
    with rig_on(browser) as rig:
        sign_in(browser, TOKEN)
        first = rig.list.find(2).survey
        rig.list = rig.list.revise(dataclasses.replace(first, azimuth=first.azimuth + 0.2, revision=1))
        rig.publish()
        tab(browser, "surveys")
        wait(browser, lambda: "revised" in text(browser, 'tr[data-sequence="2"]'))
        click(browser, "[data-keep=row-2]")
        shown = f"{math.degrees(first.azimuth):.2f}"
        wait(browser, lambda: shown in text(browser, ".detail"))
        click(browser, "[data-keep=accept-first]")
        wait(browser, lambda: rig.calls)
        assert rig.calls[0][1]["value"] == Value.FIRST


def test_a_depth_typed_in_feet_goes_out_in_metres_with_the_wish_to_replace(browser):
    with rig_on(browser) as rig:
        sign_in(browser, TOKEN)
        click(browser, "#units")
        tab(browser, "surveys")
        click(browser, "[data-keep=row-4]")
        browser.find_element(By.CSS_SELECTOR, "[data-keep=depth]").send_keys("deep")
        click(browser, "[data-keep=accept]")
        wait(browser, lambda: '"deep" is not a number (ft)' in text(browser, ".judging"))
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


def test_the_rod_buttons_reach_the_node_and_an_empty_number_of_rods_does_not(browser):
    with rig_on(browser) as rig:
        rig.state.show(time.monotonic(), rods=RodCount(3, 6.5, 1.5))
        rig.push()
        sign_in(browser, TOKEN)
        wait(browser, lambda: browser.find_element(By.ID, "rods").is_displayed())
        for button in ("#add-rod", "#remove-rod"):
            sent = len(rig.calls)
            click(browser, button)
            wait(browser, lambda sent=sent: len(rig.calls) > sent)
        browser.find_element(By.ID, "rod-reason").send_keys("counted")
        for wrong in ("", "1e2", "-1", "0x2"):
            box = browser.find_element(By.ID, "rod-count")
            box.clear()
            box.send_keys(wrong)
            click(browser, "#correct-rods")
            wait(browser, lambda wrong=wrong: f'"{wrong}" is not a whole number' in text(browser, "#answer"))
        box.clear()
        box.send_keys("4")
        click(browser, "#correct-rods")
        wait(browser, lambda: len(rig.calls) == 3)
        given = [{"change": 1}, {"change": -1}, {"count": 4, "reason": "counted"}]
        assert rig.calls == [("count_rods", {"operator_name": "A. Berg", **one}) for one in given]


def test_a_person_without_a_name_is_asked_for_it(browser):
    with rig_on(browser) as rig:
        sign_in(browser, TOKEN, name=" ")
        tab(browser, "alarms")
        click(browser, ".alarm button")
        tab(browser, "controls")
        wait(browser, lambda: "give your name" in text(browser, "#answer"))
        assert rig.calls == []


def test_the_worst_alarm_stands_above_all_with_text_remedy_and_age_and_opens_the_list(browser):
    with rig_on(browser) as rig:
        wait(browser, lambda: "for 7" in text(browser, "#alarm"))
        rig.alarm_age_ns = 12 * 10**9
        rig.alarm_log.raise_alarm("input.attitude", Severity.CRITICAL, "no attitude", "is the estimator alive?")
        rig.alarm_age_ns = 0
        rig.publish()
        wait(browser, lambda: "CRITICAL: no attitude" in text(browser, "#alarm"))
        assert "is the estimator alive?" in text(browser, "#alarm")
        assert "for 1" in text(browser, "#alarm")
        assert "+ 1 more" in text(browser, "#alarm")
        click(browser, "#alarm")
        assert browser.find_element(By.ID, "tab-alarms").is_displayed()
        rig.alarm_log.acknowledge("input.attitude", "A. Berg")
        rig.publish()
        # An alarm that nobody has seen comes before one that somebody has.
        wait(browser, lambda: "WARNING: total field is off" in text(browser, "#alarm"))
        for alarm in rig.alarm_log.alarms():
            rig.alarm_log.acknowledge(alarm.id, "A. Berg")
            rig.alarm_log.clear_alarm(alarm.id)
        rig.publish()
        wait(browser, lambda: text(browser, "#alarm") == "✓ No alarms")


def test_a_person_sees_who_asks_for_control_and_grants_it_and_takes_it_back(browser):
    authority = ControlAuthority(ControlSettings(enabled=True))
    sender = Sender("test", "toolface hold")
    lease = authority.request(ControlRequest(sender, "toolface hold", "holds the toolface"), 0.0).lease
    with rig_on(browser) as rig:
        rig.state.show(time.monotonic(), control=authority.status(0.0))
        rig.push()
        tab(browser, "steering")
        wait(browser, lambda: "toolface hold asks for control" in text(browser, "#tab-steering"))
        assert not browser.find_element(By.CSS_SELECTOR, "#grant-control").is_enabled()
        sign_in(browser, TOKEN)
        tab(browser, "steering")
        click(browser, "#grant-control")
        wait(browser, lambda: rig.calls)
        decision = {"decision": int(ControlJudgement.GRANT), "operator_name": "A. Berg", "number": lease}
        assert rig.calls == [("judge_control", decision)]
        authority.judge(ControlJudgement.GRANT, "A. Berg", 0.0, number=lease)
        authority.command(SetPoint(Mode.ROTATE, lease, 1, rotary_speed=math.pi), 0.0, sender)
        authority.on_rig(Achieved(speed=math.pi, torque=8000.0), 0.0)
        # The ramp makes up for no more than its longest step at a time.
        for step in range(1, 11):
            authority.update(0.19 * step)
        rig.state.show(time.monotonic(), control=authority.status(1.9))
        rig.push()
        wait(browser, lambda: "toolface hold has control" in text(browser, "#tab-steering"))
        shown = text(browser, "#tab-steering")
        assert "rotate at 19 r/min" in shown
        assert "30 r/min, 8.0 kN·m" in shown
        assert "sliding: hold, rotating: release" in shown
        click(browser, "#abort-control")
        wait(browser, lambda: len(rig.calls) == 2)
        assert rig.calls[1][1]["decision"] == ControlJudgement.ABORT


def test_the_advice_is_shown_with_what_it_follows_from(browser):
    advice = Advice(
        AdviceMode.SLIDE,
        toolface=math.radians(126.0),
        limit=math.radians(15.0),
        sigma=math.radians(6.0),
        confidence=0.985,
        from_depth=1500.0,
        slide_to_depth=1509.0,
        to_depth=1528.0,
        source="plan",
        reason="2.4 deg/30 m needed",
    )
    with rig_on(browser) as rig:
        tab(browser, "steering")
        wait(browser, lambda: "No advice" in text(browser, "#tab-steering"))
        rig.state.show(time.monotonic(), advice=advice)
        rig.push()
        wait(browser, lambda: "slide from 1500.00 to 1509.00 m, then rotate" in text(browser, "#tab-steering"))
        assert "126° GTF ± 15°" in text(browser, "#tab-steering")
        assert "98 %" in text(browser, "#tab-steering")
