# SPDX-License-Identifier: Apache-2.0
"""The place of the well in the settings, and the reference of gravity and magnetic field derived from it."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import math
from typing import Any

from mwd_estimation.core.reference_field import Reference, Slip
from mwd_estimation.survey.posterior.field_model import DECLINATION_DEGNT, DIP_DEG, TOTAL_NT
from mwd_sensors.core import earth
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.core.settings import SettingsError, setting

# A field source whose name contains this text includes the external field at the time of the survey.
_IFR2 = "IFR2"
# Geomagnetic model for each word of `place.field`.
_MODELS = {"model": "wmm2025", "igrf": "igrf"}
# Lower and upper limit of the strength of the Earth's field, nT; the same limits as in `Reference`.
_WEAKEST_NT, _STRONGEST_NT = 5e3, 2e5
# _ANOMALY: largest difference between a fixed field and the model, T. Only ores such as those of Kursk and Kiruna cause
# a larger difference, close to the ore; elsewhere the crust causes a tenth of this value. _FAR_FROM_EQUATOR_DEG:
# smallest latitude at which the sign of the dip is certain, deg. _SAME_DEG: largest difference between the dip of the
# model and a dip whose mistake has been corrected, deg.
_ANOMALY, _FAR_FROM_EQUATOR_DEG, _SAME_DEG = 8e-6, 25.0, 10.0


@dataclasses.dataclass(frozen=True)
class Place:
    """Position of the well, and the Earth's field and gravity there."""

    field: str = setting(
        "none",
        "Source of the reference field: none (azimuth from magnetic north, no check of the field), model (the World "
        "Magnetic Model of 2025 to 2030, by position and date), igrf (the IGRF of 1900 to 2030, by position and date), "
        "fixed (total_nt, dip_deg and declination_deg, for example from an IFR or HDGM certificate). Without a "
        "reference field, surveys are neither checked against the field nor corrected.",
        choices=("none", *_MODELS, "fixed"),
    )
    lat_deg: float | None = setting(
        None,
        "Latitude, WGS 84, north positive. The gyro azimuth also needs the latitude, and with a fixed field gravity is "
        "computed from the latitude. nan: not given.",
        low=-90.0,
        high=90.0,
    )
    lon_deg: float | None = setting(None, "Longitude, WGS 84, east positive. nan: not given.", low=-180.0, high=360.0)
    height_m: float = setting(
        0.0, "Height above the ellipsoid. 1000 m change the field by 0.05 %.", low=-12000.0, high=9000.0, expert=True
    )
    grid: str = setting(
        "none",
        "Map grid of the well's plan: none, utm (the zone of the place) or an EPSG code such as EPSG:23031. The "
        "position then gives the convergence to grid north.",
        expert=True,
    )
    date: str = setting("", "Date for the field model, YYYY-MM-DD; empty: the day of the first sample.", expert=True)
    total_nt: float = setting(
        0.0, "Total strength of the fixed field; dip_deg must then also be set. 0: not given.", low=0.0, high=75000.0
    )
    dip_deg: float | None = setting(
        None, "Dip of the fixed field, positive below the horizontal; nan: not given.", low=-90.0, high=90.0
    )
    declination_deg: float | None = setting(
        None,
        "Declination of the fixed field: the angle from true north to magnetic north, east positive. nan: not given, "
        "azimuths stay magnetic.",
        low=-180.0,
        high=180.0,
    )
    source: str = setting(
        "",
        "Name of the field model from which the fixed field comes: IFR1, IFR2, HDGM or any other. If it is set, "
        "source_sigmas must be set too; they replace the sigmas of survey.tool_code. If it is empty, source_sigmas "
        "must be 0.",
        expert=True,
    )
    source_sigmas: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0),
        "1 sigma of total, dip and declination of the field named in `source`, from its certificate.",
        unit="nT, deg, deg",
        low=0.0,
        high=5000.0,
        expert=True,
    )
    convergence_deg: float | None = setting(
        None,
        "Grid convergence at the fixed field: the angle from true north to grid north, east positive. nan: no grid is "
        "given.",
        low=-180.0,
        high=180.0,
        expert=True,
    )
    observatory_file: str = setting(
        "",
        "File of a magnetic observatory near the well, IAGA-2002 format; empty: none. The disturbance of the field "
        "that the observatory measured at the time of a survey is added to the reference field; the file is read again "
        "when it has changed.",
        expert=True,
    )
    observatory_share: float = setting(
        0.2,
        "Difference between the disturbances at observatory and well, 1 sigma, as a share of the disturbance. Raising "
        "it widens the sigmas of surveys in a magnetic storm. Raise it with the distance and at auroral latitudes.",
        low=0.0,
        high=2.0,
        expert=True,
    )

    @property
    def model(self) -> str:
        """Name of the geomagnetic model in `earth.MODELS`; "" if the field does not come from a model."""
        return _MODELS.get(self.field, "")


