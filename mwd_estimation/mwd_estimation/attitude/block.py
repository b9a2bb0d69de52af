# SPDX-License-Identifier: Apache-2.0
"""What the attitude stream is given with a block of samples: the samples, the field model in force, and bin events."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from mwd_estimation.attitude.time_alignment_state import FieldModel
from mwd_sensors.core.arrays import Array, Samples


@dataclasses.dataclass(frozen=True)
class Block:
    """Samples of the AHRS with the gravity followed through them, and what is wrong with all of them."""

    samples: Samples  #: dtype `sample.SAMPLE`, shape (n,)
    unusable: int = 0  #: sensors known to be faulty throughout the block, bits of `core.sensor_fault`
    contaminated: bool = False  #: whether the azimuth has taken in wrong values of a faulty sensor


@dataclasses.dataclass(frozen=True)
class StationUpdate:
    """What the continuous estimate takes over from a station."""

    #: (ndarray (8,), ndarray (8, 8)) or None; state and covariance of the interference filter, by many stations
    #: together, to go on from.
    interference: tuple[Array, Array] | None
    #: `down`, `field`: shape (3,); unit vector down and field, T, of the station.
    down: Array
    field: Array
    #: `azimuth`, `sigma`: from magnetic north, rad, by a gyro; nan where there is none.
    azimuth: float = math.nan
    sigma: float = math.nan
    accepted: bool = False  #: whether the station passed its checks
    axial: tuple[float, float] = (0.0, 0.0)  #: axial interference that it was corrected for, and 1 sigma, T


@dataclasses.dataclass(frozen=True)
class MagneticModelInForce:
    """How the magnetic field is read from a sample on."""

    model: FieldModel
    north: int  #: code of its north
    corrected: bool  #: whether the model takes off interference that a station showed
    update: StationUpdate | None = None  #: what the station gave with which this model came into force
    #: A gyro has shown that the magnetic azimuth is wrong though its field is in order: it is not used until a gyro
    #: shows otherwise.
    external_interference: bool = False
    #: How far a gyro that is too uncertain to contradict is from the magnetic azimuth, rad; in the model's sigma.
    unresolved: float = 0.0


class StationAzimuth(NamedTuple):
    """Azimuth of an accepted station from the named north, to be propagated to the next; nan where there is none."""

    #: `azimuth`, `sigma`: rad, and 1 sigma of the tool axis' own, without how the tool lies in the hole.
    azimuth: float = math.nan
    sigma: float = math.nan
    constant_sigma: float = math.nan  #: the part of that sigma which every magnetic azimuth shares
    by_gyro: bool = False  #: whether a gyro found north there


NO_STATION = StationAzimuth()


class BinEvent(NamedTuple):
    """A bin judged before the sample at `place`: its index, its end, and the azimuths that were found in it."""

    place: int
    bin: int
    end_ns: int
    #: `seek_azimuth`, `seek_sigma`: of a north seek, rad; nan where there is none.
    seek_azimuth: float = math.nan
    seek_sigma: float = math.nan
    station: StationAzimuth = NO_STATION
