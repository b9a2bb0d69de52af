# SPDX-License-Identifier: Apache-2.0
"""Invariances of the position covariance: azimuths of vertical stations, norths, a turned map, runs, added stations."""

import dataclasses
import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_estimation.core.north import North
from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.trajectory.plan import plan_of
from mwd_surface.uncertainty.error_terms import RANDOM, ErrorReference, ErrorTool
from mwd_surface.uncertainty.forecast import error_reference, forecast
from mwd_surface.uncertainty.position_covariance import StationErrors, covariance_of, position_covariance, well_terms

pytestmark = pytest.mark.slow

REFERENCE = ErrorReference(math.radians(58), 51e-6, math.radians(71), math.radians(-2), math.radians(1.5))
MAGNETIC = (
    *("MWD+SRGM", "MWD+IFR2+SAG+MS", "EMS+SRGM+AX", "ISCWSA MWD Rev4"),
    *("MWD+HRGM+SAG", "INC-ONLY", "BLIND", "UNKNOWN"),
)
GYROS = ("GYRO-NS", "GYRO-MWD", "GYRO-NS-CT")
MD = np.arange(0.0, 901.0, 30.0)
# Vertical, a build, a drop and vertical again: azimuths are printed at both ends; INC-ONLY ends at 30 deg.
INC = np.radians(np.interp(MD, [0, 300, 500, 600, 750, 900], [0, 0, 28, 28, 0, 0]))
AZI = np.full(MD.size, math.radians(115.0))
VERTICAL = np.sin(INC) < 1e-9
azimuths = st.floats(0.0, 2.0 * math.pi)
bounded = settings(max_examples=settings().max_examples // 3, deadline=None)


def covariance(inc=INC, azi=AZI, code="MWD+SRGM", north=North.GRID, reference=REFERENCE, md=MD):
    return position_covariance(md, inc, azi, north, code, reference)


@functools.cache
def usual(code, north=North.GRID):
    """The covariance of the hole as it is listed."""
    return covariance(code=code, north=north)


def turned(cov, angle):
    """Turn covariances clockwise in the map, as azimuths grow."""
    c, s = math.cos(angle), math.sin(angle)
    mat = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return mat @ cov @ mat.T


def sigmas(cov):
    """Sigma in twelve horizontal directions and down, shape (13, n - 1)."""
    t = np.radians(np.arange(0.0, 180.0, 15.0))
    axes = np.vstack([np.column_stack([np.cos(t), np.sin(t), 0.0 * t]), [0.0, 0.0, 1.0]])
    return np.sqrt(np.einsum("di,kij,dj->dk", axes, cov, axes))[:, 1:]


@bounded
@given(
    printed=st.lists(azimuths, min_size=MD.size, max_size=MD.size),
    code=st.sampled_from(MAGNETIC + GYROS),
    north=st.sampled_from([North.GRID, North.TRUE, North.MAGNETIC]),
)
def test_the_azimuth_that_a_list_prints_at_vertical_stations_changes_no_covariance(printed, code, north):
    got = covariance(azi=np.where(VERTICAL, printed, AZI), code=code, north=north)
    np.testing.assert_array_equal(got, usual(code, north))


@pytest.mark.parametrize("code", MAGNETIC + GYROS)
def test_a_vertical_well_is_as_uncertain_in_every_direction_and_as_much_as_in_the_limit(code):
    """The sigma of SAGE grows with the fourth root of the inclination: at 1e-8 deg it is still 0.2 % of the whole."""
    vertical = covariance(0.0 * INC, code=code)
    spread = np.ptp(sigmas(vertical)[:-1], axis=0)
    assert np.all(spread < 1e-9 * sigmas(vertical)[0])
    for azimuth in np.radians(np.arange(0.0, 360.0, 40.0)):
        near = covariance(np.full(MD.size, math.radians(1e-8)), np.full(MD.size, azimuth), code)
        np.testing.assert_allclose(sigmas(near), sigmas(vertical), rtol=2e-3)


@pytest.mark.parametrize("code", MAGNETIC + GYROS)
def test_sigmas_are_continuous_in_inclination_through_the_vertical_at_every_azimuth(code):
    """
    From 0 to 0.02 deg sigmas grow by the sag of the code, whose weight sin^(1/4) is 0.14 there, and change little else.

    BLIND and UNKNOWN are all one error along the azimuth, which may cancel that of the hole below where both differ.
    """
    plain = sigmas(usual(code))
    for printed in np.radians(np.arange(0.0, 360.0, 45.0)):
        azi = np.where(VERTICAL, printed, AZI)
        ratio = [sigmas(covariance(np.where(VERTICAL, math.radians(i), INC), azi, code)) / plain for i in (1e-6, 0.02)]
        assert np.all(np.abs(ratio[0] - 1.0) < 0.012)
        assert ratio[1].min() > 0.97
        assert ratio[1].max() < 1.09


@bounded
@given(low=st.floats(0.0, 0.5), azimuth=azimuths, code=st.sampled_from(["MWD+SRGM", "GYRO-NS"]))
def test_a_small_change_of_a_steep_station_makes_a_small_change_of_sigma(low, azimuth, code):
    """Across the inclination from which its azimuth counts in full, too."""
    azi = np.where(VERTICAL, azimuth, AZI)
    one, other = (
        sigmas(covariance(np.where(VERTICAL, math.radians(low + step), INC), azi + step, code)) for step in (1e-4, 2e-4)
    )
    np.testing.assert_allclose(one, other, rtol=4e-3)


@bounded
@given(turn=st.floats(-1.0, 1.0), code=st.sampled_from(MAGNETIC + GYROS), printed=azimuths)
def test_the_covariance_turns_with_a_grid_that_is_turned(turn, code, printed):
    """Azimuths and convergence change together: the hole stays where it is."""
    other = dataclasses.replace(REFERENCE, convergence=REFERENCE.convergence + turn)
    got = covariance(azi=np.where(VERTICAL, printed, AZI - turn), code=code, reference=other)
    np.testing.assert_allclose(turned(got, turn), usual(code), rtol=1e-7, atol=1e-9)


@bounded
@given(turn=azimuths, code=st.sampled_from(MAGNETIC))
def test_the_covariance_of_a_magnetic_survey_turns_with_the_hole_and_the_field(turn, code):
    """
    Hole and magnetic north turned together in the map.

    It cannot hold for gyros, which seek the axis of the Earth.
    """
    other = dataclasses.replace(REFERENCE, declination=REFERENCE.declination + turn)
    got = covariance(azi=AZI + turn, code=code, north=North.TRUE, reference=other)
    want = usual(code, North.TRUE)
    np.testing.assert_allclose(got, turned(want, turn), rtol=1e-6, atol=1e-7 * np.abs(want).max())


@bounded
@given(cut=st.integers(1, MD.size - 1), printed=azimuths, code=st.sampled_from(["MWD+SRGM", "GYRO-NS", "BLIND"]))
def test_a_run_given_in_two_intervals_is_one_run(cut, printed, code):
    run = ErrorTool(code, "1")
    parts = StationErrors([ErrorTool(code, "1")] * cut + [run] * (MD.size - cut))
    got = position_covariance(MD, INC, np.where(VERTICAL, printed, AZI), North.GRID, parts, REFERENCE)
    np.testing.assert_allclose(got, usual(code), rtol=1e-12)


@bounded
@given(where=st.floats(31.0, 869.0), code=st.sampled_from(["MWD+SRGM", "BLIND", "INC-ONLY"]))
def test_a_station_put_on_the_arc_keeps_what_the_whole_run_errs(where, code):
    """
    Errors that a whole run shares depend on the hole, not on the number of stations.

    It cannot hold for random errors: two readings average them, so that more stations make a hole better known.
    """
    positions = mc.path(MD, INC, AZI)
    inc, azi, _ = mc.interpolate(MD, INC, AZI, positions, where)
    k = int(np.searchsorted(MD, where))
    if np.min(np.abs(MD - where)) < 1.0:
        return
    more = [np.insert(row, k, one) for row, one in ((MD, where), (INC, inc), (AZI, azi))]

    def shared(stations):
        terms = well_terms(tuple(stations), North.GRID, StationErrors([ErrorTool(code)] * stations[0].size), REFERENCE)
        return covariance_of([t for t in terms if t.shared != RANDOM], stations[0].size)[-1]

    np.testing.assert_allclose(np.sqrt(np.diag(shared(more))), np.sqrt(np.diag(shared([MD, INC, AZI]))), rtol=6e-3)


@bounded
@given(printed=st.lists(azimuths, min_size=MD.size, max_size=MD.size), sigma=st.floats(1e-3, 0.02))
def test_own_sigmas_of_vertical_stations_do_not_depend_on_their_azimuth(printed, sigma):
    """The inclination's sigma of a vertical station is that of its direction, along and across any azimuth."""
    own = StationErrors([ErrorTool("MWD+SRGM", "1")] * MD.size, np.full((MD.size, 2), [sigma, math.pi]))
    got = position_covariance(MD, 0.0 * INC, printed, North.GRID, own, REFERENCE)
    want = position_covariance(MD, 0.0 * INC, 0.0 * AZI, North.GRID, own, REFERENCE)
    np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-15)
    # All but the upper half of the first interval, which belongs to the given first station, and the hole's course.
    assert math.sqrt(got[-1, 0, 0]) == pytest.approx(sigma * MD[-1], rel=0.03, abs=0.2)
    assert got[-1, 1, 1] == pytest.approx(got[-1, 0, 0])


@functools.cache
def forecast_with(printed):
    """The fields of the forecast of a plan with these azimuths at its vertical stations."""
    field = Reference(total=51e-6, dip=1.2, declination=-0.03, convergence=0.02)
    assert error_reference(field, 1.0).b_total == 51e-6
    plan = plan_of([0.0, 30.0, 60.0], np.array([0.0, 0.0, 0.9]), [*printed, 2.0])
    one = forecast(plan, "grid", "MWD+SRGM", field, 1.0, 2e-7, 0.02)
    return [getattr(one, f.name) for f in dataclasses.fields(one)]


@settings(max_examples=2, deadline=None)
@given(printed=st.tuples(azimuths, azimuths))
def test_a_forecast_does_not_depend_on_the_azimuth_of_a_vertical_plan(printed):
    for one, other in zip(forecast_with((2.0, 2.0)), forecast_with(printed), strict=True):
        np.testing.assert_array_equal(one, other)
