# SPDX-License-Identifier: Apache-2.0
"""A survey inside the estimator: mean readings, station, and conversion to the record that is published."""

from __future__ import annotations

import dataclasses
import math
import uuid
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import reason_text
from mwd_estimation.core.north import North
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.station_record import Station
from mwd_estimation.survey.survey import REFERENCE_FIELDS, STATIC, AzimuthEstimate, Survey, Verdict
from mwd_sensors.core.unknown import or_nan

# Namespace of the identifiers of surveys (RFC 4122, version 5). They depend on time and readings, so a survey has the
# same identifier in a replay, even if its number differs.
_SURVEYS = uuid.UUID("6b0d4f5e-6f0e-5c1b-9a55-3a5d2c1b7e10")


@dataclasses.dataclass(frozen=True)
class DecidedSurvey:
    """Result of the estimator for one survey. It is complete and does not change afterwards."""

    average: StillAverage  #: mean readings
    sequence: int  #: number of the survey, from 1
    station: Station  #: angles, totals, verdict with typed reasons; its azimuth is fused from all methods
    #: Share of each method in the azimuth of the station, 0 to 1.
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    kind: int = STATIC  #: STATIC, or ROTARY: taken while the string turned
    status: int = 0  #: bits of `core.status.Status` at the end of the averaging interval
    revision: int = 0  #: number of revisions by later stations and sensor faults; 0: as first published
    withdrawn: bool = False  #: True if a fault found later shows that one of its sensors was already faulty

    @property
    def stamp_ns(self) -> int:
        """Middle of the averaging interval, ns."""
        return (self.average.start_ns + self.average.end_ns) // 2

    @property
    def end_ns(self) -> int:
        """End of the averaging interval, ns."""
        return self.average.end_ns

    @property
    def uuid(self) -> str:
        """Identifier of the survey, computed from its time and readings."""
        return str(uuid.uuid5(_SURVEYS, f"{self.stamp_ns} {[float(v) for v in self.average.imu.mean]}"))

    def record(self, frame_id: str = "sonde_link") -> Survey:
        """Return the record that the estimator publishes; frame_id: frame of the tool axes."""
        average = self.average
        rates = average.precision if average.precision is not None else average.imu
        mag = np.full((3, 3), math.nan) if average.mag is None else average.mag.covariance
        return record_of(
            self.station,
            self.weights,
            stamp_ns=self.stamp_ns,
            frame_id=frame_id,
            uuid=self.uuid,
            sequence=self.sequence,
            kind=self.kind,
            requested=average.requested,
            duration=(average.end_ns - average.start_ns) * 1e-9,
            samples=average.imu.count,
            specific_force_covariance=_numbers(average.imu.covariance[3:, 3:]),
            magnetic_field_covariance=_numbers(mag),
            angular_rate=_numbers(rates.mean[:3]),
            temperature=math.nan if average.temperature is None else average.temperature,
            status=self.status,
            revision=self.revision,
            withdrawn=self.withdrawn,
        )


def record_of(station: Station, weights: Mapping[str, float], **about: Any) -> Survey:
    """
    Return the record of a station.

    Parameters
    ----------
    weights : mapping of str to float
        Share of each method of the station in its azimuth.
    **about
        Other fields of the record: time, identifier and number of the survey, and noise of the readings.
    """
    north, reference = North[station.north.upper()], station.reference
    covariance = np.array(station.covariance, dtype=float)
    covariance[:, ~np.isfinite([station.inclination, station.azimuth, station.gravity_toolface])] = math.nan
    covariance[np.isnan(covariance.T)] = math.nan
    off, limits, verdicts = station.deviations, station.limits, station.verdicts
    azimuths = tuple(
        AzimuthEstimate(
            method=str(one.method),
            north=int(north),
            azimuth=float(one.azimuth),
            sigma=float(one.sigma),
            weight=weights.get(one.method, 0.0),
            reason="" if one.refused is None else reason_text.text(one.refused),
        )
        for one in station.azimuths
    )
    numbers: dict[str, Any] = {
        "inclination": station.inclination,
        "azimuth": station.azimuth,
        "gravity_toolface": station.gravity_toolface,
        "magnetic_toolface": station.magnetic_toolface,
        "g_total": station.g_total,
        "b_total": station.b_total,
        "dip": station.dip,
        "axial_interference": station.interference,
        "sigma_axial_interference": station.sigma_interference,
        **dict(zip(("g_deviation", "b_deviation", "dip_deviation"), (off.gravity, off.field, off.dip), strict=True)),
        **dict(zip(("g_limit", "b_limit", "dip_limit"), limits, strict=True)),
    }
    if reference is not None:
        numbers |= {field: or_nan(getattr(reference, name)) for name, field in REFERENCE_FIELDS.items()}
    return Survey(
        specific_force=_numbers(station.f_t),
        magnetic_field=_numbers(station.b_t),
        covariance=_numbers(covariance),
        north=int(north),
        azimuth_method=str(station.method),
        azimuths=azimuths,
        reference_source="" if reference is None else reference.source,
        verdict=_code(station.verdict),
        verdict_inclination=_code(verdicts.inclination),
        verdict_azimuth=_code(verdicts.azimuth),
        verdict_toolface=_code(verdicts.toolface),
        headline="" if station.headline is None else reason_text.text(station.headline),
        reasons=tuple(reason_text.texts(station.reasons)),
        alternatives=_numbers([azimuth for azimuth, _ in station.alternatives]),
        alternative_odds=_numbers([odds for _, odds in station.alternatives]),
        hypotheses=tuple(str(name) for name, _ in station.hypotheses),
        hypothesis_odds=_numbers([odds for _, odds in station.hypotheses]),
        **{name: float(value) for name, value in numbers.items()} | about,
    )


def _code(verdict: str) -> int:
    return int(Verdict[verdict.upper()])


def _numbers(values: ArrayLike) -> Any:
    """Return the elements of an array in row order as a tuple."""
    return tuple(np.asarray(values, dtype=float).ravel().tolist())
