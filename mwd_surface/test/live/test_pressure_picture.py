# SPDX-License-Identifier: Apache-2.0
"""Pictures of the pressure: the line shows the last two minutes, the spectrum the frequency that is there."""

import numpy as np
import pytest

from mwd_surface.live.pressure_picture import LINE_HZ, LINE_S, PressureHistory


def pushed(rate, seconds, block, hertz=1.5):
    history = PressureHistory()
    time = np.arange(round(rate * seconds)) / rate
    pressure = 2.0e7 + 1e5 * np.sin(2.0 * np.pi * hertz * time)
    many = round(block * rate)
    for first in range(0, len(time), many):
        history.push(round(time[first] * 1e9), 1.0 / rate, pressure[first : first + many])
    return history.picture()


@pytest.mark.parametrize("rate", [25.0, 50.0, 100.0, 1000.0])
@pytest.mark.parametrize("block", [1.0, 2.0])
def test_the_spectrum_has_its_peak_where_the_pressure_swings(rate, block):
    picture = pushed(rate, 60.0, block)
    assert len(picture.spectra) >= 8
    assert np.argmax(picture.spectra[-1]) * picture.bin_hz == pytest.approx(1.5, abs=1.5 * picture.bin_hz)


def test_the_line_is_the_last_two_minutes_around_their_mean():
    picture = pushed(100.0, 200.0, 1.0, hertz=0.1)
    assert len(picture.line) == pytest.approx(LINE_HZ * LINE_S, rel=0.3)
    assert max(picture.line) == pytest.approx(100.0, rel=0.05)
    assert picture.end_ns == 200_000_000_000


def test_before_any_pressure_there_is_nothing_to_draw():
    picture = PressureHistory().picture()
    assert picture.line == ()
    assert picture.spectra == ()
