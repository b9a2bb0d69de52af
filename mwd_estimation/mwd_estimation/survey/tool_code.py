"""
ISCWSA / OWSG tool codes: the industry's error model of a survey tool at an attitude.

The codes, their magnitudes and weighting functions are welleng's (checked against the ISCWSA's own example well);
they are read when first asked for. A code serves in two ways: `at_attitude` is the model's own sigma of inclination
and azimuth, and `sensor_errors` with `reference_sigmas` turn its magnitudes into the per-axis errors that `station`
propagates through the readings as they are, which gives the limits of total gravity, total field and dip as well.
"""

from __future__ import annotations

import difflib
import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.station import StationSettings
from mwd_estimation.survey.station_deviations import deviation_covariance
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY

# Errors of depth and of the hole's course between stations are not the station's.
_NOT_THE_STATION = ("DRF", "DSF", "DST", "XCL")
# Interval of the stations the model is evaluated for, m: above its 10 m no term depends on it.
_COURSE = 30.0
# Nearer to vertical the model's azimuth is replaced by that at this inclination.
_MIN_INCLINATION = math.radians(0.1)


@dataclass(frozen=True)
class AttitudeSigma:
    """1 sigma of a code at an attitude, rad (azimuth at most pi), and the covariance of both, shape (2, 2)."""

    inclination: float
    azimuth: float
    covariance: Array


def names() -> tuple[str, ...]:
    """Every tool code known, by short name; those ending in _Fl are for floating rigs."""
    from welleng.error import get_error_models

    return tuple(get_error_models())


def at_attitude(
    code: str,
    inclination: float,
    azimuth: float,
    reference: Reference,
    latitude: float = math.radians(60.0),
) -> AttitudeSigma:
    """
    Sigma of inclination and azimuth by the code's own weighting functions.

    Parameters
    ----------
    code : str
        Short name, such as "MWD+SRGM".
    inclination, azimuth : float
        rad; azimuth from true north.
    reference : Reference
        With a field; its own sigmas are not used, the code has its.
    latitude : float
        rad; only gyro codes depend on it.

    Returns
    -------
    AttitudeSigma

    Raises
    ------
    ValueError
        An unknown code (with near misses), a reference without field, or an attitude the code is not meant for.
    """
    _known(code)
    inclination = min(max(inclination, _MIN_INCLINATION), math.pi - _MIN_INCLINATION)
    terms = _survey(code, inclination, azimuth, reference, latitude).err.errors.errors
    covariance = np.zeros((2, 2))
    for name, term in terms.items():
        if not name.startswith(_NOT_THE_STATION):
            weight = np.asarray(term.e_DIA, dtype=float)[2, 1:]
            covariance += np.outer(weight, weight)
    sigma = np.sqrt(np.diagonal(covariance))
    return AttitudeSigma(float(sigma[0]), min(float(sigma[1]), math.pi), covariance)


def sensor_errors(code: str) -> SensorErrors:
    """
    Per-axis errors of a code's magnitudes; terms it lacks are zero.

    Raises ValueError for an unknown code, or for one without accelerometers and magnetometers (gyro, inclination only).
    """
    magnitude = _magnitudes(code)
    prefix = {
        term: f"{term[0]}{term[1]}I{term[2:]}" for term in ("ABXY", "ABZ", "ASXY", "ASZ", "MBXY", "MBZ", "MSXY", "MSZ")
    }

    def one(*terms: str) -> float:
        found = [
            magnitude[name] for term in terms for name in magnitude if name.startswith((term, prefix.get(term, term)))
        ]
        return max(found, default=0.0)

    if not one("ABXY") or not one("MBXY"):
        raise ValueError(f"code: {code} has no accelerometer and magnetometer terms: it is not a magnetic survey")
    return SensorErrors(
        accelerometer_bias_mps2=one("ABXY", "ABZ"),
        accelerometer_scale=one("ASXY", "ASZ"),
        magnetometer_bias_nt=one("MBXY", "MBZ"),
        magnetometer_scale=one("MSXY", "MSZ"),
        axial_interference_nt=one("AMIL"),
        misalignment_deg=math.degrees(one("XYM1")),
        course_misalignment_deg=math.degrees(one("XYM3")),
        sag_deg=math.degrees(one("SAG")),
    )


