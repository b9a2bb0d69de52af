# SPDX-License-Identifier: Apache-2.0
"""
Gravity from the accelerometer alone: the baseline to which every other method is compared.

Down is minus the direction of the specific force, sample by sample, without gyro and filter. This method is also used
while the gyros are faulty (`fallback`). Limits: ``docs/methods/fuzzy_mahony.md``.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core import track
from mwd_estimation.core.status import Status
from mwd_estimation.core.track import Track
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.records import dtype_of

_INITIALISING = int(Status.INITIALISING)

#: One record with the fields of `AccelerometerRecord`, shape (1,); a run can continue from a copy.
State = NDArray[np.void]


class AccelerometerParams(NamedTuple):
    """Settings of the accelerometer-only method."""

    gravity: float = STANDARD_GRAVITY  #: magnitude of local gravity, m/s^2
    memory: float = 2.0  #: averaging time of the disturbance, from which sigma is computed, s
    accel_range: float = 16.0 * STANDARD_GRAVITY  #: force at which the accelerometer clips, m/s^2
    sigma_floor: float = 0.003  #: smallest sigma, rad


class AccelerometerRecord:
    """State of the method; averages of the force are over the time `AccelerometerParams.memory`."""

    clock: track.TrackClock
    motion: track.TrackMotion
    down: Annotated[Array, 3]  #: last direction down, unit vector
    mean: Annotated[Array, 3]  #: mean force in tool axes, m/s^2
    square: Annotated[Array, 3]  #: mean square of the force along each tool axis, (m/s^2)^2
    power: float  #: mean square of the difference between the force's magnitude and gravity, (m/s^2)^2


RECORD = dtype_of(AccelerometerRecord)


def initial(params: AccelerometerParams) -> State:  # noqa: ARG001  (every method has this signature)
    """Return the state before the first sample, shape (1,), dtype RECORD."""
    state = np.zeros(1, RECORD)
    state["down"] = np.nan
    return state


def run(params: AccelerometerParams, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
    """
    Return minus the direction of the specific force, sample by sample; arguments and errors as for `fuzzy_mahony.run`.

    Sigma comes from the mean square of all forces other than gravity (`_disturbance`), because the direction of a
    disturbance is unknown: vibration along a horizontal hole does not change the magnitude of the force to first order.
    """
    stamps, gyro, accel = track.sample_arrays(stamp_ns, gyro_t, accel_t)
    out = Track.empty(len(stamps))
    _run(params, state[0], stamps, gyro, accel, out)
    return out


@compiled
def _run(p: AccelerometerParams, s: Any, stamps: Stamps, gyro: Array, accel: Array, out: Track) -> None:
    for i in range(len(stamps)):
        w, f = (gyro[i, 0], gyro[i, 1], gyro[i, 2]), (accel[i, 0], accel[i, 1], accel[i, 2])
        # The gyro is not used, so its clipping is ignored.
        verdict, dt, bits = track.take(s.clock, stamps[i], w, f, track.GAP_NS, math.inf, p.accel_range)
        if verdict == track.REJECTED:
            if not math.isfinite(s.down[0]):
                bits |= _INITIALISING
        else:
            if verdict != track.NEXT:
                dt = 0.0
            norm = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
            for c in range(3):
                s.down[c] = -f[c] / norm
            non_gravity = abs(norm - p.gravity)
            share = dt / (p.memory + dt) if dt > 0.0 else 1.0
            for c in range(3):
                s.mean[c] += share * (f[c] - s.mean[c])
                s.square[c] += share * (f[c] * f[c] - s.square[c])
            s.power += share * (non_gravity * non_gravity - s.power)
            bits |= track.follow_motion(s.motion, dt, w, non_gravity)
        for c in range(3):
            out.g_t[i, c] = s.down[c]
        across = math.hypot(s.down[1], s.down[2])
        inclination, aside = _tilts(p, s, across)
        track.write_row(out, i, across, inclination, s.motion, bits)
        out.sigma_toolface[i] = min(math.pi, aside / max(across, 1e-3))


@compiled
def _tilts(p: AccelerometerParams, s: Any, across: float) -> tuple[float, float]:
    """
    Return 1 sigma of the direction down in the vertical plane of the axis and across that plane, rad, at most pi.

    across: sine of the inclination. The direction of the hole hardly changes within the averaging time, so every change
    of the axial force is a disturbance; the remaining disturbance acts equally on both axes across the tool.
    """
    axial = s.square[0] - s.mean[0] * s.mean[0]
    total = _disturbance(p, s)
    share = total / (p.gravity * p.gravity)
    if not (share < 1.0 and math.isfinite(across)):
        return math.pi, math.pi
    aside = 0.5 * max(total - axial, 0.0)
    along = axial * across * across + aside * (1.0 - across * across)
    # A disturbance nearly as strong as gravity hides the direction, so the scale grows without limit. The third
    # power keeps the sigma of weaker disturbances unchanged
    # (`test_any_rate_from_50_to_1000_hz_is_followed_from_a_start_in_motion`).
    scale = 1.0 / ((1.0 - share * share * share) * p.gravity * p.gravity)
    floor = p.sigma_floor * p.sigma_floor
    along = math.sqrt(max(along, s.power) * scale + floor)
    aside = math.sqrt(max(aside, s.power) * scale + floor)
    return min(along, math.pi), min(aside, math.pi)


@compiled
def _disturbance(p: AccelerometerParams, s: Any) -> float:
    """
    Return the mean square of the forces other than gravity over the averaging time, (m/s^2)^2.

    A disturbance that is not correlated with gravity adds its mean square to the mean square of the force, for any
    direction. The errors of the accelerometers make the result uncertain by `slack`. Within this uncertainty, the
    variance of the force in tool axes is used. In a rotating tool this variance includes gravity, and it excludes
    forces that are constant in tool axes, such as the centripetal force.
    """
    square = s.square[0] + s.square[1] + s.square[2]
    changes = square - (s.mean[0] * s.mean[0] + s.mean[1] * s.mean[1] + s.mean[2] * s.mean[2])
    excess, slack = square - p.gravity * p.gravity, 2.0 * p.gravity * p.gravity * p.sigma_floor
    return float(max(min(max(changes, excess - slack), excess + slack), s.power))
