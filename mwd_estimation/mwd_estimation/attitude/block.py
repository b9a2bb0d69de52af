# SPDX-License-Identifier: Apache-2.0
"""Inputs of the attitude stream for a block of samples: the samples, the field model in force, and bin events."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from mwd_estimation.attitude.time_alignment import FieldModel
from mwd_sensors.core.arrays import Array, Samples


@dataclasses.dataclass(frozen=True)
class Block:
    """Samples of the conventional unit with their gravity, and faults that concern all of them."""

    samples: Samples  #: samples, dtype `sample.SAMPLE`, shape (n,)
    unusable: int = 0  #: sensors that are faulty throughout the block, as bits of `core.sensor_fault`
    contaminated: bool = False  #: whether the azimuth contains wrong values of a faulty sensor


@dataclasses.dataclass(frozen=True)
class StationUpdate:
    """Results of a survey station that the continuous estimate uses."""

    #: State, shape (8,), and covariance, shape (8, 8), of the interference filter from the stations of the run; the
    #: continuous filter continues from these values. None if the stations gave no estimate.
    interference: tuple[Array, Array] | None
    #: `down`, `field`: shape (3,); unit vector down and field, T, at the station.
    down: Array
    field: Array
    #: `azimuth`, `sigma`: gyro azimuth from magnetic north, rad; NaN if there is none.
    azimuth: float = math.nan
    sigma: float = math.nan
    accepted: bool = False  #: whether the station passed its checks
    axial: tuple[float, float] = (0.0, 0.0)  #: axial interference removed from the station's field, and 1 sigma, T


@dataclasses.dataclass(frozen=True)
class MagneticModelInForce:
    """Field model that holds from a certain sample on, and findings about its magnetic azimuth."""

    model: FieldModel
    north: int  #: code of the north reference of the model
    corrected: bool  #: whether the model subtracts interference that was found at a station
    update: StationUpdate | None = None  #: results of the station with which this model came into force
    #: True if a gyro has shown that the magnetic azimuth is wrong although the field passes its checks. The azimuth is
    #: then not used until a gyro shows otherwise.
    external_interference: bool = False
    #: Difference of a gyro azimuth from the magnetic azimuth when the gyro is too uncertain to contradict it, rad;
    #: it is included in the model's sigma.
    unresolved: float = 0.0


class StationAzimuth(NamedTuple):
    """Azimuth of an accepted station from the reference north, to propagate to the next station; NaN if unknown."""

    #: `azimuth`, `sigma`: azimuth of the tool axis and 1 sigma, rad, without the tool's misalignment in the hole.
    azimuth: float = math.nan
    sigma: float = math.nan
    #: 1 sigma of the part of the error that all magnetic azimuths share, rad; contained in `sigma`.
    constant_sigma: float = math.nan
    by_gyro: bool = False  #: whether a gyro found north at the station


NO_STATION = StationAzimuth()


class BinEvent(NamedTuple):
    """A closed bin of time, with the azimuths of a north seek and of a station that ended in the bin."""

    place: int  #: index in the block of the sample before which the bin is evaluated
    bin: int  #: index of the bin: its start divided by its length
    end_ns: int  #: end of the bin, ns
    #: `seek_azimuth`, `seek_sigma`: result of a north seek, rad; NaN if there is none.
    seek_azimuth: float = math.nan
    seek_sigma: float = math.nan
    station: StationAzimuth = NO_STATION
