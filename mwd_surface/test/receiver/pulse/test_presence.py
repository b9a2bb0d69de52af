# SPDX-License-Identifier: Apache-2.0
"""Presence of pulses after a sync: confirmed by words, faint while pulses are missing, hopeless without words."""

from mwd_surface.receiver.pulse.transmission import Presence, PulseEvidence

WORD, NOTHING = PulseEvidence(60.0, 60.0, 5, 1), PulseEvidence(-1.0, 60.0, 5, 1)


def judged(score, stretches):
    presence = Presence(score)
    for one in stretches:
        presence.judge(one)
    return presence


def test_words_confirm_a_sync_and_noise_does_not():
    assert judged(12.0, [WORD, WORD]).confirmed
    noise = judged(12.0, [NOTHING] * 7)
    assert not noise.confirmed
    assert not noise.hopeless
    noise.judge(NOTHING)
    assert noise.hopeless


def test_words_that_speak_against_a_sync_end_it_early():
    assert judged(12.0, [PulseEvidence(-10.0, 60.0, 5, 1)] * 2).hopeless


def test_weak_words_add_up():
    assert judged(12.0, [PulseEvidence(4.0, 8.0, 5, 1)] * 3).confirmed


def test_a_confirmed_sync_is_never_hopeless():
    presence = judged(40.0, [NOTHING, WORD, WORD, *[NOTHING] * 60])
    assert presence.confirmed
    assert presence.faint
    assert not presence.hopeless


def test_a_stall_is_waited_for_and_what_it_hid_is_named():
    presence = judged(30.0, [WORD] * 6 + [NOTHING] * 4)
    assert presence.faint
    assert presence.faint_words == 3  # before the last one
    for _ in range(3):
        presence.judge(WORD)
    assert not presence.faint


def test_less_evidence_in_larger_noise_is_no_silence():
    """A fifth of the usual evidence is enough where the noise leaves no more to expect, and too little elsewhere."""
    noisy = judged(30.0, [WORD] * 6 + [PulseEvidence(12.0, 12.0, 5, 1)] * 3)
    quiet = judged(30.0, [WORD] * 6 + [PulseEvidence(12.0, 60.0, 5, 1)] * 3)
    # What noise reaches by chance is silence, however little is expected.
    empty = judged(30.0, [WORD] * 6 + [PulseEvidence(6.0, 6.0, 5, 1)] * 3)
    assert not noisy.faint
    assert quiet.faint
    assert empty.faint
