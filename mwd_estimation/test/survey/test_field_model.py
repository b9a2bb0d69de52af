# SPDX-License-Identifier: Apache-2.0
"""What a magnetometer should read at an azimuth: exact for the truth, and its slopes against differences."""

import dataclasses
import math

import numpy as np
import pytest

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.posterior import field_model
from mwd_estimation.survey.posterior.field_model import SIZE, Shared
from mwd_sensors.core.frames import mat_nt

REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.2, gravity=9.81)
NOMINAL = field_model.nominal_sigmas(SensorErrors(), REFERENCE, False)
AZIMUTH = 2.2


def field_n(total=5e-5, dip=1.1, declination=0.2):
    horizontal = total * math.cos(dip)
    return np.array([horizontal * math.cos(declination), horizontal * math.sin(declination), total * math.sin(dip)])


def row(f_t, b_t):
    return field_model.geometry(f_t, b_t, np.zeros((6, 6)), REFERENCE, 0.2)[0]


def residual(f_t, b_t, angle=AZIMUTH):
    found, slopes = np.zeros(3), np.zeros((3, SIZE))
    field_model.predicted(angle, row(f_t, b_t), NOMINAL.shared, found, slopes, np.zeros((3, 3)))
    return found, slopes


def readings(inclination=0.9, toolface=0.4, **earth):
    mat_tn = mat_nt(inclination, AZIMUTH, toolface).T
    return mat_tn @ [0.0, 0.0, -9.81], mat_tn @ field_n(**earth)


@pytest.mark.parametrize("inclination", [0.05, 0.9, 1.5, 2.4])
def test_the_true_azimuth_leaves_no_residual_and_another_does(inclination):
    found, _ = residual(*readings(inclination))
    assert np.abs(found).max() < 1e-9
    assert np.abs(residual(*readings(inclination), AZIMUTH + 0.01)[0]).max() > 0.05


def test_the_slopes_are_those_of_readings_with_each_error():
    f_t, b_t = readings()
    slopes = residual(f_t, b_t)[1]
    small = 1e-3
    step = small * NOMINAL.shared
    for j in range(3):
        unit = np.eye(3)[j]
        for state, f_off, b_off in (
            (Shared.FIELD_BIAS + j, 0.0, unit * step[Shared.FIELD_BIAS + j] * 1e-6),
            (Shared.FIELD_SCALE + j, 0.0, unit * b_t * step[Shared.FIELD_SCALE + j]),
            (Shared.FORCE_BIAS + j, unit * step[Shared.FORCE_BIAS + j], 0.0),
            (Shared.FORCE_SCALE + j, unit * f_t * step[Shared.FORCE_SCALE + j], 0.0),
            (Shared.MOUNT + j, np.cross(unit, f_t) * step[Shared.MOUNT + j], 0.0),
        ):
            off = residual(f_t + f_off, b_t + b_off)[0]
            assert off == pytest.approx(slopes[:, state] * small, rel=2e-3, abs=1e-8), (state, j)


@pytest.mark.parametrize(
    ("state", "name", "factor"),
    [(Shared.TOTAL, "total", 1e-6), (Shared.DIP, "dip", 1.0)],
)
def test_the_slopes_by_the_reference_are_those_of_another_earth(state, name, factor):
    small = 1e-3
    earth = {"total": 5e-5, "dip": 1.1, "declination": 0.2}
    earth[name] += small * NOMINAL.shared[state] * factor
    off = residual(*readings(**earth))[0]
    assert off == pytest.approx(residual(*readings())[1][:, state] * small, rel=2e-3, abs=1e-8)


def test_residual_and_slopes_follow_from_three_angles():
    f_t, b_t = readings()
    parts, slopes, _ = field_model.expansion(row(f_t, b_t), NOMINAL.shared)
    for angle in (0.3, 2.0, 5.1):
        phi = field_model.basis(np.array(angle))
        found, own = residual(f_t, b_t, angle)
        assert (phi @ parts)[:3] == pytest.approx(found, abs=1e-9)
        assert np.tensordot(phi, slopes, axes=1)[:3] == pytest.approx(own, abs=1e-9)


def test_what_changes_from_station_to_station_is_part_of_the_reference_s_sigma():
    shared, own = NOMINAL.shared[Shared.TOTAL : Shared.OUTSIDE], NOMINAL.own
    whole = [REFERENCE.sigma_total * 1e6, REFERENCE.sigma_dip,
             math.sqrt(REFERENCE.declination_variance(REFERENCE.horizontal))]  # fmt: skip
    assert shared * np.hypot(1.0, own) == pytest.approx(whole)
    assert own[0] * shared[0] == pytest.approx(0.06)


def test_of_a_very_accurate_reference_only_half_of_the_variance_averages_out_over_the_stations():
    # A certificate may state a sigma below the usual change from station to station. If all of its error were of that
    # kind, many stations together would show the errors of the sensors as if the reference had none.
    accurate = dataclasses.replace(REFERENCE, sigma_total=1e-9, sigma_dip=1e-5)
    found = field_model.nominal_sigmas(SensorErrors(), accurate, False)
    np.testing.assert_allclose(found.own[:2], 1.0)
    np.testing.assert_allclose(found.shared[Shared.TOTAL : Shared.TOTAL + 2] ** 2, [0.5e-6, 0.5e-10])