def reference_of(place: Place, first_ns: int) -> Reference | None:
    """
    Return the reference field and gravity of a place; None if `place.field` is none.

    first_ns : stamp of the first sample, from which the date follows if no date is set.

    Raises
    ------
    ValueError
        If the set date is not a date or is outside the years of the model, or a model lacks the position. If a fixed
        field lacks strength or dip, is impossible at the position, or has a source without all sigmas, or sigmas
        without a source.
    """
    if place.field == "none":
        return None
    if place.field == "fixed":
        _check_with_place(place, first_ns)
        return _fixed(place)
    found = _of_model(place, first_ns)
    return dataclasses.replace(found, slips=_slips_of_place(place, first_ns))


def _check_with_place(place: Place, first_ns: int) -> None:
    """
    Refuse a fixed field that is impossible at the position, for example because of a wrong sign or unit of measurement.

    first_ns: stamp of the first sample, which gives the date. Without a latitude or a dip nothing is checked;
    without a longitude only the sign of the dip. A wrong declination makes surveys wrong by the same angle, and no
    measurement in the hole shows the error.

    Raises SettingsError if dip or declination are impossible; the message names the value at the position.
    """
    lat, dip = place.lat_deg, place.dip_deg
    if lat is None or dip is None:
        return
    way_out = "leave out the position if the field is not the Earth's"
    if place.lon_deg is None:
        if abs(lat) > _FAR_FROM_EQUATOR_DEG and lat * dip < 0.0:
            raise SettingsError(
                f"place.dip_deg: a dip of {dip:g} deg does not exist at latitude {lat:g}: dip is positive below the "
                f"horizontal, as it is north of the magnetic equator; give {-dip:g}, or {way_out}"
            )
        return
    try:
        model = _of_model(dataclasses.replace(place, field="igrf", grid="none", date=""), first_ns)
    except ValueError:
        # The stamp is outside the years of the model, so the clock is wrong and the field cannot be compared.
        return
    if model.total is None or model.dip is None or model.declination is None:
        return
    at, tolerance = f"at latitude {lat:g}, longitude {place.lon_deg:g}", _ANOMALY / model.horizontal
    expected_dip, expected = math.degrees(model.dip), math.degrees(model.declination)
    if abs(dip - expected_dip) > math.degrees(_ANOMALY / model.total):
        meant = {-dip: "its sign", math.degrees(dip): "radians", 90.0 - abs(dip): "its angle from the vertical"}
        fits = [f" ({meant[one]})" for one in meant if abs(one - expected_dip) < _SAME_DEG]
        raise SettingsError(
            f"place.dip_deg: a dip of {dip:g} deg does not exist {at}; it is {expected_dip:.1f} deg there"
            + "".join(fits[:1])
            + f": correct it, or {way_out}"
        )
    declination = place.declination_deg
    if declination is not None and abs(wrap_pi(math.radians(declination - expected))) > tolerance:
        raise SettingsError(
            f"place.declination_deg: a declination of {declination:g} deg does not exist {at}; it is {expected:.1f} "
            f"deg there: correct it, or {way_out}"
        )


def day_of(place: Place) -> datetime.date | None:
    """
    Return the date in `place.date`; None if this setting is empty.

    Raises
    ------
    SettingsError
        If the text is not a date.
    """
    try:
        return datetime.date.fromisoformat(place.date) if place.date else None
    except ValueError as error:
        raise SettingsError(f"place.date: {place.date!r} is not a day as YYYY-MM-DD") from error


def _of_model(place: Place, first_ns: int) -> Reference:
    """Return the reference of a geomagnetic model; errors as in `reference_of`."""
    day = day_of(place) or datetime.datetime.fromtimestamp(first_ns * 1e-9, tz=datetime.UTC).date()
    if place.lat_deg is None or place.lon_deg is None:
        raise SettingsError("place.field: a model needs the position; give place.lat_deg and place.lon_deg")
    lat, lon = math.radians(place.lat_deg), math.radians(place.lon_deg)
    field = earth.reference_field(lat, lon, place.height_m, day, place.model)
    return Reference(
        total=field.total,
        dip=field.dip,
        declination=field.declination,
        # Grid convergence needs the map grid of the well's plan, which the settings state.
        convergence=_convergence(place, lat, lon),
        gravity=field.gravity,
        source=field.source,
    )


def _slips_of_figures(total: float, dip_deg: float) -> tuple[Slip, ...]:
    """
    Return the field that a user may have meant if `dip_deg` is its angle from the vertical; total: strength, T.

    A dip of the wrong sign is not a slip: readings of sensors with flipped signs look the same (`DIP_SIGN`).
    """
    dip = 90.0 - dip_deg
    words = f"a dip of {dip:g} deg: {dip_deg:g} deg is its angle from the vertical"
    return (Slip(words, total, math.radians(dip)),) if dip <= 90.0 else ()


