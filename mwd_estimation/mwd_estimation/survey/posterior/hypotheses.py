# SPDX-License-Identifier: Apache-2.0
"""
Disturbances of a magnetic survey, and their probability before any reading.

Each disturbance that lasts over a run (field of the string, wrong reference, storm, defect of a sensor) is one of the
parallel filters, which differ only in the prior variances of the shared errors. A disturbance of one station (steel
outside the string) is a hypothesis of that station, with a field of any direction.
"""

from __future__ import annotations

import dataclasses
import math
from enum import StrEnum, unique

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.survey.posterior.field_model import Shared, Sigmas
from mwd_sensors.core.arrays import Array, Indices


@unique
class Hypothesis(StrEnum):
    """Disturbance of the readings, by the names of the survey message."""

    CLEAN = "clean"
    AXIAL = "axial"
    CROSS_AXIAL = "cross_axial"
    REFERENCE = "reference"
    PLACE = "place"
    SHIELDING = "shielding"
    SCALE = "scale"
    SENSOR = "sensor"
    EXTERNAL = "external"


@dataclasses.dataclass(frozen=True)
class Priors:
    """Probability of each disturbance before any reading; the remaining probability means no disturbance."""

    axial: float = 0.3  #: the string is magnetised along its axis beyond the tool code
    cross_axial: float = 0.06  #: a magnetised collar with a field across the axis
    #: The reference lacks a field of the crust or is of another place, or there is a magnetic storm.
    reference: float = 0.12
    #: A magnetometer with a wrong scale, one that magnetic mud or soft iron shields, or accelerometers turned in their
    #: mount.
    sensor: float = 0.015
    external: float = 0.05  #: steel outside the string (casing, fish, another well) at a station
    #: Steel turns the field about the vertical and keeps its total and dip: only a gyro shows this.
    turned: float = 0.003
    string_change: float = 0.005  #: the field of the string changes before a station without a known reason
    gyro_step: float = 0.01  #: the bias of a gyro steps by some of its sigmas before a station
    gyro_outlier: float = 0.004  #: the error of a gyro azimuth is much larger than its sigma
    gyro_adrift: float = 0.01  #: the azimuth error of the gyro drifts through the run: drift, wrong scale, freeze
    gyro_fails: float = 0.001  #: a gyro that was right so far begins to drift before a station


# Axial field of the string: 1 sigma, uT, and prior share of each size. Cross-axial field of the string: pairs of 1
# sigma along and across the axis, uT (0: that of the tool code); all pairs have the same share.
_AXIAL = {0.7: 0.4, 2.0: 0.3, 6.0: 0.15, 20.0: 0.1, 60.0: 0.05}
_CROSS = ((0.0, 0.25), (0.0, 0.7), (0.0, 2.0), (0.6, 0.35), (2.0, 1.0), (4.0, 2.0))
# A crustal field that the reference lacks: 1 sigma of each of its three components, uT, and the prior share of each
# size. The components have the same sigma, so a crustal field that shows in total and dip also makes the declination
# uncertain, although no reading shows the declination.
# Errors of geomagnetic models have heavier tails than a normal density (S. Macmillan, A. McKay, S. Grindrod,
# SPE/IADC 119851, 2009). With 0.5 uT alone the benchmark's row "field of the crust" has more than twice as many
# stations beyond 3 sigma.
_CRUST_UT = {0.4: 0.5, 1.0: 0.5}
_STORM_UT = (0.4, 0.4, 0.25)  # 1 sigma of the field of a magnetic storm: north, east, down, uT
# Reference of another place, for example by a mistyped longitude: 1 sigma of the errors of total, uT, dip, rad, and
# declination, rad; and the share of such references among the wrong ones. Errors of total and dip together can produce
# any field in the plane of the meridian, so slopes of first order are sufficient.
_PLACE, _PLACE_SHARE = {"TOTAL": 4.0, "DIP": math.radians(10.0), "DECLINATION": math.radians(8.0)}, 0.05
# 1 sigma of the scale error of defective or shielded magnetometers, and of the rotation of accelerometers in their
# mount, rad. Mud and soft iron can shield up to 3 % of the field across the axis, where the housing of the sensor is
# thin.
_DEFECT_SCALE, _DEFECT_MOUNT = 0.02, 0.025
# 1 sigma of each component of an external field, uT; the first means no external field.
EXTERNAL_UT = np.array([0.0, 0.3, 1.0, 3.0, 10.0])
# 1 sigma of a field turned about the vertical, rad.
TURNED = math.radians(15.0)
# A change of the string is more probable than `Priors.string_change` if a trip out of the hole and back fits into the
# gap between two stations: duration of a trip, h, and probability of a change in a much longer gap.
_TRIP_HOURS, _TRIPS = 12.0, 0.5
# Time in which the change of the string's field along the axis takes another value, h: in a day of drilling the field
# changes by its own size (`test_run_filter.py`). Without the change the benchmark's rows "remanence growing" have up to
# 8 % of the stations beyond 3 sigma.
RATE_HOURS = 4.0
# The azimuth error of a drifting gyro is a random walk: 1 sigma after an hour, rad. This covers a drift of 24 deg in
# half a day, and a frozen gyro in a hole that turns by 3 deg per stand of half an hour.
_ADRIFT = math.radians(4.0)
# Share of the varying external field that remains after an hour: the field of a storm is correlated over about 3 h.
_KEEPS = 0.72


