# SPDX-License-Identifier: Apache-2.0
"""
Reference magnetic field, gravity, Earth rotation and grid convergence at the rig.

The field comes from the World Magnetic Model (package pygeomag) or from the IGRF (package ppigrf). The two models
differ by tens of nT, which is a realistic size for the error of a global model at one place.
"""

from __future__ import annotations

import calendar
import dataclasses
import datetime
import functools
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import EARTH_RATE

# WGS 84 (NIMA TR8350.2): equatorial radius, m; flattening; GM, m^3/s^2; normal gravity at equator and pole, m/s^2;
# squared eccentricity; polar radius, m.
_RADIUS = 6378137.0
_FLATTENING = 1.0 / 298.257223563
_GM = 3.986004418e14
_GRAVITY_EQUATOR = 9.7803253359
_GRAVITY_POLE = 9.8321849378
_ECCENTRICITY_2 = _FLATTENING * (2.0 - _FLATTENING)
_POLAR_RADIUS = _RADIUS * (1.0 - _FLATTENING)
# Newtonian constant of gravitation, m^3/(kg s^2) (CODATA 2018).
_NEWTON = 6.6743e-11
_ROCK = 2670.0  # usual density of rock in the Poincare-Prey reduction, kg/m^3

MODELS = ("wmm2025", "igrf")
# First and last decimal year for which each model is valid.
_YEARS = {"wmm2025": (2025.0, 2030.0), "igrf": (1900.0, 2030.0)}


@dataclasses.dataclass(frozen=True)
class ReferenceField:
    """Reference gravity and magnetic field at one place and date."""

    total: float  #: strength of the magnetic field, T
    dip: float  #: dip of the field, positive below the horizontal, rad
    declination: float  #: angle from true north to magnetic north, rad, east positive
    #: Angle from true north to grid north, rad, east positive: grid azimuth = true azimuth - convergence.
    convergence: float
    gravity: float  #: gravity, m/s^2
    source: str  #: name of the model with its year, "measured" or "configured"

    @property
    def horizontal(self) -> float:
        """Horizontal component of the field, T."""
        return self.total * math.cos(self.dip)

    @property
    def vertical(self) -> float:
        """Downward component of the field, T."""
        return self.total * math.sin(self.dip)

    @property
    def field_n(self) -> Array:
        """Field in true north, east, down, T, shape (3,)."""
        return np.array(
            [
                self.horizontal * math.cos(self.declination),
                self.horizontal * math.sin(self.declination),
                self.vertical,
            ]
        )


def field_of(b_n: Array, convergence: float, gravity_mps2: float, source: str) -> ReferenceField:
    """
    Return the reference for a magnetic field and a gravity.

    b_n, shape (3,): field in true north, east, down, T. convergence in rad, gravity in m/s^2; source as in
    `ReferenceField`.
    """
    horizontal = math.hypot(b_n[0], b_n[1])
    return ReferenceField(
        total=math.hypot(horizontal, b_n[2]),
        dip=math.atan2(b_n[2], horizontal),
        declination=math.atan2(b_n[1], b_n[0]),
        convergence=convergence,
        gravity=gravity_mps2,
        source=source,
    )


def reference_field(
    lat: float, lon: float, height: float, date: datetime.date, model: str = "wmm2025"
) -> ReferenceField:
    """
    Return magnetic field, grid convergence (UTM) and gravity at one place and date.

    Parameters
    ----------
    lat, lon : float
        WGS 84, rad, north and east positive.
    height : float
        Height above the ellipsoid, m; negative below ground.
    date : datetime.date
        Date within the years of the model.
    model : str
        "wmm2025" (2025.0 to 2030.0) or "igrf" (IGRF-14, 1900 to 2030).

    Raises
    ------
    ValueError
        The model is unknown, latitude, longitude or height is out of range, or the date is outside the years of the
        model.
    """
    field = magnetic_field(lat, lon, height, date, model)
    return field_of(field, grid_convergence(lat, lon), gravity(lat, height), _SOURCES[model])


