# SPDX-License-Identifier: Apache-2.0
"""The head of every report: names, datums and norths."""

from mwd_estimation.core.north import North
from mwd_surface.surveys.well import NORTHS, Well


def test_a_wellbore_without_a_name_has_that_of_its_well():
    assert Well(name="34/10-A-12").wellbore_name == "34/10-A-12"
    assert Well(name="34/10-A-12", wellbore="ST2").wellbore_name == "ST2"


def test_the_norths_are_those_of_the_surveys_in_their_order():
    assert [North[name.upper()] for name in NORTHS] == [North.MAGNETIC, North.TRUE, North.GRID]
