# SPDX-License-Identifier: Apache-2.0
"""Decide whether the azimuth of a north seek may be used, and give the reason if it may not be used."""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.gyrocompass.seek_state import SeekParams, SeekState
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR

# Largest 1 sigma of an azimuth that is not refused, rad.
WORST_SIGMA = math.radians(20.0)
# Largest geodetic latitude, deg; beyond it the horizontal component of the Earth's rotation is too small.
_MAX_LATITUDE_DEG = 85.0
# Largest share of clipped samples, largest share of time with rotation in a still seek, and smallest share of time with
# rotation in a rotating seek.
_CLIPPED_SHARE, _TURNED_MOST, _TURNED_LEAST = 0.001, 0.02, 0.5
# Largest rms sway of the hole axis at rest, rad, because sway turns the Earth rate that the gyros measure; and smallest
# angle of the hole from the vertical with an azimuth, rad.
_AXIS_VARIATION, _LEAST_INCLINATION = math.radians(0.05), math.radians(3.0)
# Smallest share of the horizontal Earth rate that must be measured; it is small if the tool rotates about an axis near
# horizontal east-west.
_LEAST_SENSITIVITY = 0.17
# Probability of another latitude above which north is refused.
_OTHER_SURE = 0.99
# Limits: difference of the Earth rate from its value at the latitude, and instrument errors, both in sigmas.
_MISFIT, _EXCESSIVE = 3.0, 5.0


@dataclasses.dataclass(frozen=True)
class Fit:
    """Estimate of north by the filter of a seek."""

    method: str  #: motion of the tool: still, two_position or rotating
    #: `azimuth`, `sigma`, `inclination`: values for the hole axis, rad; the latitude may be wrong.
    azimuth: float
    sigma: float
    inclination: float
    sigma_there: float  #: 1 sigma of the azimuth if the latitude is right, rad
    sensitivity: float  #: share of the horizontal Earth rate that this method measures at this attitude, 0 to 1
    misfit: float  #: squared distance of the Earth rate from its value at the latitude, in sigmas
    #: `wrong`, `likeliest`: probability of all other latitudes together, and the most probable one of them, rad.
    wrong: float
    likeliest: float
    azimuths: tuple[float, ...]  #: azimuths that fit equally well, rad, if there are several
    bias: Array  #: shape (3,); gyro biases, rad/s; 0 for a bias that was not found


def refusal(params: SeekParams, state: SeekState, fit: Fit) -> Reason | None:
    """
    Return the first reason to refuse an azimuth, or None if the azimuth may be used.

    The causes are tested in this order: motion, attitude, latitude, instrument errors, sigma.
    """
    return (
        motion(params, state, fit.method)
        or _attitude(fit)
        or _latitude(params, fit)
        or _instrument(params, state, fit)
        or _uncertainty(params, float(state.elapsed), fit)
    )


def polar(latitude_deg: float) -> Reason | None:
    """Return the refusal near a pole, where the horizontal Earth rate is too small; None at other latitudes."""
    if abs(latitude_deg) <= _MAX_LATITUDE_DEG:
        return None
    return Reason(Code.LATITUDE_POLAR, math.radians(latitude_deg), math.radians(_MAX_LATITUDE_DEG))


def too_short(elapsed: float, shortest: float) -> Reason:
    """Return the refusal of a seek that is too short; elapsed, shortest: its duration and the shortest one, s."""
    return Reason(Code.SEEK_TOO_SHORT, elapsed, shortest)


def gyro_clipped(params: SeekParams, clipped: int, samples: int) -> Reason | None:
    """
    Return the refusal if too large a share of the samples is clipped; otherwise None.

    clipped: number of samples in which a gyro clipped; samples: number of all samples.
    """
    if clipped <= _CLIPPED_SHARE * samples:
        return None
    given = (float(samples), math.radians(params.gyro_range_dps))
    return Reason(Code.GYRO_CLIPPED, float(clipped), _CLIPPED_SHARE * samples, given)


def vertical_hole(inclination: float) -> Reason | None:
    """Return the refusal of a vertical hole, which has no azimuth, or None; inclination: rad."""
    if _LEAST_INCLINATION <= inclination <= math.pi - _LEAST_INCLINATION:
        return None
    return Reason(Code.VERTICAL_HOLE, inclination, _LEAST_INCLINATION)