def magnetic_field(lat: float, lon: float, height: float, date: datetime.date, model: str = "wmm2025") -> Array:
    """
    Return the field of a global model in true north, east, down, T, shape (3,).

    Arguments and errors are those of `reference_field`. Source: WMM2025 technical report (NOAA/NCEI, BGS); IGRF-14
    (IAGA).
    """
    return field_at_year(lat, lon, height, decimal_year(date), model)


def field_at_year(lat: float, lon: float, height: float, year: float, model: str = "wmm2025") -> Array:
    """Return the field of `magnetic_field`, with the same errors, for a decimal year instead of a date."""
    if model not in MODELS:
        raise ValueError(f"model {model!r} is not known; choose one of {', '.join(MODELS)}")
    if not -math.pi / 2 <= lat <= math.pi / 2:
        raise ValueError(f"lat {lat:g} rad is off the Earth; latitudes are in rad, -pi/2 to pi/2")
    if not -math.tau <= lon <= math.tau:
        raise ValueError(f"lon {lon:g} rad is off the Earth; longitudes are in rad, -2 pi to 2 pi")
    if not -2.0e4 <= height <= 8.5e5:
        raise ValueError(f"height {height:g} m is outside the field models, -20000 to 850000 m")
    first, last = _YEARS[model]
    if not first <= year <= last:
        raise ValueError(
            f"date {year:.2f} is outside {model}, which is valid from {first:.1f} to {last:.1f}: set a day within these"
            " years, or give the field itself"
        )
    return _wmm(lat, lon, height, year) if model == "wmm2025" else _igrf(lat, lon, height, year)


def years(model: str) -> tuple[float, float]:
    """
    Return the first and last decimal year for which a model is valid.

    Raises
    ------
    ValueError
        The model is unknown.
    """
    if model not in MODELS:
        raise ValueError(f"model {model!r} is not known; choose one of {', '.join(MODELS)}")
    return _YEARS[model]


def decimal_year(date: datetime.date) -> float:
    """Return a date as a decimal year, for the start of the day."""
    start = datetime.date(date.year, 1, 1)
    days = 366 if calendar.isleap(date.year) else 365
    return date.year + (datetime.date(date.year, date.month, date.day) - start).days / days


def gravity(lat: float, height: float) -> float:
    """
    Return the magnitude of gravity, m/s^2, at a geodetic latitude, rad, and a height above the ellipsoid, m.

    Source: Somigliana's formula and free-air series, NIMA TR8350.2, section 4.2.
    """
    sin2 = math.sin(lat) ** 2
    ratio = height / _RADIUS
    return _normal_gravity(sin2) * (1.0 - 2.0 * _steepness(sin2) * ratio + 3.0 * ratio**2)


def gravity_gradient(lat: float) -> float:
    """
    Return the increase of gravity with depth below ground, m/s^2 per m, at a geodetic latitude, rad.

    It is the free-air gradient minus twice the pull of the slab of rock above the point (Poincare-Prey reduction).
    """
    sin2 = math.sin(lat) ** 2
    return 2.0 * _normal_gravity(sin2) * _steepness(sin2) / _RADIUS - 4.0 * math.pi * _NEWTON * _ROCK


def _normal_gravity(sin2: float) -> float:
    """Return Somigliana's gravity on the ellipsoid, m/s^2; sin2 is the squared sine of the geodetic latitude."""
    k = _POLAR_RADIUS * _GRAVITY_POLE / (_RADIUS * _GRAVITY_EQUATOR) - 1.0
    return _GRAVITY_EQUATOR * (1.0 + k * sin2) / math.sqrt(1.0 - _ECCENTRICITY_2 * sin2)


