# SPDX-License-Identifier: Apache-2.0
import dataclasses
import math

import pytest

from mwd_estimation.core.reason_text import WORDS, joined, text, texts
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.sensor_fault import ACCEL, FaultCode, FaultUnit, SensorFault

NUMBERS = Reason(ReasonCode.HYPOTHESES, 0.1, 0.2, (0.3, 0.4), ("one", "other"), (Reason(ReasonCode.NO_MAGNETOMETER),))

SUSPECT = Reason(ReasonCode.SENSOR_SUSPECT, names=("gyro",))


@pytest.mark.parametrize("code", ReasonCode)
def test_every_reason_has_a_sentence(code):
    assert set(WORDS) == set(ReasonCode)
    sentence = text(dataclasses.replace(NUMBERS, code=code))
    assert sentence
    assert "{" not in sentence


def test_a_number_is_printed_in_the_unit_of_its_sentence():
    off = Reason(ReasonCode.DIP_OFF, math.radians(0.4), math.radians(0.25))
    assert text(off).startswith("dip +0.40 deg off the reference, limit 0.25 deg")
    far = Reason(ReasonCode.GYRO_ONLY_UNCERTAIN, 0.0123, math.radians(10.0))
    assert text(far).startswith("azimuth may be wrong by more than 10 deg (probability 1.2 %)")


def test_hypotheses_and_azimuths_are_listed_with_their_odds():
    odds = Reason(ReasonCode.HYPOTHESES, values=(0.83, 0.12), names=("clean", "external"))
    assert (
        text(odds)
        == "possible disturbances of the field: nothing beyond the tool code 83 %, steel outside the string 12 %"
    )
    several = Reason(ReasonCode.AZIMUTHS_FIT, math.radians(8.6), 0.95, (math.radians(197.7), 0.05))
    assert "8.6 deg with 95.0 %, 197.7 deg with 5.0 %" in text(several)


def test_the_reasons_behind_a_reason_stand_in_its_sentence():
    why = Reason(ReasonCode.INCLINATION_ONLY, causes=(Reason(ReasonCode.NO_MAGNETOMETER),))
    assert text(why) == "no magnetometer reading: only inclination and toolface are computed"
    assert texts([why, SUSPECT])[1] == "the gyro was in doubt while this survey was averaged: take the survey again"
    assert joined([why, why]) == "; ".join(["no magnetometer reading: only inclination and toolface are computed"] * 2)
    assert joined(None) == ""


def test_the_fault_of_a_sensor_is_put_in_words_only_here():
    dead = SensorFault(FaultCode.DEAD, FaultUnit.CONVENTIONAL, 3, 0.0, 0.0, (0, 0, 0), ACCEL, 1)
    words = "accelerometer is dead: it sends only zeros"
    remedy = "check plug and cable of the sensor; if the fault remains, change the probe"
    assert text(Reason(ReasonCode.SENSOR_FAULT, fault=dead)) == f"{words}; {remedy}"
    assert text(Reason(ReasonCode.PRECISION_UNIT_FAULT, fault=dead)) == f"{words}: {remedy}"
