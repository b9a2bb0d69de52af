# SPDX-License-Identifier: Apache-2.0
"""Words for faults: every fault has some, and they name unit, sensor and axis."""

from __future__ import annotations

import dataclasses

import pytest

from mwd_estimation.core.axis_mappings import MAPPINGS
from mwd_estimation.core.fault_messages import describe, mapping_words
from mwd_estimation.core.sensor_fault import FaultCode, FaultUnit, SensorFault


def fault(code, place=3, which=(0, 0, 0), unit=FaultUnit.CONVENTIONAL, value=1.0):
    return SensorFault(code, unit, place, value, 2.0, which, 2, 5)


@pytest.mark.parametrize("unit", list(FaultUnit))
@pytest.mark.parametrize("code", list(FaultCode))
def test_every_fault_has_words_and_a_remedy_and_its_end_too(code, unit):
    one = fault(code, which=(2, 0, 0) if code in (FaultCode.AXES, FaultCode.SIGN) else (1, 0, 0), unit=unit)
    text = describe(one)
    assert text.kind
    assert text.sensor
    assert text.message
    assert text.remedy
    assert text.severity in ("error", "warning")
    assert 0.0 < text.confidence <= 1.0
    assert ("precision" in text.sensor) == (unit != FaultUnit.CONVENTIONAL)
    ended = describe(dataclasses.replace(one, cleared_ns=7))
    assert ended.message.startswith(text.message)
    assert (ended.remedy, ended.kind, ended.sensor) == ("", text.kind, text.sensor)


@pytest.mark.fault_case(10)
@pytest.mark.parametrize(
    ("k", "words"),
    [
        ([1, 1, -1], "z axis reversed"),
        ([-1, -1, -1], "all axes reversed (or the frame left-handed)"),
        ([1, -1, -1], "turned half round about x"),
    ],
)
def test_reversed_axes_are_named(k, words):
    assert words in [mapping_words(i) for i, m in enumerate(MAPPINGS) if (m.diagonal() == k).all()]


def test_all_48_mappings_have_words_of_their_own():
    assert len({mapping_words(k) for k in range(1, 48)}) >= 40


def test_mistakes_that_explain_the_same_share_the_confidence():
    two = (1 << 3 | 1 << 5, 0, 0)
    assert describe(fault(FaultCode.AXES, 0, two)).confidence == pytest.approx(0.95 / 2)
    either = fault(FaultCode.AXES, 0, two, FaultUnit.EITHER)
    assert describe(either).sensor == "gyro/precision gyro"
    assert describe(either).confidence == pytest.approx(0.95 / 4)
