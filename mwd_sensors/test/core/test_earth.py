# SPDX-License-Identifier: Apache-2.0
"""Earth: the authorities' tables, two models against each other, gravity and rotation by their definitions."""

from __future__ import annotations

import datetime
import math

import numpy as np
import pyproj
import pytest
from numpy.testing import assert_allclose

from mwd_sensors.core import earth
from mwd_sensors.core.constants import EARTH_RATE
from project import REFERENCE_DATA

TABLE = REFERENCE_DATA / "authorities" / "WMM2025_TEST_VALUES.txt"
DATE = datetime.date(2026, 3, 1)


def rows():
    return np.loadtxt(TABLE)


@pytest.mark.fault_case(37)
def test_wmm2025_reproduces_every_test_value_of_its_authors():
    for year, km, lat, lon, _, _, _, x, y, z, total, *_ in rows():
        got = earth.field_at_year(math.radians(lat), math.radians(lon), km * 1e3, year)
        # The table prints 1e-6 nT; the package keeps that.
        assert_allclose(got * 1e9, [x, y, z], atol=2e-5)
        # Its totals differ from its own components by up to 3e-4 nT.
        assert np.linalg.norm(got) * 1e9 == pytest.approx(total, abs=5e-4)


@pytest.mark.slow
@pytest.mark.fault_case(37)
def test_igrf_agrees_with_wmm2025_to_what_global_models_leave_open():
    off = []
    for year, km, lat, lon, *_ in rows():
        place = math.radians(lat), math.radians(lon), km * 1e3, year
        off.append(earth.field_at_year(*place, model="igrf") - earth.field_at_year(*place))
    off_nt = np.linalg.norm(off, axis=1) * 1e9
    assert np.sqrt(np.mean(off_nt**2)) < 60.0
    assert off_nt.max() < 150.0


@pytest.mark.fault_case(36)
@pytest.mark.parametrize("model", ["wmm2025", "igrf"])
def test_a_date_outside_the_model_is_refused(model):
    for date in (datetime.date(2031, 1, 1), datetime.date(1899, 12, 31), datetime.date.max, datetime.date.min):
        with pytest.raises(ValueError, match="valid from"):
            earth.reference_field(0.6, 1.9, 0.0, date, model)


def test_degrees_given_as_radians_and_unknown_models_are_refused():
    with pytest.raises(ValueError, match="rad"):
        earth.reference_field(38.0, 1.9, 0.0, DATE)
    with pytest.raises(ValueError, match="rad"):
        earth.reference_field(0.6, 109.0, 0.0, DATE)
    with pytest.raises(ValueError, match="wmm2025, igrf"):
        earth.reference_field(0.6, 1.9, 0.0, DATE, "emm")
    with pytest.raises(ValueError, match="height"):
        earth.reference_field(0.6, 1.9, 1e7, DATE)


def test_a_reference_gives_back_its_field():
    b_n = earth.magnetic_field(0.7, 0.1, 50.0, DATE)
    reference = earth.reference_field(0.7, 0.1, 50.0, DATE)
    assert_allclose(reference.field_n, b_n, atol=1e-18)
    assert reference.horizontal == pytest.approx(math.hypot(b_n[0], b_n[1]))
    assert reference.vertical == pytest.approx(b_n[2])
    assert "WMM2025" in reference.source


def test_decimal_years_know_leap_years():
    assert earth.decimal_year(datetime.date(2028, 7, 1)) == pytest.approx(2028 + 182 / 366)
    assert earth.decimal_year(datetime.datetime(2026, 1, 1, 12, tzinfo=datetime.UTC)) == 2026.0


# Normal gravity at the ellipsoid, NIMA TR8350.2 table 3.4; at 45 deg by Somigliana's closed form.
@pytest.mark.parametrize(
    ("lat_deg", "expected"), [(0.0, 9.7803253359), (45.0, 9.8061977694), (90.0, 9.8321849378), (-45.0, 9.8061977694)]
)
def test_gravity_on_the_ellipsoid(lat_deg, expected):
    assert earth.gravity(math.radians(lat_deg), 0.0) == pytest.approx(expected, abs=2e-9)


def test_gravity_falls_in_air_and_grows_below_ground():
    here = earth.gravity(0.8, 0.0)
    assert earth.gravity(0.8, 1000.0) - here == pytest.approx(-3.086e-3, rel=2e-3)
    # Poincare-Prey: 0.3086 - 2 x 0.1119 mGal/m for rock of 2670 kg/m^3.
    assert 1000.0 * earth.gravity_gradient(0.8) == pytest.approx(0.848e-3, rel=0.01)


