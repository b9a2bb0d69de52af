# SPDX-License-Identifier: Apache-2.0
"""Words: values to codes and back, the step of the rounding and its sigma."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis.strategies import floats, integers

from consistency import assert_consistent
from mwd_sensors.telemetry.words import COMMON, Word


def test_steps_are_those_that_kits_have():
    """12 bits over 180 deg, 360 deg, 2 g and 100 uT; 6 and 7 bits of toolface."""
    steps = [COMMON["Inc"].step(), COMMON["Azm"].step(), COMMON["Grav"].step(), COMMON["MagF"].step()]
    assert steps == pytest.approx([0.044, 0.088, 0.00049, 0.0244], rel=0.01)
    assert [COMMON["aTFA"].step(bits) for bits in (6, 7)] == pytest.approx([5.625, 2.8125])


@given(value=floats(-20.0, 200.0), bits=integers(2, 16))
def test_a_value_in_range_comes_back_within_half_a_step(value, bits):
    word = Word(bits, 0.0, 180.0, "deg")
    back = word.value(word.code(value))
    assert abs(back - min(max(value, 0.0), 180.0)) <= 0.5 * word.step() + 1e-9


@given(value=floats(-720.0, 720.0), bits=integers(2, 16))
def test_a_direction_comes_back_modulo_a_turn(value, bits):
    word = Word(bits, 0.0, 360.0, "deg")
    error = (word.value(word.code(value)) - value + 180.0) % 360.0 - 180.0
    assert abs(error) <= 0.5 * word.step() + 1e-9


def test_sigma_is_that_of_the_rounding():
    word = COMMON["Inc"]
    values = np.random.default_rng(1).uniform(1.0, 179.0, 20000)
    errors = [word.value(word.code(value)) - value for value in values]
    # A uniform error scatters less in its square than a Gaussian one, so the band of the chi square is wide enough.
    assert_consistent(errors, word.sigma_of(), name="rounding")


def test_sigma_grows_with_that_of_the_sensor():
    word = Word(12, 0.0, 360.0, "deg", sigma=0.3)
    assert word.sigma_of() == pytest.approx(np.sqrt(0.3**2 + word.step() ** 2 / 12.0))


def test_impossible_words_are_refused():
    with pytest.raises(ValueError, match="high"):
        Word(12, 10.0, 10.0)
    with pytest.raises(ValueError, match="single bit"):
        Word(1, 0.0, 1.0)
    with pytest.raises(ValueError, match="finite number, got nan"):
        COMMON["Inc"].code(float("nan"))
    with pytest.raises(ValueError, match="does not fit"):
        COMMON["Inc"].value(4096)


@given(value=floats(0.0, 360.0), bits=integers(4, 12))
def test_a_reserved_code_takes_no_value_with_it(value, bits):
    for word in (Word(0, 0.0, 360.0, "deg", reserved=True), Word(0, 0.0, 360.0, "cps", reserved=True)):
        code = word.code(value, bits)
        assert code != word.missing(bits) == 2**bits - 1
        off = abs(word.value(code, bits) - value)
        assert min(off, 360.0 - off if word.circular else off) <= word.step(bits) / 2.0 + 1e-9
        assert math.isnan(word.value(word.missing(bits), bits))
