# SPDX-License-Identifier: Apache-2.0
"""What parities teach of confidence."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from mwd_surface.receiver.belief import SURVEY_LEVEL, TOOLFACE_LEVEL, Candidate, Doubt, Soft, judge


def soft(right=0.999, holds=0.98):
    """A word whose best value has that probability."""
    return Soft((Candidate(7, right), Candidate(3, 1.0 - right)), holds)


def confidence(doubt, word):
    """Confidence of a word that comes next."""
    return judge(word, doubt.learn([word])[0]).confidence


def test_parities_that_hold_make_words_believed():
    doubt = Doubt()
    before = confidence(Doubt(), soft())
    doubt.learn([soft()] * 20)
    assert doubt.failing < 0.005
    judged = judge(soft(), doubt.learn([soft()])[0])
    assert judged.code == 7
    assert judged.confidence > max(before, 0.99)
    assert judged.alternatives[0][0] == 3


def test_parities_that_fail_half_the_time_make_no_word_believed():
    doubt = Doubt()
    random = np.random.default_rng(1)
    doubt.learn([soft(holds=float(h)) for h in random.choice([0.02, 0.98], size=24)])
    assert doubt.failing > 0.3
    assert confidence(doubt, soft(right=1.0)) < TOOLFACE_LEVEL


def test_a_proven_configuration_begins_a_transmission_with_less_doubt():
    """A sync without words behind it takes nothing away, and a transmission whose parities failed gives nothing."""
    before, failed = Doubt(), Doubt()
    before.learn([soft()] * 20)
    failed.learn([soft(holds=h) for h in (0.02, 0.98) * 12])
    assert 0.25 * Doubt().failing <= before.following().failing < 0.3 * Doubt().failing
    assert confidence(before.following(), soft()) > confidence(Doubt(), soft())
    assert before.following().following().failing < Doubt().failing
    assert failed.following().failing == pytest.approx(Doubt().failing, abs=1e-3)


def test_a_parity_that_surely_fails_speaks_against_the_configuration():
    doubt = Doubt()
    doubt.learn([soft(holds=0.0)])
    assert Doubt().failing < doubt.failing < 1.0


def test_a_word_without_parity_teaches_nothing():
    after_one, after_more = Doubt(), Doubt()
    after_one.learn([soft()])
    after_more.learn([soft(), Soft(soft().candidates, None)])
    assert after_more.failing == pytest.approx(after_one.failing, abs=0.003)


def test_a_tool_without_any_parity_is_believed_once_its_pulses_fit():
    doubt, wrong = Doubt(), Doubt()
    word = Soft(soft(right=1.0).candidates, None)
    good = dataclasses.replace(word, fits=6.0)
    assert confidence(Doubt(), word) < 0.95
    doubt.learn([good] * 9)
    wrong.learn([dataclasses.replace(word, fits=fits) for fits in (6.0, -3.0, 6.0, -2.0, 6.0, -3.0, 6.0)])
    assert confidence(doubt, good) > 0.98
    assert confidence(wrong, good) < 0.5


def test_words_before_a_word_of_another_length_are_believed_and_the_words_after_it_are_not():
    """One word after the change that fits by chance is not believed either."""
    good, bad = (
        dataclasses.replace(soft(right=1.0, holds=holds), fits=fits) for holds, fits in ((1.0, 6.0), (0.5, -9.0))
    )
    trusted = Doubt().learn([good] * 8 + [bad, bad, good, bad, bad])
    assert min(trusted[:7]) > 0.9
    assert max(trusted[8:]) < 0.2


def test_a_word_that_does_not_fit_is_not_believed_though_the_words_around_it_are():
    good, bad = (dataclasses.replace(soft(right=1.0), fits=fits) for fits in (6.0, -9.0))
    trusted = Doubt().learn([good] * 8 + [bad] + [good] * 8)
    assert trusted[8] < 0.05
    assert min(trusted[4:8] + trusted[9:]) > 0.95


def test_help_and_tutorial_name_the_probability_from_which_a_word_is_believed():
    root = Path(__file__).resolve().parents[3]
    for page in ("docs/tutorials/decode_pressure.md", "mwd_surface/mwd_surface/commands/decode.py"):
        words = " ".join((root / page).read_text(encoding="utf-8").split())
        assert re.search(
            rf"{SURVEY_LEVEL:g} (or more )?\(survey\) or {TOOLFACE_LEVEL:g} (or more )?\(toolface\)", words
        ), page


# Words with clear pulses: with a parity that holds, with one that shows nothing, and without any.
HELD, OPEN, PLAIN = (Soft((Candidate(1, 1.0),), holds, 6.0) for holds in (1.0, 0.5, None))


def after_sync(size, words=()):
    """Return the doubt after a sync of a size, and the trust in the words that follow it."""
    doubt = Doubt()
    doubt.hear_sync(size, 0.12)
    return doubt, doubt.learn(list(words))


def test_a_sync_larger_than_the_words_shows_a_second_tool_unless_the_parities_hold():
    sizes = (0.8, 1.0, 1.2, 1.4, 1.6, 1.8)
    unsure = [after_sync(size, [OPEN] * 8) for size in sizes]
    chances = [doubt.two_tools for doubt, _ in unsure]
    assert chances == sorted(chances)
    assert chances[1] < 0.002
    assert chances[-1] > 0.9
    assert max(unsure[-1][1]) < 0.1
    assert min(unsure[1][1]) > 0.99
    assert all(after_sync(size, [HELD] * 8)[0].two_tools <= one for size, one in zip(sizes, chances, strict=True))
    assert after_sync(1.6, [HELD] * 8)[0].two_tools < 0.5
    unknown = Doubt()
    unknown.hear_sync(1.8, np.inf)
    assert unknown.two_tools == Doubt().two_tools


def test_a_tool_is_believed_again_after_a_second_one_falls_silent():
    doubt, trusted = after_sync(1.7, [OPEN] * 10)
    assert max(trusted) < 0.1
    assert doubt.learn([HELD] * 14)[-1] > 0.99
    assert doubt.two_tools < 0.01


def test_a_wrong_parity_behind_a_sync_of_the_usual_size_is_no_second_tool():
    doubt, trusted = after_sync(1.0, [Soft((Candidate(1, 1.0),), 0.0, 6.0)] * 30)
    assert max(trusted) < 0.01
    assert doubt.two_tools < 0.01


def test_a_survey_word_is_not_believed_before_its_parities_or_the_sync_exclude_a_second_tool():
    before, heard = Doubt(), after_sync(1.0)[0]
    assert max(before.learn([PLAIN] * 30)) < SURVEY_LEVEL
    assert heard.learn([PLAIN] * 5)[-1] > SURVEY_LEVEL
    assert Doubt().learn([HELD] * 2)[-1] > SURVEY_LEVEL
