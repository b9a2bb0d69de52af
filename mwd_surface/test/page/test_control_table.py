# SPDX-License-Identifier: Apache-2.0
"""Control and advice as the page's JSON: words people read, None for what is not known, the same as the rig has."""

import json

import pytest
from example_rig import ADVICE, NOW, control, live

from mwd_surface.live.live_state import LiveState
from mwd_surface.page.state_feed import dumps
from mwd_surface.page.state_json import StateJson


def sections(state):
    return json.loads(dumps(StateJson().snapshot(state)))["sections"]


def test_before_anybody_asks_the_driller_has_the_rig():
    table = sections(LiveState().at(1.0))
    assert (table["control"]["enabled"], table["control"]["state"]) == (False, "driller")
    assert table["control"]["achieved"]["speed"] is None
    assert table["advice"]["mode"] == "none"


def test_owner_set_point_and_what_the_rig_does_are_shown():
    shown = sections(live().at(NOW))["control"]
    status = control(NOW)
    assert (shown["owner"], shown["state"], shown["mode"]) == ("modbus 5", "controller", "rotate")
    assert shown["asked_speed"] == pytest.approx(status.rotary_speed, rel=1e-9)
    assert shown["acknowledged"] == status.acknowledged > 0
    assert shown["reactions"]["controller_lost_sliding"] == "hold"


def test_the_advice_is_the_one_that_a_rig_system_reads():
    shown = sections(live().at(NOW))
    assert shown["advice"]["toolface"] == ADVICE.toolface
    assert shown["advice"]["to_depth"] == ADVICE.to_depth
    assert shown["toolface"]["advisory"]["toolface"] == ADVICE.toolface
