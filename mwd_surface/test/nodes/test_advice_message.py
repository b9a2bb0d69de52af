# SPDX-License-Identifier: Apache-2.0
"""Advice on steering as a message, and back."""

import pytest

pytest.importorskip("mwd_msgs", reason="the messages are not built")
from mwd_surface.ros.messages import advice_message
from mwd_surface.surveys.message_conversion import advice_of
from mwd_surface.trajectory.advice import Advice, AdviceMode

SLIDE = Advice(AdviceMode.SLIDE, 1.0, True, 0.2, 0.1, 0.9, 1480.0, 1486.0, 1498.0, 0.002, 0.003, 7, 0, "plan", "to it")


@pytest.mark.parametrize("advice", [SLIDE, Advice(reason="no plan is loaded")])
def test_an_advice_is_the_same_after_its_way_through_a_message(advice):
    assert advice_of(advice_message(advice)) == advice
