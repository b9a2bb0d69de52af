import dataclasses
import math

import pytest

from mwd_estimation.core.reason_text import WORDS, joined, text, texts
from mwd_estimation.core.reasons import Reason, ReasonCode, quoted

NUMBERS = Reason(ReasonCode.NO_AZIMUTH, 0.1, 0.2, (0.3, 0.4), ("one", "other"), (Reason(ReasonCode.NO_MAGNETOMETER),))


@pytest.mark.parametrize("code", ReasonCode)
def test_every_reason_has_a_sentence(code):
    assert set(WORDS) == set(ReasonCode)
    sentence = text(dataclasses.replace(NUMBERS, code=code))
    assert sentence
    assert "{" not in sentence


def test_a_number_is_printed_in_the_unit_of_its_sentence():
    off = Reason(ReasonCode.DIP_OFF, math.radians(0.4), math.radians(0.25))
    assert text(off).startswith("dip +0.40 deg off the reference, limit 0.25 deg")
    axial = Reason(ReasonCode.INTERFERENCE_CORRECTED, 612e-9, values=(80e-9,))
    assert text(axial) == "axial interference +612 +- 80 nT corrected"


def test_the_reasons_behind_a_reason_stand_in_its_sentence():
    why = Reason(ReasonCode.INCLINATION_ONLY, causes=(Reason(ReasonCode.NO_MAGNETOMETER),))
    assert text(why) == "no magnetometer reading: inclination and toolface only"
    assert texts([why, quoted("as it is")])[1] == "as it is"
    assert joined([why, quoted("more")]) == "no magnetometer reading: inclination and toolface only; more"
    assert joined(None) == ""