def motion(params: SeekParams, state: SeekState, method: str) -> Reason | None:
    """
    Return the refusal of a seek because of its motion; None if the motion allows a north seek.

    Reasons: clipped gyros, a short seek, a motion that does not suit the mode of the seek, or a hole axis that moved.
    """
    elapsed, turning, mode = float(state.elapsed), float(state.turn_time), params.mode
    clipped = gyro_clipped(params, state.clipped, state.samples)
    if clipped is not None:
        return clipped
    if elapsed < params.shortest:
        return too_short(elapsed, params.shortest)
    if mode == "still" and turning > _TURNED_MOST * elapsed:
        return Reason(Code.TURNED_AT_REST, turning, _TURNED_MOST * elapsed, (elapsed,))
    if mode == "rotating" and turning < _TURNED_LEAST * elapsed:
        return Reason(Code.TURNED_TOO_LITTLE, turning, _TURNED_LEAST * elapsed, (elapsed,))
    if mode == "two_position" and state.positions < 2:
        return Reason(Code.NO_SECOND_POSITION, float(state.positions), 2.0)
    if state.moved > 0:
        return Reason(Code.HOLE_AXIS_MOVED, float(state.moved), 0.0)
    variation = math.sqrt(max(state.scatter[0], state.scatter[1], 0.0))
    if method in ("still", "two_position") and variation > _AXIS_VARIATION:
        return Reason(Code.HOLE_AXIS_SWINGS, variation, _AXIS_VARIATION)
    return None


def _attitude(fit: Fit) -> Reason | None:
    vertical = vertical_hole(fit.inclination)
    if vertical is not None:
        return vertical
    seen = fit.sensitivity
    if fit.azimuths:
        # Check each azimuth that fits, because the mean of two of them does not fit.
        seen = max(math.sqrt(max(1.0 - (math.sin(fit.inclination) * math.sin(a)) ** 2, 0.0)) for a in fit.azimuths)
    uncertain = fit.sigma > WORST_SIGMA / 4.0
    if seen < _LEAST_SENSITIVITY and fit.method in ("rotating", "two_position") and uncertain:
        off = max(math.asin(min(1.0, seen)), math.radians(0.5))
        return Reason(Code.EAST_WEST_HOLE, off, math.asin(_LEAST_SENSITIVITY), (fit.azimuth,))
    return None


def _latitude(params: SeekParams, fit: Fit) -> Reason | None:
    """
    Return the refusal if the measured Earth rate contradicts the latitude; otherwise None.

    The latitude is refused if no plausible gyro error explains the difference, if another latitude is nearly certain,
    or if another latitude fits as well and gives another azimuth.
    """
    latitude = math.radians(params.latitude_deg)
    if fit.misfit > _MISFIT**2:
        return Reason(Code.LATITUDE_MISFIT, math.sqrt(fit.misfit), _MISFIT, (latitude,))
    if fit.wrong > _OTHER_SURE or fit.sigma > WORST_SIGMA > fit.sigma_there:
        return Reason(Code.LATITUDE_OTHER, fit.wrong, _OTHER_SURE, (latitude, fit.likeliest))
    return None


def _instrument(params: SeekParams, state: SeekState, fit: Fit) -> Reason | None:
    """Return the refusal if an error of the instrument is far outside its stated range; otherwise None."""
    bias, scale, leak = Code.GYRO_BIAS_EXCESSIVE, Code.GYRO_SCALE_EXCESSIVE, Code.GYRO_LEAK_EXCESSIVE
    x, y, z = (sigma * DEG_PER_HOUR for sigma in params.bias_sigma_deg_h)
    stated = (
        (bias, "x gyro bias", float(fit.bias[0]), x),
        (bias, "y gyro bias", float(fit.bias[1]), y),
        (bias, "z gyro bias", float(fit.bias[2]), z),
        (scale, "x gyro scale error", state.scale_x, params.scale_x_ppm * 1e-6),
        (leak, "share of the x rate in the y gyro", state.leak[0], params.leak_urad * 1e-6),
        (leak, "share of the x rate in the z gyro", state.leak[1], params.leak_urad * 1e-6),
    )
    for code, name, found, sigma in stated:
        if abs(found) > _EXCESSIVE * sigma:
            return Reason(code, float(found), sigma, names=(name,))
    return None


def _uncertainty(params: SeekParams, elapsed: float, fit: Fit) -> Reason | None:
    if fit.azimuths and fit.sigma_there > WORST_SIGMA / 4.0:
        return Reason(Code.TWO_AZIMUTHS_FIT_GYRO, fit.sigma_there, WORST_SIGMA / 4.0, fit.azimuths)
    if fit.sigma <= WORST_SIGMA:
        return None
    bias = params.gyro_bias_deg_h * DEG_PER_HOUR
    noise = params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR / math.sqrt(elapsed)
    if bias > 2.0 * noise and fit.method == "still":
        return Reason(Code.GYRO_BIAS_UNKNOWN, fit.sigma, WORST_SIGMA, (bias,))
    return Reason(Code.SEEK_UNCERTAIN, fit.sigma, WORST_SIGMA, (elapsed,))