def reference_sigmas(code: str) -> dict[str, float]:
    """
    Sigmas of the field a code is used with, by the names `Reference` has for them.

    Strength and dip stand only in codes that correct by them (+AX); for another, those of its sibling that does are
    taken. Raises ValueError for an unknown code.
    """
    magnitude = _magnitudes(code)
    base = next((word for word in ("IFR2", "IFR1") if word in code), "SRGM")
    field = _magnitudes({"IFR2": "MWD+IFR2+AX+SAG", "IFR1": "MWD+IFR1+AX", "SRGM": "MWD+SRGM+AX"}[base])

    def together(terms: Mapping[str, float], start: str) -> float:
        return math.sqrt(sum(value**2 for name, value in terms.items() if name.startswith(start)))

    return {
        "sigma_total": together(field, "MFI") * 1e-9,
        "sigma_dip": together(field, "MDI"),
        "sigma_declination": together(magnitude, "DEC"),
        "sigma_declination_field": together(magnitude, "DBH") * 1e-9,
    }


def settings_for(code: str, settings: StationSettings | None = None) -> StationSettings:
    """Station settings with the sensors and alignment of a code, and limits by its covariance. ValueError as there."""
    settings = StationSettings() if settings is None else settings
    return replace(settings, errors=sensor_errors(code), quality=replace(settings.quality, limits="toolcode"))


def reference_for(code: str, reference: Reference) -> Reference:
    """The reference with the sigmas of the field model the code names. ValueError as `reference_sigmas`."""
    sigmas: dict[str, Any] = reference_sigmas(code)
    return replace(reference, **sigmas)


def quality_sigma(code: str, f_t: ArrayLike, b_t: ArrayLike, reference: Reference) -> Array:
    """
    1 sigma of (total gravity, total field, dip) of a code at this attitude, shape (3,): m/s^2, T, rad.

    f_t, b_t, shape (3,): m/s^2 and T, in tool axes; any readings near the expected ones serve. Raises ValueError as
    `sensor_errors`.
    """
    errors = sensor_errors(code)
    covariance = deviation_covariance(
        f_t,
        b_t,
        reference_for(code, reference),
        errors.covariance(f_t, b_t),
        errors.axial_interference_nt * 1e-9,
    )
    return np.asarray(np.sqrt(np.diagonal(covariance)))


def _known(code: str) -> None:
    known = names()
    if code not in known:
        near = difflib.get_close_matches(code, known, n=3, cutoff=0.4)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(known)}"
        raise ValueError(f"code: no tool code {code!r}; {hint}")


@functools.lru_cache(maxsize=64)
def _magnitudes(code: str) -> dict[str, float]:
    """Term -> magnitude, in m/s^2, nT, rad, rad nT and plain numbers, as the model file has them."""
    _known(code)
    reference = Reference(total=50e-6, dip=1.2, declination=0.0)
    model = _survey(code, math.radians(20.0), 1.0, reference, math.radians(60.0)).err.errors.em["codes"]
    return {name: float(term["magnitude"]) for name, term in model.items() if term.get("magnitude") is not None}


def _survey(code: str, inclination: float, azimuth: float, reference: Reference, latitude: float) -> Any:
    """Straight hole of three stations at one attitude, in welleng's terms."""
    from welleng.survey import Survey, SurveyHeader

    if reference.total is None or reference.dip is None:
        raise ValueError("reference: a tool code needs the strength and dip of the field")
    header = SurveyHeader(
        latitude=math.degrees(latitude),
        longitude=0.0,
        altitude=0.0,
        b_total=reference.total * 1e9,
        dip=math.degrees(reference.dip),
        declination=math.degrees(reference.declination or 0.0),
        convergence=0.0,
        G=STANDARD_GRAVITY if reference.gravity is None else reference.gravity,
        azi_reference="true",
    )
    depth = _COURSE * np.arange(4.0)
    try:
        return Survey(
            depth,
            np.full(4, math.degrees(inclination)),
            np.full(4, math.degrees(azimuth)),
            header=header,
            error_model=code,
        )
    except (AssertionError, ValueError, KeyError) as error:
        raise ValueError(
            f"code: {code} does not apply at inclination {math.degrees(inclination):.1f} deg: {error}"
        ) from error
