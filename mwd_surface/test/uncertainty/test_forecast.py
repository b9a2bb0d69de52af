# SPDX-License-Identifier: Apache-2.0
"""Forecasts: the tool code's own sigmas, the no-go directions of the correction, and the share accepted."""

import functools
import math

import numpy as np
import pytest

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey import tool_code
from mwd_estimation.survey.station import station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_sensors.core.frames import mat_nt
from mwd_surface.trajectory.plan import plan_of
from mwd_surface.uncertainty.forecast import corrected_sibling, correction_map, forecast
from tool_code_sigma import at_attitude

REFERENCE = Reference(
    total=50.5e-6,
    dip=math.radians(71.0),
    declination=math.radians(1.0),
    convergence=math.radians(-1.0),
    gravity=9.819,
)
LATITUDE = math.radians(59.0)
CODE = "MWD+IFR1+SAG"
# The share accepted is computed for each direction: no more of them than the properties need.
BUILD = (0.0, 30.0, 60.0, 90.0)


@functools.cache
def along(azimuth_deg, north="true", code=CODE, axial=0.0, inclinations_deg=BUILD):
    """Forecast of a plan with these inclinations every 30 m; nobody may change it."""
    count = len(inclinations_deg)
    azimuths = np.full(count, math.radians(azimuth_deg))
    plan = plan_of(30.0 * np.arange(count), np.radians(inclinations_deg), azimuths)
    return forecast(plan, north, code, REFERENCE, LATITUDE, axial=axial, most=math.radians(2.0))


@pytest.mark.slow
def test_sigmas_are_the_tool_codes_own_at_each_attitude():
    found = along(60.0)
    for k in (1, 2, 3):
        own = at_attitude(CODE, float(found.inclination[k]), float(found.true_azimuth[k]), REFERENCE, LATITUDE)
        assert found.sigma_inclination[k] == pytest.approx(own.inclination, rel=1e-6)
        assert found.sigma_azimuth[k] == pytest.approx(own.azimuth, rel=1e-6)
    assert np.isnan(found.sigma_azimuth[0])


@pytest.mark.slow
def test_the_correction_is_of_no_use_horizontal_east_west_and_of_use_north_south():
    east, south = along(90.0), along(180.0)
    assert not np.any(south.no_go)
    assert np.all(east.no_go[east.inclination > math.radians(85.0)])
    assert not np.any(east.no_go[east.inclination < math.radians(61.0)])
    assert south.sigma_corrected[-1] < math.radians(1.0)


@pytest.mark.slow
def test_azimuths_of_a_plan_are_turned_to_true_north():
    grid, magnetic = (along(90.0, north, inclinations_deg=(90.0, 90.0)) for north in ("grid", "magnetic"))
    assert math.degrees(grid.true_azimuth[-1]) == pytest.approx(89.0)
    assert math.degrees(magnetic.true_azimuth[-1]) == pytest.approx(91.0)
    without = Reference(total=50e-6, dip=1.2)
    plan = plan_of([0.0, 30.0], np.zeros(2), np.zeros(2))
    with pytest.raises(ValueError, match="azimuths from grid north need the convergence"):
        forecast(plan, "grid", CODE, without, LATITUDE, axial=0.0, most=0.05)


@pytest.mark.slow
def test_the_map_is_worst_where_the_hole_is_horizontal_east_west():
    azimuths, inclinations, sigmas = correction_map(CODE, REFERENCE, LATITUDE, (36, 10))
    k = np.unravel_index(np.nanargmax(sigmas[inclinations > 0.3]), sigmas[inclinations > 0.3].shape)
    assert abs(math.sin(azimuths[k[1]])) > 0.98
    assert inclinations[inclinations > 0.3][k[0]] == pytest.approx(math.radians(90.0))


@pytest.mark.parametrize(
    ("code", "sibling"),
    [
        ("MWD+IFR1+MS", "MWD+IFR1+AX"),
        ("MWD+SRGM+SAG", "MWD+SRGM+AX+SAG"),
        ("MWD+HRGM", "MWD+HRGM+AX"),
        ("EMS+SRGM", "EMS+SRGM+AX"),
        ("GYRO-NS", ""),
        ("BLIND", ""),
    ],
)
def test_codes_have_the_sibling_with_the_same_field_model(code, sibling):
    assert corrected_sibling(code) == sibling


def test_a_gyro_has_sigmas_but_no_limits():
    found = along(45.0, code="GYRO-NS", inclinations_deg=tuple(range(0, 61, 10)))
    assert np.all(np.isfinite(found.sigma_azimuth[1:]))
    assert not np.any(np.isfinite(found.limits))
    with pytest.raises(ValueError, match="GYRO-NS-CT gives no azimuth at"):
        along(90.0, code="GYRO-NS-CT")
    with pytest.raises(ValueError, match="no variant"):
        correction_map("GYRO-NS", REFERENCE, LATITUDE)


@pytest.mark.slow
@pytest.mark.parametrize("axial_nt", [pytest.param(0.0, marks=pytest.mark.nightly), 600.0])
def test_the_share_accepted_is_that_of_the_product_s_own_verdict(axial_nt):
    found = along(60.0, axial=axial_nt * 1e-9)
    errors, coded = tool_code.sensor_errors(CODE), tool_code.reference_for(CODE, REFERENCE)
    rng = np.random.default_rng(3)
    for k in (1, -1):
        accepted = 0
        for _ in range(100):
            mat = mat_nt(float(found.inclination[k]), float(found.true_azimuth[k]), rng.uniform(0.0, math.tau))
            total = REFERENCE.total + coded.sigma_total * rng.standard_normal()
            dip = REFERENCE.dip + coded.sigma_dip * rng.standard_normal()
            level = [math.cos(REFERENCE.declination), math.sin(REFERENCE.declination)]
            b_n = total * np.array([*(math.cos(dip) * np.array(level)), math.sin(dip)])
            f_t, b_t = mat.T @ [0.0, 0.0, -9.819], mat.T @ b_n
            draw = rng.standard_normal(6) * np.sqrt(np.diagonal(errors.covariance(f_t, b_t)))
            decided = station(
                f_t + draw[:3], b_t + draw[3:] + [axial_nt * 1e-9, 0.0, 0.0], coded, StationSettings(errors=errors)
            )
            accepted += decided.verdict == "accept"
        # Three sigma of the difference between a share of 100 random draws and a share of 32 evenly spread draws.
        assert float(found.accepted[k]) == pytest.approx(accepted / 100, abs=0.25)


@pytest.mark.slow
def test_fewer_stations_are_accepted_near_horizontal_towards_east_than_towards_north():
    """A single station near horizontal towards east cannot reveal the axial field of the drill string."""
    east, north = (along(azimuth, code="MWD+SRGM", inclinations_deg=(0.0, 90.0)) for azimuth in (90.0, 0.0))
    assert east.accepted[-1] < 0.5 < 0.9 < north.accepted[-1]
    assert east.accepted[0] == north.accepted[0] > 0.9