def _slips_of_place(place: Place, first_ns: int) -> tuple[Slip, ...]:
    """Return the fields at positions and dates that a user may have meant; first_ns: stamp of the first sample."""
    lat, lon = place.lat_deg or 0.0, place.lon_deg or 0.0
    places: dict[str, dict[str, Any]] = {
        f"latitude {-lat:g} instead of {lat:g}": {"lat_deg": -lat},
        f"longitude {-lon:g} instead of {lon:g}": {"lon_deg": -lon},
        f"latitude {-lat:g} and longitude {-lon:g}, both with the other sign": {"lat_deg": -lat, "lon_deg": -lon},
        f"latitude {lon:g} and longitude {lat:g}, which were exchanged": {"lat_deg": lon, "lon_deg": lat},
    }
    meant = {words: dataclasses.replace(place, **given) for words, given in places.items()}
    day = f"{datetime.datetime.fromtimestamp(first_ns * 1e-9, tz=datetime.UTC):%Y-%m-%d}"
    if place.date and day[:4] != place.date[:4] and first_ns > 0:
        for model in _MODELS:
            words = f"the day of the samples, {day}, instead of {place.date}"
            meant.setdefault(words, dataclasses.replace(place, date=day, field=model))
            with contextlib.suppress(ValueError):
                _of_model(meant[words], first_ns)
                break
            del meant[words]
    slips = []
    for words, other in meant.items():
        if abs(other.lat_deg or 0.0) > 90.0 or (other.lat_deg, other.lon_deg, other.date) == (lat, lon, place.date):
            continue
        # Omit the map grid: only the field is needed, and the other position may be outside the grid.
        with contextlib.suppress(ValueError):
            found = _of_model(dataclasses.replace(other, grid="none"), first_ns)
            slips.append(Slip(words, found.total or 0.0, found.dip or 0.0))
    return tuple(slips)


def _convergence(place: Place, lat: float, lon: float) -> float | None:
    if place.grid == "none":
        return None
    try:
        return earth.grid_convergence(lat, lon, None if place.grid == "utm" else place.grid)
    except ValueError as error:
        raise SettingsError(f"place.grid: write none, utm or an EPSG code; {error}") from error


def _fixed(place: Place) -> Reference:
    """Return the reference of a fixed field, whose figures the settings state; raise SettingsError if one is wrong."""
    if not place.total_nt > 0.0 or place.dip_deg is None:
        raise SettingsError("place.total_nt, place.dip_deg: a fixed field needs its strength and dip")
    if not _WEAKEST_NT < place.total_nt < _STRONGEST_NT:
        units = {"G": 1e5, "mG": 1e2, "uT": 1e3, "A/m": 1256.637}
        meant = [(unit, place.total_nt * size) for unit, size in units.items()]
        fits = [f"; {place.total_nt:g} {unit} are {nt:.0f} nT" for unit, nt in meant if 2e4 < nt < 7e4]
        raise SettingsError(
            f"place.total_nt: {place.total_nt:g} nT is outside the range of the Earth's field (20000 to 70000 nT)"
            + "".join(fits[:1])
        )
    reference = Reference(
        total=place.total_nt * 1e-9,
        dip=math.radians(place.dip_deg),
        declination=None if place.declination_deg is None else math.radians(place.declination_deg),
        convergence=None if place.convergence_deg is None else math.radians(place.convergence_deg),
        gravity=None if place.lat_deg is None else earth.gravity(math.radians(place.lat_deg), place.height_m),
        source=place.source or "configured",
        slips=_slips_of_figures(place.total_nt * 1e-9, place.dip_deg),
    )
    total_nt, dip_deg, declination_deg = place.source_sigmas
    if not place.source:
        if any(place.source_sigmas):
            raise SettingsError("place.source: name the field model that place.source_sigmas belong to")
        return reference
    if not all(place.source_sigmas):
        raise SettingsError(
            f"place.source_sigmas: a field of {place.source} needs total, dip and declination each with its sigma; "
            "take them from its certificate"
        )
    if dip_deg > 10.0 or declination_deg > 20.0:
        raise SettingsError(
            f"place.source_sigmas: {dip_deg:g} and {declination_deg:g} deg are not sigmas of dip and declination; the "
            "order is total (nT), dip (deg), declination (deg)"
        )
    # A certificate covers the fields of core and crust; only IFR2, with an observatory, covers the external field.
    outside = 0.0 if _IFR2 in place.source.upper() else 1.0
    return dataclasses.replace(
        reference,
        sigma_total=math.hypot(total_nt, outside * TOTAL_NT) * 1e-9,
        sigma_dip=math.radians(math.hypot(dip_deg, outside * DIP_DEG)),
        sigma_declination=math.radians(declination_deg),
        sigma_declination_field=math.radians(outside * DECLINATION_DEGNT) * 1e-9,
    )
