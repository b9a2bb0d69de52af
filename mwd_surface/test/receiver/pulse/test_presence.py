# SPDX-License-Identifier: Apache-2.0
"""Presence of pulses after a sync: confirmed by words, faint while pulses are missing, hopeless without words."""

import pytest

from mwd_surface.receiver.pulse.transmission import Presence, PulseEvidence

WORD, NOTHING = PulseEvidence(60.0, 60.0, 5, 1), PulseEvidence(-1.0, 60.0, 5, 1)


def judged(score, stretches):
    presence = Presence(score)
    for one in stretches:
        presence.judge(one)
    return presence


def evidence(score, expected):
    return PulseEvidence(score, expected, 5, 1)


# Score of the sync, evidence of the words behind it, and whether the pulses are confirmed, faint or hopeless.
CASES = {
    "words": (12.0, [WORD] * 2, {"confirmed"}),
    "noise": (12.0, [NOTHING] * 7, set()),
    "noise for long": (12.0, [NOTHING] * 8, {"hopeless"}),
    "words against the sync": (12.0, [evidence(-10.0, 60.0)] * 2, {"hopeless"}),
    "weak words": (12.0, [evidence(4.0, 8.0)] * 3, {"confirmed"}),
    "words, then nothing": (40.0, [NOTHING, WORD, WORD, *[NOTHING] * 60], {"confirmed", "faint"}),
    # A fifth of the usual evidence is enough where the noise leaves no more to expect, and too little elsewhere.
    "larger noise": (30.0, [WORD] * 6 + [evidence(12.0, 12.0)] * 3, {"confirmed"}),
    "a fifth of the evidence": (30.0, [WORD] * 6 + [evidence(12.0, 60.0)] * 3, {"confirmed", "faint"}),
    # What noise reaches by chance is silence, however little is expected.
    "as much as by chance": (30.0, [WORD] * 6 + [evidence(6.0, 6.0)] * 3, {"confirmed", "faint"}),
}


@pytest.mark.parametrize("case", CASES)
def test_words_decide_whether_pulses_are_confirmed_faint_or_hopeless(case):
    score, stretches, expected = CASES[case]
    presence = judged(score, stretches)
    found = {name for name in ("confirmed", "faint", "hopeless") if getattr(presence, name)}
    assert found == expected


def test_a_stall_is_waited_for_and_what_it_hid_is_named():
    presence = judged(30.0, [WORD] * 6 + [NOTHING] * 4)
    assert presence.faint
    assert presence.faint_words == 3  # before the last one
    for _ in range(3):
        presence.judge(WORD)
    assert not presence.faint
