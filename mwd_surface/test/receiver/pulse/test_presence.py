# SPDX-License-Identifier: Apache-2.0
"""Whether a transmission is there: confirmed by words, faint while a stall lasts, ended by silence or a new sync."""

from mwd_surface.receiver.pulse.presence import FADED, NO_WORDS, Evidence, Presence

WORD, NOTHING = Evidence(60.0, 60.0, 5, 1), Evidence(-1.0, 60.0, 5, 1)


def judged(presence, stretches, waiting=False):
    return [presence.judge(one, False, waiting) for one in stretches]


def test_words_confirm_a_sync_and_noise_does_not():
    good, noise = Presence(12.0), Presence(12.0)
    assert judged(good, [WORD, WORD]) == ["", ""]
    assert good.confirmed
    assert judged(noise, [NOTHING, NOTHING]) == ["", NO_WORDS]
    assert not noise.confirmed


def test_a_pass_of_one_word_needs_the_share_of_one_word():
    """Six decibels a bit give one word of 13 bits an evidence of 8; five packets of noise hardly reach 4."""
    weak, noise = Presence(28.0), Presence(28.0)
    assert weak.judge(Evidence(8.4, 8.0, 5, 1), True, False) == ""
    assert weak.confirmed
    assert noise.judge(Evidence(4.0, 8.0, 5, 1), True, False) == NO_WORDS


def test_behind_a_clear_sync_the_first_words_may_be_disturbed():
    presence = Presence(40.0)
    assert judged(presence, [NOTHING, NOTHING, WORD, WORD]) == [""] * 4
    assert presence.confirmed
    assert judged(Presence(40.0), [NOTHING] * 5)[-1] == NO_WORDS


def test_a_stall_is_waited_for_and_what_it_hid_is_named():
    presence = Presence(30.0)
    judged(presence, [WORD] * 6)
    assert judged(presence, [NOTHING] * 4) == [""] * 4
    assert presence.faint
    assert presence.faint_words == 3  # before the last one
    judged(presence, [WORD] * 3)
    assert not presence.faint


def test_less_evidence_in_larger_noise_is_no_silence():
    """A fifth of the usual evidence is enough where the noise leaves no more to expect, and too little elsewhere."""
    noisy, quiet, empty = Presence(30.0), Presence(30.0), Presence(30.0)
    for one in (noisy, quiet, empty):
        judged(one, [WORD] * 6)
    judged(noisy, [Evidence(12.0, 12.0, 5, 1)] * 3)
    judged(quiet, [Evidence(12.0, 60.0, 5, 1)] * 3)
    # What noise reaches by chance is silence, however little is expected.
    judged(empty, [Evidence(6.0, 6.0, 5, 1)] * 3)
    assert not noisy.faint
    assert quiet.faint
    assert empty.faint


def test_long_silence_or_a_new_sync_ends_a_transmission():
    silent, anew = Presence(30.0), Presence(30.0)
    for one in (silent, anew):
        judged(one, [WORD] * 6)
    assert FADED in judged(silent, [NOTHING] * 13)
    assert judged(anew, [NOTHING] * 3, waiting=True)[-1] == FADED
