# SPDX-License-Identifier: Apache-2.0
"""What parities teach of confidence."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from mwd_surface.receiver.belief import SURVEY_LEVEL, TEMPERATURES, TOOLFACE_LEVEL, Candidate, Soft, Temper

COUNT = len(TEMPERATURES)


def soft(right=0.999, holds=0.98):
    """A word whose best value has that probability at the lowest temperature, less at higher ones."""
    chances = tuple(right ** (t**2) for t in TEMPERATURES)
    return Soft(
        (Candidate(7, chances), Candidate(3, tuple(1.0 - c for c in chances))),
        tuple(0.5 + (holds - 0.5) / t for t in TEMPERATURES),
    )


def test_parities_that_hold_make_words_believed():
    temper = Temper()
    before = temper.judge(soft()).confidence
    temper.learn([soft()] * 20)
    judged = temper.judge(soft())
    assert judged.code == 7
    assert judged.confidence > max(before, 0.99)
    assert judged.alternatives[0][0] == 3
    assert temper.failing < 1e-3


def test_parities_that_fail_half_the_time_make_no_word_believed():
    temper = Temper()
    random = np.random.default_rng(1)
    temper.learn([soft(holds=float(h)) for h in random.choice([0.02, 0.98], size=24)])
    assert temper.failing > 0.3
    assert temper.judge(soft(right=1.0)).confidence < TOOLFACE_LEVEL


def test_a_proven_configuration_begins_a_transmission_with_less_doubt():
    """A sync without words behind it takes nothing away, and a transmission whose parities failed gives nothing."""
    before, failed = Temper(), Temper()
    before.learn([soft()] * 20)
    failed.learn([soft(holds=h) for h in (0.02, 0.98) * 12])
    assert before.following().failing == pytest.approx(0.25 * Temper().failing, rel=0.01)
    assert before.following().judge(soft()).confidence > Temper().judge(soft()).confidence
    assert before.following().following().failing < Temper().failing
    assert failed.following().weights() == pytest.approx(Temper().weights(), abs=1e-3)


def test_a_word_whose_parity_would_rather_fail_is_believed_less():
    temper = Temper()
    temper.learn([soft()] * 20)
    doubtful, clear = temper.judge(soft(holds=0.05)), temper.judge(soft())
    assert doubtful.code == clear.code
    assert doubtful.confidence < clear.confidence
    # What all parities say of the configuration is not counted again.
    ways = [sum(p for _, p in one.alternatives) + one.confidence for one in (doubtful, clear)]
    assert ways == pytest.approx([1.0 - temper.failing] * 2)


@pytest.mark.parametrize("holds", [0.0, -2e-16])
def test_a_parity_that_surely_fails_at_every_temperature_makes_its_word_least_believed(holds):
    # What is left of 1 by float arithmetic where every code that a strong signal allows has the other parity.
    judged = Temper().judge(dataclasses.replace(soft(), holds=(holds,) * COUNT))
    assert judged.code == 7
    assert 0.5 < judged.confidence < Temper().judge(soft(holds=0.05)).confidence


def test_a_word_without_parity_teaches_nothing():
    temper = Temper()
    before = temper.weights()
    temper.learn([Soft(soft().candidates, None)] * 10)
    assert temper.weights() == pytest.approx(before)
    assert before.sum() == pytest.approx(1.0)
    assert len(before) == COUNT + 1


def test_a_tool_without_any_parity_can_be_believed():
    unsure, sure = Temper().judge(soft(right=1.0)), Temper(parity=False).judge(soft(right=1.0))
    assert unsure.confidence < 0.95
    assert sure.confidence > 0.99


def test_help_and_tutorial_name_the_probability_from_which_a_word_is_believed():
    root = Path(__file__).resolve().parents[3]
    for page in ("docs/tutorials/decode_pressure.md", "mwd_surface/mwd_surface/commands/decode.py"):
        words = " ".join((root / page).read_text(encoding="utf-8").split())
        assert f"below {SURVEY_LEVEL:g} (survey) or {TOOLFACE_LEVEL:g} (toolface)" in words, page
