# SPDX-License-Identifier: Apache-2.0
"""What parities teach of confidence."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from mwd_surface.receiver.belief import SURVEY_LEVEL, TOOLFACE_LEVEL, Candidate, Doubt, Soft


def soft(right=0.999, holds=0.98):
    """A word whose best value has that probability."""
    return Soft((Candidate(7, right), Candidate(3, 1.0 - right)), holds)


def test_parities_that_hold_make_words_believed():
    doubt = Doubt()
    before = doubt.judge(soft()).confidence
    doubt.learn([soft()] * 20)
    judged = doubt.judge(soft())
    assert judged.code == 7
    assert judged.confidence > max(before, 0.99)
    assert judged.alternatives[0][0] == 3
    assert doubt.failing < 1e-3


def test_parities_that_fail_half_the_time_make_no_word_believed():
    doubt = Doubt()
    random = np.random.default_rng(1)
    doubt.learn([soft(holds=float(h)) for h in random.choice([0.02, 0.98], size=24)])
    assert doubt.failing > 0.3
    assert doubt.judge(soft(right=1.0)).confidence < TOOLFACE_LEVEL


def test_a_proven_configuration_begins_a_transmission_with_less_doubt():
    """A sync without words behind it takes nothing away, and a transmission whose parities failed gives nothing."""
    before, failed = Doubt(), Doubt()
    before.learn([soft()] * 20)
    failed.learn([soft(holds=h) for h in (0.02, 0.98) * 12])
    assert before.following().failing == pytest.approx(0.25 * Doubt().failing, rel=0.01)
    assert before.following().judge(soft()).confidence > Doubt().judge(soft()).confidence
    assert before.following().following().failing < Doubt().failing
    assert failed.following().failing == pytest.approx(Doubt().failing, abs=1e-3)


def test_a_parity_that_surely_fails_speaks_against_the_configuration():
    doubt = Doubt()
    doubt.learn([soft(holds=0.0)])
    assert Doubt().failing < doubt.failing < 1.0


def test_a_word_without_parity_teaches_nothing():
    doubt = Doubt()
    doubt.learn([Soft(soft().candidates, None)] * 10)
    assert doubt.failing == pytest.approx(Doubt().failing)


def test_a_tool_without_any_parity_is_believed_once_its_pulses_fit():
    doubt, wrong = Doubt(), Doubt()
    word = Soft(soft(right=1.0).candidates, None)
    assert doubt.judge(word).confidence < 0.95
    doubt.learn([dataclasses.replace(word, fits=0.5)] * 7)
    wrong.learn([dataclasses.replace(word, fits=fits) for fits in (0.5, -3.0, 0.5, -2.0, 0.5, -3.0, 0.5)])
    assert doubt.judge(word).confidence > 0.99
    assert wrong.judge(word).confidence < 0.1


def test_help_and_tutorial_name_the_probability_from_which_a_word_is_believed():
    root = Path(__file__).resolve().parents[3]
    for page in ("docs/tutorials/decode_pressure.md", "mwd_surface/mwd_surface/commands/decode.py"):
        words = " ".join((root / page).read_text(encoding="utf-8").split())
        assert re.search(
            rf"{SURVEY_LEVEL:g} (or more )?\(survey\) or {TOOLFACE_LEVEL:g} (or more )?\(toolface\)", words
        ), page
