"""Gyro against magnetic azimuth: an alarm in words only beyond three sigma of the difference."""

import math

import pytest

from mwd_surface.surveys.azimuth_check import disagreement
from mwd_surface.surveys.survey_record import AzimuthEstimate, North, Survey


def made(*azimuths, **more):
    base = {"azimuth": 0.9, "north": int(North.TRUE), "b_reference": 5e-5, "azimuths": azimuths}
    return Survey(stamp_ns=1, uuid="u", sequence=4, inclination=0.5, **{**base, **more})


def one(method, deg, sigma_deg, north=North.TRUE):
    return AzimuthEstimate(
        method, int(north), math.radians(deg), math.radians(sigma_deg) if sigma_deg > 0.0 else -1.0, 1.0, ""
    )


def test_azimuths_within_three_sigma_agree_across_north():
    assert disagreement(made(one("gyro", 359.5, 0.5), one("corrected", 0.5, 0.5))) == ""


@pytest.mark.parametrize("north", [North.MAGNETIC, North.GRID, North.TRUE])
def test_each_is_turned_to_true_north_before_it_is_compared(north):
    turn = {North.MAGNETIC: 2.0, North.GRID: -1.0, North.TRUE: 0.0}[north]
    angles = {"declination": math.radians(2.0), "convergence": math.radians(-1.0)}
    assert disagreement(made(one("gyro", 50.0, 0.1), one("msa", 50.0 - turn, 0.1, north), **angles)) == ""


def test_a_disagreement_names_both_the_difference_and_its_sigmas():
    text = disagreement(made(one("raw", 80.0, 0.5), one("gyro", 50.0, 0.3), one("corrected", 52.0, 0.4)))
    assert text == "survey 4: corrected azimuth is +2.0 deg (4.0 sigma) from the gyro azimuth"


def test_an_azimuth_that_is_not_available_says_nothing():
    assert disagreement(made(one("gyro", 50.0, -1.0), one("corrected", 90.0, 0.4))) == ""
    assert disagreement(made(one("corrected", 90.0, 0.4))) == ""
    bare = made(one("gyro", 50.0, 0.3), one("corrected", 90.0, 0.4, North.MAGNETIC), b_reference=-1.0)
    assert disagreement(bare) == "", "without a reference field nobody knows the declination"
