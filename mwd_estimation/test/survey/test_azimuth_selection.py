"""Which magnetic azimuth is taken, and what interference that shows, or that the attitude hides, does to its sigma."""

import math

import numpy as np
import pytest

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.error_model import BENCH
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.magnetic import axial_correction
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.azimuth_selection import (
    choose,
    corrected,
    hidden,
    raw,
    shown_variance,
    shows,
    turned_variance,
)
from mwd_sensors.core.frames import mat_nt, wrap_pi

DEG = math.pi / 180.0
REFERENCE = Reference(50e-6, 72 * DEG, 3 * DEG, 1 * DEG, 9.81, "test")
RAW, SINGLE_STATION = AzimuthMethod.RAW, AzimuthMethod.SINGLE_STATION
UNCERTAIN = Reason(ReasonCode.CORRECTION_UNCERTAIN)
EXPECTED, PLAUSIBLE = 220e-9, 3000e-9


def case(inc, azi, axial):
    """Correction, methods, Jacobian and sensor covariance of a station with that much axial field, T."""
    mat_tn = mat_nt(inc * DEG, azi * DEG, 0.4).T
    f, b = mat_tn @ [0.0, 0.0, -9.81], mat_tn @ [REFERENCE.horizontal, 0.0, REFERENCE.vertical] + [axial, 0.0, 0.0]
    spread = BENCH.covariance(f, b)
    found = axial_correction.axial_correction(
        f, b, REFERENCE.horizontal, REFERENCE.vertical, spread, REFERENCE.covariance, plausible=PLAUSIBLE
    )
    jacobian = magnetic_geometry.angle_jacobian(f, b)
    methods = [raw(f, b, jacobian, spread, EXPECTED, PLAUSIBLE, found), corrected(found, jacobian, spread)]
    return found, methods, jacobian, spread


@pytest.mark.parametrize(("axial", "wanted"), [(0.0, RAW), (2e-6, SINGLE_STATION)])
def test_the_correction_is_taken_where_interference_shows(axial, wanted):
    found, methods, *_ = case(35, 60, axial)
    assert shows(found, EXPECTED) == (wanted == SINGLE_STATION)
    assert choose("auto", methods, found, None, EXPECTED, PLAUSIBLE).name == wanted
    assert choose(RAW, methods, found, None, EXPECTED, PLAUSIBLE).name == RAW
    assert choose(SINGLE_STATION, methods, found, None, EXPECTED, PLAUSIBLE).name == SINGLE_STATION


def test_a_refused_correction_is_never_taken():
    found, methods, *_ = case(35, 60, 2e-6)
    assert choose(SINGLE_STATION, methods, found, UNCERTAIN, EXPECTED, PLAUSIBLE).name == RAW
    assert choose("auto", methods[:1], None, None, EXPECTED, PLAUSIBLE).name == RAW


def test_interference_that_shows_widens_the_raw_azimuth_and_never_below_the_expected():
    calm, loud = case(35, 60, 0.0), case(35, 60, 2e-6)
    sigma = [math.sqrt(one[1][0].covariance[1, 1]) for one in (calm, loud)]
    assert sigma[1] > 3.0 * sigma[0]
    assert shown_variance(calm[0], EXPECTED**2, PLAUSIBLE**2) >= EXPECTED**2
    assert shown_variance(loud[0], EXPECTED**2, PLAUSIBLE**2) == pytest.approx(4e-12, rel=0.3)
    assert shown_variance(loud[0], EXPECTED**2, EXPECTED**2) == EXPECTED**2


@pytest.mark.parametrize("axial", [-40e-6, 40e-6])
def test_interference_as_strong_as_the_field_widens_the_raw_azimuth_by_what_it_turns_it(axial):
    # Along the horizontal field the slope of the azimuth is nothing, and it is turned right round.
    for azi in (0, 20, 90, 180):
        found, (plain, freed), *_ = case(60, azi, axial)
        assert abs(wrap_pi(plain.azimuth - azi * DEG)) < 1.2 * math.sqrt(plain.covariance[1, 1]) + 0.5 * DEG
        assert (
            choose("auto", [plain, freed], found, None, EXPECTED, PLAUSIBLE).name == SINGLE_STATION
            or abs(azi - 90) == 90
        )
    assert turned_variance(found, 0.0, EXPECTED, EXPECTED, EXPECTED**2) == 0.0


def test_a_correction_too_loose_to_be_trusted_is_still_taken_where_the_raw_azimuth_is_far_off():
    found, methods, *_ = case(89, 90, 20e-6)
    assert methods[1].covariance[1, 1] > (3.0 * DEG) ** 2
    assert choose("auto", methods, found, UNCERTAIN, EXPECTED, PLAUSIBLE).name == SINGLE_STATION
    assert choose("auto", methods, found, UNCERTAIN, EXPECTED, 30e-6).name == RAW


def test_horizontal_east_west_hides_interference_and_a_tangent_does_not():
    for inc, azi, expected in ((88, 90, True), (35, 60, False)):
        found, _, jacobian, spread = case(inc, azi, 0.0)
        assert hidden(found, jacobian, spread, EXPECTED, PLAUSIBLE) is expected
    found, _, jacobian, spread = case(88, 90, 0.0)
    assert not hidden(found, jacobian, spread, EXPECTED, EXPECTED)


def test_the_corrected_azimuth_shares_the_sensors_errors_with_inclination_and_toolface():
    found, methods, *_ = case(35, 60, 0.0)
    covariance = methods[1].covariance
    assert np.sqrt(covariance[1, 1]) == pytest.approx(float(found.sigma_azimuth))
    assert abs(covariance[0, 1]) > 0.0
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()