def _steepness(sin2: float) -> float:
    """Return the ratio of the free-air gradient to 2 gravity / radius; sin2 as in `_normal_gravity`."""
    m = EARTH_RATE**2 * _RADIUS**2 * _POLAR_RADIUS / _GM
    return 1.0 + _FLATTENING + m - 2.0 * _FLATTENING * sin2


def earth_rate_n(lat: float) -> Array:
    """Return the Earth's rotation in north, east, down, rad/s, shape (3,); lat in rad."""
    return np.array([EARTH_RATE * math.cos(lat), 0.0, -EARTH_RATE * math.sin(lat)])


def grid_convergence(lat: float, lon: float, crs: str | None = None) -> float:
    """
    Return the angle from true north to grid north, rad, east positive: grid azimuth = true azimuth - convergence.

    Parameters
    ----------
    lat, lon : float
        WGS 84, rad.
    crs : str, optional
        Projected coordinate system in a notation of pyproj ("EPSG:32652"); the default is the UTM zone of the place.

    Raises
    ------
    ValueError
        The system is unknown or not projected, or the place is far outside its area or has no convergence in the
        system.
    """
    return map_grid(lat, lon, crs).convergence


@dataclasses.dataclass(frozen=True)
class MapGrid:
    """Coordinates of a place in a map grid."""

    name: str  #: grid as the caller wrote it, or the EPSG code of the default grid
    #: `easting`, `northing`: coordinates in the grid, m.
    easting: float
    northing: float
    convergence: float  #: angle from true north to grid north, rad, east positive
    scale: float  #: distance on the map divided by distance on the ellipsoid


def map_grid(lat: float, lon: float, crs: str | None = None) -> MapGrid:
    """
    Return the coordinates of a place in a map grid; arguments and errors as for `grid_convergence`.

    For a grid on another datum the latitude and longitude are used unchanged. This ignores the shift between the
    datums, which can be several hundred metres.
    """
    return _map_grid(lat, lon, crs if crs is not None else utm_zone(lat, lon))


def geographic(crs: str, easting: ArrayLike, northing: ArrayLike) -> tuple[Array, Array]:
    """
    Return the latitudes and the longitudes, rad, shape (n,), of places in a map grid; the inverse of `map_grid`.

    Parameters
    ----------
    crs : str
        Grid, for example ``EPSG:23031``.
    easting, northing : array_like, shape (n,)
        Coordinates in the grid, m.

    Raises
    ------
    pyproj.exceptions.ProjError
        The grid is unknown.
    """
    import pyproj

    lon_deg, lat_deg = pyproj.Proj(crs)(np.asarray(easting, float), np.asarray(northing, float), inverse=True)
    return np.radians(lat_deg), np.radians(lon_deg)


def distance(lat: float, lon: float, other_lat: float, other_lon: float) -> float:
    """Return the distance between two places on the ellipsoid of WGS 84, m; all angles in rad."""
    import pyproj

    geodesic = pyproj.Geod(ellps="WGS84").inv(lon, lat, other_lon, other_lat, radians=True)
    return float(geodesic[2])


def utm_zone(lat: float, lon: float) -> str:
    """
    Return the EPSG code of the UTM zone, with the wider zones of south-western Norway and Svalbard; lat, lon in rad.

    North of 84 deg and south of -80 deg there is no UTM zone; there, return the code of the polar grid (UPS).

    Source: NGA.SIG.0012, The Universal Grids and the Transverse Mercator and Polar Stereographic Map Projections, 2014,
    section 7 (zone 32V, and 31X, 33X, 35X, 37X).
    """
    lat_deg, lon_deg = math.degrees(lat), (math.degrees(lon) + 180.0) % 360.0 - 180.0
    if not -80.0 <= lat_deg <= 84.0:
        return "EPSG:32661" if lat_deg > 0.0 else "EPSG:32761"
    zone = math.floor((lon_deg + 180.0) / 6.0) % 60 + 1
    if 56.0 <= lat_deg < 64.0 and 3.0 <= lon_deg < 12.0:
        zone = 32
    elif 72.0 <= lat_deg <= 84.0 and 0.0 <= lon_deg < 42.0:
        # Around Svalbard the zones 32, 34 and 36 do not exist; zones 31, 33, 35 and 37 meet at 9, 21 and 33 deg.
        zone = next(z for z, end in ((31, 9.0), (33, 21.0), (35, 33.0), (37, 42.0)) if lon_deg < end)
    return f"EPSG:{32600 + zone if lat >= 0.0 else 32700 + zone}"