@dataclasses.dataclass(frozen=True)
class Filters:
    """Parallel filters of the shared errors, with prior probabilities and variances."""

    kinds: tuple[Hypothesis, ...]
    weight: Array  #: shape (k,); prior probability
    variance: Array  #: shape (k, 23); prior variance of each shared error, in nominal variances
    adrift: NDArray[np.bool_]  #: shape (k,); whether the gyro drifts

    def of_string(self, adrift: bool) -> Indices:
        """Return the indices of the clean, axial and cross-axial filters; `adrift`: whether their gyro drifts."""
        strings = (Hypothesis.CLEAN, Hypothesis.AXIAL, Hypothesis.CROSS_AXIAL)
        return np.flatnonzero([kind in strings for kind in self.kinds] & (self.adrift == adrift))

    def with_gyro(self) -> Filters:
        """Return each filter twice: with a constant azimuth error of the gyro, and with a drifting one."""
        adrift = np.repeat([False, True], len(self.weight))
        return Filters(self.kinds * 2, np.tile(self.weight, 2), np.tile(self.variance, (2, 1)), adrift)


def filters(priors: Priors, sigmas: Sigmas) -> Filters:
    """Return the parallel filters of a run with these nominal sigmas."""
    sigma = sigmas.shared
    rows: list[tuple[Hypothesis, float, Array]] = []

    def add(kind: Hypothesis, weight: float, **sizes: float | tuple[float, ...]) -> None:
        variance = np.ones(Shared.SIZE)
        for name, size in sizes.items():
            begin = getattr(Shared, name)
            for j, one in enumerate(np.atleast_1d(size)):
                if one > 0.0 and sigma[begin + j] > 0.0:
                    variance[begin + j] = max((one / sigma[begin + j]) ** 2, 1.0)
        # A stronger field of the string changes faster.
        variance[Shared.FIELD_RATE] = variance[Shared.FIELD_BIAS]
        rows.append((kind, weight, variance))

    sound = 1.0 - priors.axial - priors.cross_axial - priors.reference - priors.sensor
    add(Hypothesis.CLEAN, max(sound, 0.01))
    for size, share in _AXIAL.items():
        add(Hypothesis.AXIAL, priors.axial * share, FIELD_BIAS=size)
    for along, across in _CROSS:
        add(Hypothesis.CROSS_AXIAL, priors.cross_axial / len(_CROSS), FIELD_BIAS=(along, across, across))
    near = 0.5 * (1.0 - _PLACE_SHARE) * priors.reference
    for size, share in _CRUST_UT.items():
        add(Hypothesis.REFERENCE, near * share, **dict(zip(_PLACE, (size * sigmas.by_ut).tolist(), strict=True)))
    add(Hypothesis.REFERENCE, near, OUTSIDE=_STORM_UT)
    add(Hypothesis.PLACE, _PLACE_SHARE * priors.reference, **_PLACE)
    add(Hypothesis.SHIELDING, priors.sensor / 3.0, FIELD_SCALE=(0.0, _DEFECT_SCALE, _DEFECT_SCALE))
    add(Hypothesis.SCALE, priors.sensor / 3.0, FIELD_SCALE=(_DEFECT_SCALE,) * 3)
    add(Hypothesis.SENSOR, priors.sensor / 3.0, MOUNT=(_DEFECT_MOUNT,) * 3)
    kinds, weights, variances = zip(*rows, strict=True)
    weight = np.array(weights)
    return Filters(tuple(kinds), weight / weight.sum(), np.array(variances), np.zeros(len(weight), dtype=bool))


def hazard(priors: Priors, hours: float) -> float:
    """
    Return the cumulative hazard of a change of the string; the probability of a change is 1 - exp(-hazard).

    hours: time between two stations, h; if it is unknown (NaN), no trip is assumed.
    """
    trip = _TRIPS * -math.expm1(-((hours / _TRIP_HOURS) ** 4)) if math.isfinite(hours) else 0.0
    return -math.log1p(-priors.string_change) - math.log1p(-trip)


def drifted(hours: float) -> float:
    """Return the variance that the azimuth error of a drifting gyro gains in a number of hours, rad^2."""
    return _ADRIFT**2 * hours


def kept(hours: float) -> float:
    """Return the share of the varying external field that remains after a number of hours."""
    return float(_KEEPS**hours)


def external_weights(priors: Priors) -> Array:
    """Return the prior probabilities of the external fields `EXTERNAL_UT` and, last, of a turned field, shape (6,)."""
    share = priors.external / (len(EXTERNAL_UT) - 1)
    return np.array([1.0 - priors.external - priors.turned, *[share] * (len(EXTERNAL_UT) - 1), priors.turned])
