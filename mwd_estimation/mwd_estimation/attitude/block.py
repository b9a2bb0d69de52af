# SPDX-License-Identifier: Apache-2.0
"""What the attitude stream is given with a block of samples: the samples, the field model in force, and bin events."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.attitude.time_alignment_state import FieldModel
from mwd_estimation.core.track import Track
from mwd_sensors.core.arrays import Array, Stamps


@dataclasses.dataclass(frozen=True)
class Block:
    """
    Samples of the AHRS, laid out for the kernels, the gravity followed through them, and the state of the sensors.

    Attributes
    ----------
    stamps, gyro, accel : ndarray, shapes (n,), (n, 3) and (n, 3)
        ns, rad/s (nan where the gyros are unusable), m/s^2.
    track : Track
    suspect : ndarray of uint8, shape (n,)
        Sensors in doubt at each sample, bits of `core.sensor_fault`.
    unusable : int
        Sensors known to be faulty throughout the block, as such bits.
    contaminated : bool
        Whether the azimuth has taken in wrong values of a faulty sensor.
    """

    stamps: Stamps
    gyro: Array
    accel: Array
    track: Track
    suspect: NDArray[np.uint8]
    unusable: int = 0
    contaminated: bool = False


@dataclasses.dataclass(frozen=True)
class StationUpdate:
    """
    What the continuous estimate takes over from a station.

    Attributes
    ----------
    interference : (ndarray (8,), ndarray (8, 8)) or None
        State and covariance of the interference filter, by many stations together, to go on from.
    down, field : ndarray, shape (3,)
        Unit vector down and field, T, of the station.
    azimuth, sigma : float
        From magnetic north, rad, by a gyro; nan where there is none.
    accepted : bool
        Whether the station passed its checks.
    axial : tuple of float
        Axial interference that it was corrected for, and 1 sigma, T.
    """

    interference: tuple[Array, Array] | None
    down: Array
    field: Array
    azimuth: float = math.nan
    sigma: float = math.nan
    accepted: bool = False
    axial: tuple[float, float] = (0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class MagneticModelInForce:
    """
    How the magnetic field is read from a sample on.

    Attributes
    ----------
    model : FieldModel
    north : int
        Code of its north.
    corrected : bool
        Whether the model takes off interference that a station showed.
    update : StationUpdate or None
        What the station gave with which this model came into force.
    external_interference : bool
        A gyro has shown that the magnetic azimuth is wrong though its field is in order: it is not used until a gyro
        shows otherwise.
    unresolved : float
        How far a gyro that is too uncertain to contradict is from the magnetic azimuth, rad; in the model's sigma.
    """

    model: FieldModel
    north: int
    corrected: bool
    update: StationUpdate | None = None
    external_interference: bool = False
    unresolved: float = 0.0


class StationAzimuth(NamedTuple):
    """
    Azimuth of an accepted station, to be propagated to the next one, rad from the named north; nan where there is none.

    Attributes
    ----------
    azimuth, sigma : float
        And 1 sigma of the tool axis' own, without how the tool lies in the hole.
    constant_sigma : float
        The part of that sigma which every magnetic azimuth shares.
    by_gyro : bool
        Whether a gyro found north there.
    """

    azimuth: float = math.nan
    sigma: float = math.nan
    constant_sigma: float = math.nan
    by_gyro: bool = False


NO_STATION = StationAzimuth()


@dataclasses.dataclass(frozen=True)
class BinEvent:
    """
    A bin judged before the sample at `place`: its index, its end, and the azimuths that were found in it.

    Attributes
    ----------
    seek_azimuth, seek_sigma : float
        Of a north seek, rad; nan where there is none.
    station : StationAzimuth
    """

    place: int
    bin: int
    end_ns: int
    seek_azimuth: float = math.nan
    seek_sigma: float = math.nan
    station: StationAzimuth = NO_STATION
