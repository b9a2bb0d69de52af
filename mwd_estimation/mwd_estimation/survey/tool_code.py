# SPDX-License-Identifier: Apache-2.0
"""
ISCWSA / OWSG tool codes: the industry's error models of survey tools.

The codes and their magnitudes come from welleng (checked against the example well of the ISCWSA); they are read when
first needed. `sensor_errors` and `reference_sigmas` convert the magnitudes of a code to errors of each axis and sigmas
of the reference field. A station propagates these through its readings to its sigmas, and to the limits of total
gravity, total field and dip.
"""

from __future__ import annotations

import difflib
import functools
import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core.constants import STANDARD_GRAVITY

# Name in tool codes for each common name of a geomagnetic model: OWSG set B, high and low resolution.
_MODELS = {"HDGM": "HRGM", "MVHD": "HRGM", "WMM": "LRGM", "IGRF": "LRGM"}
# For each field model in a code's name, the code whose terms have the sigmas of strength and dip of this model.
_WITH_FIELD = {
    "IFR2": "MWD+IFR2+AX+SAG",
    "IFR1": "MWD+IFR1+AX",
    "HRGM": "MWD+HRGM+AX",
    "LRGM": "MWD+LRGM+AX",
    "SRGM": "MWD+SRGM+AX",
}


def names() -> tuple[str, ...]:
    """
    Return the short names of all known tool codes: OWSG sets A and B with gyros, and the examples of the ISCWSA.

    Codes that end in _Fl are for floating rigs.
    """
    return (*_index(), *_set_b())


def check(code: str) -> None:
    """Raise ValueError for a code that does not exist; the message lists similar names."""
    if code in names():
        return
    meant = code
    for model, called in _MODELS.items():
        meant = meant.replace(model, called)
    near = difflib.get_close_matches(meant, names(), n=3, cutoff=0.4) or names()[:3]
    raise ValueError(f"no tool code {code!r}; did you mean {' or '.join(near)}?")


def model(code: str) -> Any:
    """Return the error model of a code for welleng: the name of the code, or its table if welleng's index lacks it."""
    return _set_b().get(code, code)


def folder() -> Path:
    """Return the folder in which welleng keeps the files of its codes, ``SET/CODE.json``."""
    import welleng

    return Path(str(welleng.__file__)).parent / "errors" / "iscwsa_json"


def _index() -> list[str]:
    """Return the short names in welleng's index, which is loaded once; `get_error_models` reads a file at each call."""
    from welleng.error import ERROR_MODELS

    return list(ERROR_MODELS)


@functools.cache
def _set_b() -> dict[str, Any]:
    """Return the models for which welleng has files but no entry in its index: OWSG set B, by short name."""
    known = set(_index())
    models = {}
    for file in sorted(folder().glob("*/*.json")):
        table = json.loads(file.read_text(encoding="utf-8"))
        if file.stem not in known and table["metadata"].get("short_name") not in known:
            models[file.stem] = table
    return models


def sensor_errors(code: str) -> SensorErrors:
    """
    Return the errors of each axis from the magnitudes of a code; terms that the code lacks are zero.

    Raises ValueError for an unknown code, or a code without accelerometers and magnetometers (gyro, inclination only).
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
    Return the sigmas of the reference field with which a code is used, by their names in `Reference`.

    Only codes that correct by strength and dip (+AX) state the sigmas of strength and dip. Any other code gets the
    sigmas of the related +AX code. Raises ValueError for an unknown code.
    """
    magnitude = _magnitudes(code)
    field = _magnitudes(_WITH_FIELD[next((word for word in _WITH_FIELD if word in code), "SRGM")])

    def together(terms: Mapping[str, float], start: str) -> float:
        return math.sqrt(sum(value**2 for name, value in terms.items() if name.startswith(start)))

    return {
        "sigma_total": together(field, "MFI") * 1e-9,
        "sigma_dip": together(field, "MDI"),
        "sigma_declination": together(magnitude, "DEC"),
        "sigma_declination_field": together(magnitude, "DBH") * 1e-9,
    }


def reference_for(code: str, reference: Reference) -> Reference:
    """Return the reference with the sigmas of the code's field model; raise ValueError as `reference_sigmas`."""
    sigmas: dict[str, Any] = reference_sigmas(code)
    return replace(reference, **sigmas)


@functools.lru_cache(maxsize=64)
def _magnitudes(code: str) -> dict[str, float]:
    """Return the magnitude of each term, in m/s^2, nT, rad, rad nT and plain numbers."""
    from welleng.survey import Survey, SurveyHeader

    check(code)
    # Use an arbitrary hole: the magnitudes of a code are the same for every hole.
    header = SurveyHeader(
        latitude=60.0,
        longitude=0.0,
        altitude=0.0,
        b_total=50e3,
        dip=69.0,
        declination=0.0,
        convergence=0.0,
        G=STANDARD_GRAVITY,
        azi_reference="true",
    )
    hole = Survey(30.0 * np.arange(4.0), np.full(4, 20.0), np.full(4, 60.0), header=header, error_model=model(code))
    # Most model files have rad; later issues have degrees, which are converted here.
    factors = {"deg": math.radians(1.0), "deg.nT": math.radians(1.0)}
    return {
        name: float(term["magnitude"]) * factors.get(term.get("unit"), 1.0)
        for name, term in hole.err.errors.em["codes"].items()
        if term.get("magnitude") is not None
    }