# A grid may be used up to this distance outside its area, deg: wells next to a zone keep the grid of their oil field.
_BESIDE_DEG = 6.0
_SOURCES = {"wmm2025": "WMM2025 (pygeomag)", "igrf": "IGRF14 (ppigrf)"}


def _wmm(lat: float, lon: float, height: float, year: float) -> Array:
    # Imported here so that a process with its own reference field does not load the models.
    from pygeomag import GeoMag

    # The package documents heights from -1 km upwards; below that it evaluates the same series without a warning.
    result = GeoMag(coefficients_file="wmm/WMM_2025.COF").calculate(
        math.degrees(lat), math.degrees(lon), height / 1e3, year
    )
    return np.array([result.x, result.y, result.z]) * 1e-9


def _igrf(lat: float, lon: float, height: float, year: float) -> Array:
    import ppigrf

    whole = int(year)
    days = (datetime.date(whole + 1, 1, 1) - datetime.date(whole, 1, 1)).days
    # The package compares with dates without a time zone.
    date = datetime.datetime(whole, 1, 1) + datetime.timedelta((year - whole) * days)  # noqa: DTZ001
    east, north, up = ppigrf.igrf(math.degrees(lon), math.degrees(lat), height / 1e3, date)
    return np.array([np.ravel(north)[0], np.ravel(east)[0], -np.ravel(up)[0]]) * 1e-9


def _check_area(known: Any, crs: str, lat_deg: float, lon_deg: float) -> None:
    """Raise ValueError for a place more than `_BESIDE_DEG` outside the area of use that a grid states, if any."""
    area = known.area_of_use
    if area is None:
        return
    middle, half = 0.5 * (area.south + area.north), 0.5 * (area.north - area.south)
    width = (area.east - area.west) % 360.0 or 360.0
    off_east = abs(math.remainder(lon_deg - area.west - 0.5 * width, 360.0)) - 0.5 * width
    if max(off_east, abs(lat_deg - middle) - half) > _BESIDE_DEG:
        raise ValueError(
            f"crs {crs!r}: {known.name} is made for {area.west:.4g} to {area.east:.4g} deg east, {area.south:.4g} to "
            f"{area.north:.4g} deg north, and the place ({lat_deg:.2f}, {lon_deg:.2f}) lies far outside"
        )


@functools.lru_cache(maxsize=64)
def _map_grid(lat: float, lon: float, crs: str) -> MapGrid:
    import pyproj

    try:
        known = pyproj.CRS(crs)
    except pyproj.exceptions.ProjError as error:
        raise ValueError(f"crs {crs!r} is not known") from error
    if not known.is_projected:
        raise ValueError(f"crs {crs!r} is not a map grid: it has no easting and northing")
    _check_area(known, crs, math.degrees(lat), math.degrees(lon))
    try:
        grid = pyproj.Proj(known)
        factors = grid.get_factors(math.degrees(lon), math.degrees(lat), errcheck=True)
        easting, northing = grid(math.degrees(lon), math.degrees(lat), errcheck=True)
    except pyproj.exceptions.ProjError as error:
        raise ValueError(f"crs {crs!r} gives no grid convergence at this place: {error}") from error
    convergence = math.radians(factors.meridian_convergence)
    return MapGrid(crs, easting, northing, convergence, factors.meridional_scale)