def test_earth_rate_points_north_and_down_by_the_latitude():
    assert_allclose(earth.earth_rate_n(0.0), [EARTH_RATE, 0.0, 0.0])
    assert_allclose(earth.earth_rate_n(math.pi / 2), [0.0, 0.0, -EARTH_RATE], atol=1e-20)
    sidereal_day = 86164.0905
    assert 2.0 * math.pi / EARTH_RATE == pytest.approx(sidereal_day, abs=0.2)


def test_grid_north_leans_towards_the_central_meridian():
    lat, lon = math.radians(45.0), math.radians(110.0)
    # Zone 49, central meridian 111 E: tan(convergence) = tan(dlon) sin(lat) on the sphere.
    expected = math.atan(math.tan(math.radians(-1.0)) * math.sin(lat))
    assert earth.grid_convergence(lat, lon) == pytest.approx(expected, rel=1e-4)
    assert earth.grid_convergence(lat, math.radians(112.0)) == pytest.approx(-expected, rel=1e-4)
    assert earth.grid_convergence(lat, lon, "EPSG:32649") == earth.grid_convergence(lat, lon)
    # South of the equator the sign turns.
    assert earth.grid_convergence(-lat, lon) == pytest.approx(-expected, rel=1e-4)


def test_an_unknown_grid_is_refused():
    with pytest.raises(ValueError, match=r"^crs .EPSG:1. is not known$"):
        earth.grid_convergence(0.7, 1.9, "EPSG:1")


def test_a_grid_is_made_once_for_a_place(monkeypatch):
    made, make = [], pyproj.Proj
    monkeypatch.setattr(pyproj, "Proj", lambda crs: made.append(crs) or make(crs))
    lat, lon = math.radians(38.3), math.radians(109.61)
    found = {earth.grid_convergence(lat, lon, "EPSG:32649") for _ in range(3)}
    assert (len(found), len(made)) == (1, 1)


def test_a_grid_of_another_part_of_the_earth_is_refused():
    """UTM zone 31 at 9 deg east is the grid of a field beside it; at 109.6 deg it is a mistake."""
    assert earth.grid_convergence(math.radians(58.0), math.radians(9.0), "EPSG:23031") > 0.0
    for lat_deg, lon_deg in ((38.3, 109.6), (-30.0, 3.0), (58.0, -170.0)):
        with pytest.raises(ValueError, match=r"ED50 / UTM zone 31N is made for .* far outside"):
            earth.grid_convergence(math.radians(lat_deg), math.radians(lon_deg), "EPSG:23031")
    # Across the date line.
    assert math.isfinite(earth.grid_convergence(math.radians(-17.0), math.radians(-179.5), "EPSG:3460"))


@pytest.mark.parametrize(
    ("lon_deg", "lat_deg", "zone"),
    [
        (-180.0, 1.0, 32601),
        (2.9, 60.0, 32631),
        (180.0, -5.0, 32701),
        # Wider zones: south-western Norway and Svalbard.
        (5.3, 60.4, 32632),
        (3.0, 64.0, 32631),
        (8.9, 78.0, 32631),
        (15.6, 78.2, 32633),
        (33.0, 80.0, 32637),
        (-1.0, 78.0, 32630),
        (365.3, 60.4, 32632),
        # The polar grids, beyond every zone.
        (109.0, 85.5, 32661),
        (-40.0, 90.0, 32661),
        (20.0, -90.0, 32761),
    ],
)
def test_utm_zones_go_round_the_earth(lon_deg, lat_deg, zone):
    assert earth.utm_zone(math.radians(lat_deg), math.radians(lon_deg)) == f"EPSG:{zone}"


def test_a_minute_of_latitude_is_a_nautical_mile():
    lat, minute = math.radians(45.0), math.radians(1.0 / 60.0)
    assert earth.distance(lat, 1.0, lat + minute, 1.0) == pytest.approx(1852.0, abs=2.0)


def test_a_place_has_coordinates_and_scale_in_its_map_grid():
    """On the central meridian easting is 500 km and the scale 0.9996; the equator has northing 0."""
    at = earth.map_grid(0.0, math.radians(3.0))
    assert at.name == "EPSG:32631"
    assert (at.easting, at.northing) == (pytest.approx(500e3, abs=1e-3), pytest.approx(0.0, abs=1e-3))
    assert (at.scale, at.convergence) == (pytest.approx(0.9996), pytest.approx(0.0, abs=1e-9))
    # Three degrees away the scale is larger: k0 (1 + cos^2(lat) dlon^2 / 2).
    away = earth.map_grid(math.radians(60.0), math.radians(2.9), "EPSG:32630")
    assert away.scale == pytest.approx(0.9996 * (1.0 + 0.25 * math.radians(5.9) ** 2 / 2.0), abs=2e-5)
    with pytest.raises(ValueError, match="is not a map grid"):
        earth.map_grid(0.7, 1.9, "EPSG:4326")
